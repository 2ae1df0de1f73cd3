"""frames.csv: the rows of a run as a table, written and read."""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, get_args

from stereo_seecolor.errors import InputError, printable
from stereo_seecolor.files.csv_tables import guard_formula, table_rows
from stereo_seecolor.files.whole_files import regular_bytes
from stereo_seecolor.records import FrameRow, Status
from stereo_seecolor.run_folder.finished_map import TrackPoint

CHUNK = 500
"""Rows that are written at once."""
RESIDUALS = ("position_residual_m", "attitude_residual_deg")
"""Columns that a map with given poses adds."""
BETWEEN = "; "
"""Stands between the warnings of a frame; a warning's own becomes a comma."""
_TEXTS = ("name", "status", "kept", "left", "right", "timestamp_s", "error", "warnings")
"""The first columns, which hold no number of the frame's facts or seconds."""


def frames_csv(rows: Sequence[FrameRow]) -> Iterator[bytes]:
    """The rows as lines of UTF-8 CSV, columns in fixed order, with ``<stage>_s`` of each stage."""
    facts, stages = set[str](), set[str]()
    for row in rows:
        facts.update(row.facts)
        stages.update(row.seconds)
    yield _csv_text([[*_TEXTS, *sorted(facts), *(f"{stage}_s" for stage in sorted(stages))]])
    for start in range(0, len(rows), CHUNK):
        yield _csv_text(
            _cells(row, sorted(facts), sorted(stages)) for row in rows[start : start + CHUNK]
        )


def _cells(row: FrameRow, facts: Sequence[str], stages: Sequence[str]) -> list[object]:
    timestamp = "" if row.timestamp_s is None else f"{row.timestamp_s:.9f}"
    texts = [
        row.name,
        row.status,
        int(row.kept),
        row.left,
        row.right,
        timestamp,
        row.error,
        BETWEEN.join(warning.replace(BETWEEN, ", ") for warning in row.warnings),
    ]
    numbers = [f"{row.facts[key]:.6g}" if key in row.facts else "" for key in facts]
    seconds = [f"{row.seconds[stage]:.4f}" if stage in row.seconds else "" for stage in stages]
    return [*texts, *numbers, *seconds]


def read_frames(path: Path, stages: Sequence[str]) -> tuple[FrameRow, ...]:
    """Read the rows of a frames.csv. stages: those with seconds. Raises InputError."""
    return _read(path, lambda cells: _with_numbers(_row(cells), cells, stages))


def read_rows(path: Path) -> tuple[FrameRow, ...]:
    """Read name, status, files, time and error alone of a frames.csv. Raises InputError."""
    return _read(path, _row)


def _read(path: Path, row_of: Callable[[dict[str, str]], FrameRow]) -> tuple[FrameRow, ...]:
    try:
        return tuple(map(row_of, table_rows(regular_bytes(path))))
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{path}: is missing or damaged ({error}): run the same command again, which writes "
            "it again"
        ) from error


def _row(cells: dict[str, str]) -> FrameRow:
    status: Any = cells["status"]
    if status not in get_args(Status):
        raise ValueError(f"a status of {printable(status[:20])!r}")
    return FrameRow(
        name=cells["name"],
        status=status,
        left=cells["left"],
        right=cells["right"],
        timestamp_s=float(cells["timestamp_s"]) if cells["timestamp_s"] else None,
        error=cells["error"],
    )


def _with_numbers(row: FrameRow, cells: dict[str, str], stages: Sequence[str]) -> FrameRow:
    numbers = {key: float(value) for key, value in cells.items() if key not in _TEXTS and value}
    seconds = {stage: numbers.pop(f"{stage}_s") for stage in stages if f"{stage}_s" in numbers}
    warnings = tuple(text for text in cells["warnings"].split(BETWEEN) if text)
    return replace(
        row, warnings=warnings, kept=cells["kept"] == "1", seconds=seconds, facts=numbers
    )


def with_residuals(content: bytes, points: Sequence[TrackPoint]) -> bytes:
    """Replace the residuals of given poses, the last columns of frames.csv, by those of ``points``;
    none without given poses.

    Raises ValueError for a table that is damaged.
    """
    residuals = {
        point.name: (point.position_residual_m, point.attitude_residual_deg) for point in points
    }
    kept = [
        name
        for name in next(csv.reader([content.decode().partition("\n")[0]]))
        if name not in RESIDUALS
    ]
    given = any(value is not None for values in residuals.values() for value in values)
    rows = (
        [row[name] for name in kept]
        + [
            "" if value is None else f"{value:.4f}"
            for value in (residuals.get(row["name"], (None, None)) if given else ())
        ]
        for row in table_rows(content)
    )
    return _csv_text(chain([[*kept, *(RESIDUALS if given else ())]], rows))


def _csv_text(rows: Iterable[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(
        [guard_formula(printable(cell)) if isinstance(cell, str) else cell for cell in row]
        for row in rows
    )
    return text.getvalue().encode()
