"""Tables as CSV: unknown values are written as empty cells; reading names the line that cannot be used."""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.reading import read_bytes


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
    return value


def header(path: Path) -> Sequence[str]:
    """The columns of a table. Raises InputError if it cannot be read."""
    return _reader(path).fieldnames or ()


def rows(path: Path, columns: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """Place (path and line) and cells of each row. Raises InputError, also where one of ``columns`` is missing."""
    missing = [name for name in columns if name not in header(path)]
    if missing:
        raise InputError(f"{path}: has no column {missing[0]!r}: give the columns {', '.join(columns)}")
    yield from ((f"{path}: line {number}", row) for number, row in enumerate(_reader(path), start=2))


def _reader(path: Path) -> "csv.DictReader[str]":
    return csv.DictReader(io.StringIO(read_bytes(path).decode("utf-8-sig", errors="replace")))
