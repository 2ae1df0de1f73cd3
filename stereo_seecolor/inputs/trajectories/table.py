"""The text of a trajectory file: lines with their numbers; errors name the line."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from calibration.files import decode_text
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import read_bytes
from stereo_seecolor.inputs.trajectories.foreign import named_by_begin

# Times of day and of the epoch, as tables of navigation write them.

_EPOCH_UNITS = ((1e17, 1e9), (1e14, 1e6), (1e11, 1e3))
"""Numbers from here on are in nanoseconds, microseconds, milliseconds: in seconds they would be
past the year 5000.
"""
_MOMENT = re.compile(
    r"(\d{1,4})([/.-])(\d{1,2})[/.-](\d{1,4})[ ,T]+"
    r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?\s*([AP])?\.?(?:M\.?)?\s*(?:Z|UTC|GMT)?",
    re.IGNORECASE,
)
_UNKNOWN = re.compile(r"|-+(\.-+)?|n/?a|nan|null|nil|none|unknown|invalid", re.IGNORECASE)
"""What stands in a cell without a value, ``--.--`` and ``N/A`` among them."""


class AmbiguousDateError(ValueError):
    """Dates of a column that may be day/month or month/day."""


class TimeError(ValueError):
    """A cell that is not a time. row: its number in the column, from 0."""

    def __init__(self, row: int, text: str):
        super().__init__(text)
        self.row = row


def is_unknown(text: str) -> bool:
    """Tell whether a cell says that there is no value."""
    return _UNKNOWN.fullmatch(text.strip()) is not None


def seconds(text: str) -> float:
    """Seconds since 1970 from a number (seconds, ms, us or ns, by its size) or an ISO 8601 time;
    UTC unless it says otherwise.

    Raises ValueError for anything else.
    """
    try:
        number = float(text)
    except ValueError:
        moment = datetime.fromisoformat(text.removesuffix(" UTC"))
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    unit = next((unit for least, unit in _EPOCH_UNITS if abs(number) >= least), 1.0)
    return number / unit


def column_seconds(texts: Sequence[str], day_first: bool | None = None) -> list[float]:
    """Seconds since 1970 of a whole column, UTC: as ``seconds``, or a date of three numbers and
    h:m:s, also with AM and PM.

    day_first: whether 3/4/2026 is the third of April where no date of the column tells; None: not
    known. A cell without a value is NaN. Raises AmbiguousDateError where that is needed, and
    TimeError for a cell that is not a time.
    """
    found = [_parsed(row, text) for row, text in enumerate(texts)]
    dates = [(int(m[1]), int(m[3])) for m in found if isinstance(m, re.Match) and len(m[1]) < 4]
    if any(first > 12 for first, _ in dates) or any(
        isinstance(m, re.Match) and m[2] == "." for m in found
    ):
        day_first = True
    elif any(second > 12 for _, second in dates):
        day_first = False
    if dates and day_first is None:
        first = next(text for text, m in zip(texts, found, strict=True) if isinstance(m, re.Match))
        raise AmbiguousDateError(f"{first!r} may be day/month or month/day")
    return [
        m if isinstance(m, float) else _of_match(row, m, day_first is not False)
        for row, m in enumerate(found)
    ]


def _parsed(row: int, text: str) -> float | re.Match[str]:
    if is_unknown(text):
        return float("nan")
    if match := _MOMENT.fullmatch(text.strip()):
        return match
    try:
        return seconds(text.strip())
    except (ValueError, OverflowError) as error:
        raise TimeError(row, text) from error


def _of_match(row: int, match: re.Match[str], day_first: bool) -> float:
    one, two, three, hour, minute = (int(match[i]) for i in (1, 3, 4, 5, 6))
    year, month, day = (
        (one, two, three)
        if len(match[1]) == 4
        else (three, two, one)
        if day_first
        else (three, one, two)
    )
    if half := match[8]:
        hour = hour % 12 + 12 * (half.upper() == "P")
    try:
        midnight = datetime(year + 2000 * (year < 100), month, day, hour, minute, tzinfo=UTC)
    except ValueError as error:
        raise TimeError(row, match[0]) from error
    return midnight.timestamp() + float((match[7] or "0").replace(",", "."))


_DECIMAL_COMMA = re.compile(r"^([+-]?\d+),(\d+)$")
"""As programs of many countries write numbers, between semicolons."""

HEADER_CHARACTERS = 4096
"""A longer first line names no columns; patterns of names would take minutes on it."""
LARGEST = 1e12
"""Meters, degrees and seconds are less: the epoch is at 2e9 s."""


def is_number(field: str) -> bool:
    """Tell whether ``field`` reads as a float."""
    try:
        float(field)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Lines:
    """The lines of a file that are not empty; content: those that are no comment either, each with
    its line number in the file.
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
    """A file with a header: columns by their lower-case names."""

    lines: Lines
    rows: tuple[tuple[int, dict[str, str]], ...]

    @classmethod
    def read(
        cls, lines: Lines, separator: str, header: list[str], rows: tuple[tuple[int, str], ...]
    ) -> "Table":
        """Split the rows. Raises InputError where there are none, and for a row that is shorter
        than the header.
        """
        if not rows:
            raise InputError(f"{lines.path}: holds a header, but no rows")
        split = []
        for number, line in rows:
            fields = _split(lines, number, separator, line)
            if len(fields) < len(header):
                raise lines.error(
                    number, f"has {len(fields)} columns, the header has {len(header)}"
                )
            split.append((number, dict(zip(header, fields, strict=False))))
        return cls(lines, tuple(split))

    def column(self, name: str, default: float | None = None) -> list[float]:
        """A column as floats; cells without a value (empty, NA, --.--) are NaN, or ``default``
        where the whole column is absent.
        """
        if self.rows and name not in self.rows[0][1]:
            if default is None:
                raise InputError(f"{self.lines.path}: has no column {name!r}")
            return [default] * len(self.rows)
        return [self._number(number, row[name]) for number, row in self.rows]

    def text(self, name: str) -> list[str]:
        """A column as text; "" where it is absent."""
        return [row.get(name, "") for _, row in self.rows]

    def _number(self, number: int, field: str) -> float:
        return float("nan") if is_unknown(field) else self.lines.numbers(number, [field])[0]


def _split(lines: Lines, number: int, separator: str, line: str) -> list[str]:
    try:
        fields = [
            field.strip()
            for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        ]
    except csv.Error as error:
        raise lines.error(number, str(error)) from error
    return fields if separator == "," else [_DECIMAL_COMMA.sub(r"\1.\2", field) for field in fields]
