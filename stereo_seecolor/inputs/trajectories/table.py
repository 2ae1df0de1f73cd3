"""The text of a trajectory file: lines with their numbers; errors name the line."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from calibration.bounded_text import decode_text
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.csv_tables import is_unit, split_fields
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.inputs.trajectories.foreign import named_by_begin
from stereo_seecolor.inputs.trajectories.numpy_poses import is_numpy, of_numpy
from stereo_seecolor.inputs.trajectories.times import is_unknown

_DECIMAL_COMMA = re.compile(r"^([+-]?\d+),(\d+)$")
"""As programs of many countries write numbers, between semicolons."""

HEADER_CHARACTERS = 4096
"""A longer first line names no columns; patterns of names would take minutes on it."""
LARGEST = 1e12
"""Meters, degrees and seconds are less: the epoch is at 2e9 s."""


def is_number(field: str) -> bool:
    """Tell whether ``field`` reads as a float."""
    try:
        float(field.replace("_", "x"))  # Python takes 20260528_120000 for a number
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Lines:
    """The lines of a file that are not empty; content: those that are not comments either, each
    with its line number in the file.
    """

    path: Path
    all: tuple[str, ...]
    content: tuple[tuple[int, str], ...]

    @property
    def first(self) -> str:
        """The first line with content, "" where there is none."""
        return self.content[0][1] if self.content else ""

    @property
    def header(self) -> str:
        """The first line of all, without what makes a comment of it."""
        return self.all[0][:HEADER_CHARACTERS].lstrip("#% ")

    def error(self, number: int, what: str) -> InputError:
        """An error that names file and line."""
        return InputError(f"{self.path}: line {number}: {what}")

    def numbers(self, number: int, fields: list[str]) -> list[float]:
        """Fields as floats ("nan" is one). Raises InputError naming the line, also for what no
        position or time can be.
        """
        try:
            values = [float(field) for field in fields]
        except ValueError as error:
            raise self.error(number, f"expected numbers, got {' '.join(fields)[:60]!r}") from error
        if any(abs(value) > LARGEST for value in values):
            raise self.error(number, f"{max(values, key=abs):g} is neither a position nor a time")
        return values


def read_lines(path: Path) -> Lines:
    """Read a text file; ``#`` and ``%`` start a comment. Raises InputError if that fails, and names
    what is not text.
    """
    raw = read_bytes(path)
    if is_numpy(path, raw):
        raw = of_numpy(path, raw).encode()
    if kind := named_by_begin(raw):
        raise InputError(f"{path}: is {kind}")
    try:
        text = decode_text(raw)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text ({error.reason} at byte {error.start})") from error
    numbered = [
        (i, line.strip()) for i, line in enumerate(text.splitlines(), start=1) if line.strip()
    ]
    content = tuple((i, line) for i, line in numbered if not line.startswith(("#", "%")))
    if not numbered:
        raise InputError(f"{path}: the trajectory is empty")
    return Lines(path, tuple(line for _, line in numbered), content)


@dataclass(frozen=True)
class Table:
    """A file with a header: columns by their lower-case names. twice: names of several columns that
    differ, of which none can be taken.
    """

    lines: Lines
    rows: tuple[tuple[int, dict[str, str]], ...]
    twice: frozenset[str] = frozenset()

    @classmethod
    def read(
        cls,
        lines: Lines,
        separator: str,
        header: list[str],
        rows: tuple[tuple[int, str], ...],
        is_whole: bool = False,
    ) -> "Table":
        """Split the rows, without a line of units above them and one of words below.

        is_whole: the header names all columns. Raises InputError where there are no rows, and for a
        row of other columns than the header's.
        """
        split = [
            (number, fields)
            for number, line in rows
            if any(fields := _split(lines, number, separator, line))
        ]
        if split and len(split[-1][1]) == 1 < len(header) and not is_number(split[-1][1][0]):
            split.pop()  # ``END OF FILE``
        if len(split) > 1 and all(is_unit(field) for field in split[0][1]):
            split.pop(0)
        if not split:
            raise InputError(f"{lines.path}: holds a header, but no rows")
        for number, fields in split:
            if len(fields) < len(header) or (is_whole and any(fields[len(header) :])):
                raise lines.error(
                    number, f"has {len(fields)} columns, the header has {len(header)}"
                )
        named = [(number, dict(zip(header, fields, strict=False))) for number, fields in split]
        twice = {
            name
            for place, name in enumerate(header)
            if header.count(name) > 1
            and any(
                fields[place] != row[name]
                for (_, fields), (_, row) in zip(split, named, strict=True)
            )
        }
        return cls(lines, tuple(named), frozenset(twice))

    def column(self, name: str, default: float | None = None) -> list[float]:
        """A column as floats; cells without a value (empty, NA, --.--) are NaN, or ``default``
        where the whole column is absent.
        """
        self._check_single(name)
        if self.rows and name not in self.rows[0][1]:
            if default is None:
                raise InputError(f"{self.lines.path}: has no column {name!r}")
            return [default] * len(self.rows)
        return [self._number(number, row[name]) for number, row in self.rows]

    def text(self, name: str) -> list[str]:
        """A column as text; "" where it is absent. Several, with spaces between their names, with
        spaces between.
        """
        parts = [name] if not self.rows or name in self.rows[0][1] else name.split()
        for part in parts:
            self._check_single(part)
        return [" ".join(row.get(part, "") for part in parts) for _, row in self.rows]

    def _check_single(self, name: str) -> None:
        if name in self.twice:
            raise InputError(
                f"{self.lines.path}: has several columns {name!r}, which differ: leave one"
            )

    def _number(self, number: int, field: str) -> float:
        return float("nan") if is_unknown(field) else self.lines.numbers(number, [field])[0]


def _split(lines: Lines, number: int, separator: str, line: str) -> list[str]:
    try:
        fields = split_fields(line, separator)
    except csv.Error as error:
        raise lines.error(number, str(error)) from error
    return fields if separator == "," else [_DECIMAL_COMMA.sub(r"\1.\2", field) for field in fields]
