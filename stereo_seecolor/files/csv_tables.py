"""Tables as CSV: unknown values are empty cells; reading names the unusable line."""

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.text_documents import read_text


def csv_text(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """A table; numbers with six digits, and empty where they are None or not finite."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else ""
    return guard_formula(value)


_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""How a text begins that a spreadsheet would run, or that ``guard_formula`` made."""


def guard_formula(cell: Any) -> Any:
    """A cell that a spreadsheet shows and does not run: an apostrophe before a text that begins as
    a formula does. Numbers stay; the readers of this file take it off again.
    """
    if not isinstance(cell, str) or not _FORMULA.match(cell):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def _unguarded(cell: str) -> str:
    return cell[1:] if cell[:1] == "'" and _FORMULA.match(cell) else cell


def table_rows(content: bytes) -> Iterator[dict[str, str]]:
    """The rows of a table that this program wrote, by the names of its columns.

    Raises ValueError where it is damaged: no text, a row of other cells than the header's, a cell
    of more than 131,072 characters.
    """
    try:
        for number, row in enumerate(
            csv.DictReader(io.StringIO(content.decode(), newline="")), start=2
        ):
            if None in row or None in row.values():
                raise ValueError(f"row {number} has other cells than the header")
            yield {name: _unguarded(cell) for name, cell in row.items()}
    except csv.Error as error:
        raise ValueError(f"is not a table: {error}") from error


def header(path: Path) -> Sequence[str]:
    """The columns of a table, in lower case. Raises InputError if it cannot be read."""
    return _reader(path).fieldnames or ()


def rows(path: Path, columns: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """Place (path and line) and cells of each row, by the names of its columns in lower case.
    Raises InputError, also where one of ``columns`` is missing, or is there twice.
    """
    reader = _reader(path)
    names = list(reader.fieldnames or ())
    if missing := [name for name in columns if name not in names]:
        raise InputError(
            f"{path}: has no column {missing[0]!r} in its first line: give the columns "
            f"{', '.join(columns)}"
        )
    if twice := [name for name in columns if names.count(name) > 1]:
        raise InputError(f"{path}: has {names.count(twice[0])} columns {twice[0]!r}: leave one")
    try:
        yield from ((f"{path}: line {reader.line_num}", row) for row in reader)
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num + 1}: {error}") from error


_SPLIT_SECOND = re.compile(r"(\d:[0-5]\d:[0-5]\d),(\d{3}|\d{6})(?=,)")
"""As logs of Python write a time, ``12:00:01,250``."""


def separator_of(header: str) -> str:
    """What stands between the columns of a table: of comma, semicolon, tab and bar the most usual
    in its header, else spaces.
    """
    most = max(",;\t|", key=header.count)
    return most if most in header else " "


def split_fields(line: str, separator: str) -> list[str]:
    """The cells of a line. Raises csv.Error."""
    if separator == " ":
        return [_unguarded(field) for field in line.split()]
    line = _SPLIT_SECOND.sub(r"\1.\2", line) if separator == "," else line
    return [
        _unguarded(field.strip())
        for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    ]


def is_unit(field: str) -> bool:
    """Tell whether a cell is what stands below a column's name, as ``[deg]``."""
    return re.fullmatch(r"[\[(]?(?:[A-Za-z°/%]{1,8}\d?|-)?[\])]?", field) is not None


DECIMAL_COMMA = r"(?<![^{0}\n])([+-]?\d+),(\d+)(?=[{0}\n]|$)"
"""A number that fills a cell of a table with this separator."""


def dict_reader(text: str) -> "csv.DictReader[str]":
    """The rows of a table that people wrote, with decimal commas where commas do not separate."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    separator = separator_of(text.partition("\n")[0].strip())
    if separator != ",":
        text = re.sub(DECIMAL_COMMA.format(separator), r"\1.\2", text)
    reader = csv.DictReader(
        io.StringIO(text), delimiter=separator, restval="", skipinitialspace=True
    )
    reader.reader = _Cells(reader.reader)  # type: ignore[assignment]  # what it needs of a reader
    return reader


class _Cells:
    """The cells of a reader, unguarded; none of a row of empty cells, as spreadsheets leave."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    @property
    def line_num(self) -> int:
        return int(self._reader.line_num)

    def __iter__(self) -> Iterator[list[str]]:
        return self

    def __next__(self) -> list[str]:
        row = list(map(_unguarded, next(self._reader)))
        return row if any(cell.strip() for cell in row) else []


def _reader(path: Path) -> "csv.DictReader[str]":
    reader = dict_reader(read_text(path))
    try:
        reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
    except csv.Error as error:
        raise InputError(f"{path}: line 1: {error}") from error
    return reader
