"""frames.csv: a row for each pair and each file without a partner; nothing is left out."""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from stereo_seecolor.compute.names import Names
from stereo_seecolor.compute.packed import Packed
from stereo_seecolor.errors import InputError, printable
from stereo_seecolor.records import FrameRow, Status
from stereo_seecolor.run_folder.finished_map import TrackPoint
from stereo_seecolor.run_folder.kept_plan import Compared

RESIDUALS = ("position_residual_m", "attitude_residual_deg")
"""Columns of frames.csv that a map with given poses adds."""
_PATH = re.compile(r"^\S*/.*?: ")
_NUMBER = re.compile(r"[-+]?\d[\d.]*")


_TEXTS = frozenset({"name", "status", "kept", "left", "right", "timestamp_s", "error", "warnings"})
"""Columns that hold no number of the frame's facts or seconds."""


class FrameTable:
    """A dive's rows in the order they came."""

    def __init__(self) -> None:
        self._rows: Packed[FrameRow] = Packed()
        self._names = Names()

    def add(self, row: FrameRow) -> None:
        """The row of a pair, which its name tells from the others; or what a later stage has to say of it."""
        place = self._names.add(row.name)
        if place == len(self._rows):
            self._rows.append(row)
        else:
            self._rows.replace(place, self._rows[place].then(row))

    @property
    def rows(self) -> Sequence[FrameRow]:
        """All rows."""
        return self._rows

    def row(self, name: str) -> FrameRow | None:
        """What is known of a pair; None where nothing is."""
        place = self._names.number(name)
        return None if place is None else self._rows[place]


@dataclass(frozen=True)
class ProductSummary:
    """A product in OUT. path: where. what: what it holds. source: whether this run wrote it."""

    path: Path
    what: str
    source: Literal["written", "kept from an earlier run", "partly kept from an earlier run"]


@dataclass(frozen=True)
class RunSummary:
    """The end of a run.

    notes: what concerns the whole dive. wall_seconds: from start to end. stopped: it was interrupted. products: what is current.
    plan: what was planned, and what it took, where a plan of these pairs and settings lay in OUT.
    """

    rows: Sequence[FrameRow]
    notes: tuple[str, ...] = ()
    wall_seconds: float = 0.0
    stopped: bool = False
    products: tuple[ProductSummary, ...] = ()
    plan: Compared | None = None

    @property
    def all_done(self) -> bool:
        """True if every file found its partner and every pair went through."""
        return not self.stopped and all(row.status == "ok" for row in self.rows)

    def count(self, status: Status) -> int:
        """Rows of that status."""
        return sum(row.status == status for row in self.rows)

    @property
    def kept(self) -> int:
        """Pairs that an earlier run had finished."""
        return sum(row.kept for row in self.rows)

    def totals(self) -> dict[str, Any]:
        """The numbers that a script wants, as JSON holds them."""
        return {
            "pairs": self.count("ok") + self.count("failed"),
            "ok": self.count("ok"),
            "failed": self.count("failed"),
            "unpaired_files": self.count("unpaired"),
            "pending": self.count("pending"),
            "kept": self.kept,
            "stopped": self.stopped,
            "wall_seconds": round(self.wall_seconds, 3),
            "stage_seconds": {stage: round(seconds, 3) for stage, seconds in self.stage_seconds().items()},
            "notes": list(self.notes),
            **({"plan": asdict(self.plan)} if self.plan else {}),
        }

    def problems(self) -> list[tuple[str, int, str]]:
        """(what, how often, first name) of errors and warnings, the most frequent first; those that differ in numbers are one."""
        return [(problem.what, len(problem.names), problem.names[0]) for problem in problems_of(self.rows)]

    def stage_seconds(self) -> dict[str, float]:
        """Seconds a stage over all pairs, the slowest first."""
        total: Counter[str] = Counter()
        for row in self.rows:
            total.update(row.seconds)
        return dict(total.most_common())


@dataclass(frozen=True)
class Problem:
    """A kind of error or warning. what: its text, as it came first. names: of the frames that have it, in order."""

    what: str
    names: tuple[str, ...]


def problems_of(rows: Sequence[FrameRow]) -> list[Problem]:
    """Kinds of errors and warnings, the most frequent first; those that differ in numbers are one kind."""
    seen: dict[str, tuple[str, list[str]]] = {}
    for row in rows:
        for text in (*((row.error,) if row.error else ()), *row.warnings):
            what = _PATH.sub("", text).removeprefix(f"{row.name}: ")
            seen.setdefault(_NUMBER.sub("", what), (what, []))[1].append(row.name)
    return sorted((Problem(what, tuple(names)) for what, names in seen.values()), key=lambda problem: -len(problem.names))


def frames_csv(rows: Sequence[FrameRow]) -> Iterator[bytes]:
    """The rows as lines of UTF-8 CSV, columns in a fixed order, one ``<stage>_s`` column a stage."""
    facts = sorted({key for row in rows for key in row.facts})
    stages = sorted({key for row in rows for key in row.seconds})
    columns = ["name", "status", "kept", "left", "right", "timestamp_s", "error", "warnings"]
    yield _csv_line([*columns, *facts, *(f"{stage}_s" for stage in stages)])
    for row in rows:
        yield _csv_line(
            [row.name, row.status, int(row.kept), row.left, row.right, "" if row.timestamp_s is None else f"{row.timestamp_s:.9f}"]
            + [row.error, "; ".join(row.warnings)]
            + [f"{row.facts[key]:.6g}" if key in row.facts else "" for key in facts]
            + [f"{row.seconds[stage]:.4f}" if stage in row.seconds else "" for stage in stages]
        )


def read_frames(path: Path, stages: Sequence[str]) -> tuple[FrameRow, ...]:
    """The rows of a frames.csv. stages: those whose seconds it holds. Raises InputError if it is gone or damaged."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return tuple(_row(cells, stages) for cells in csv.DictReader(file))
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: is gone or damaged ({error}): run the same line again, which writes it again") from error


def _row(cells: dict[str, str], stages: Sequence[str]) -> FrameRow:
    numbers = {key: float(value) for key, value in cells.items() if key not in _TEXTS and value}
    seconds = {stage: numbers.pop(f"{stage}_s") for stage in stages if f"{stage}_s" in numbers}
    status: Any = cells["status"]
    return FrameRow(
        name=cells["name"],
        status=status,
        left=cells["left"],
        right=cells["right"],
        timestamp_s=float(cells["timestamp_s"]) if cells["timestamp_s"] else None,
        error=cells["error"],
        warnings=tuple(text for text in cells["warnings"].split("; ") if text),
        kept=cells["kept"] == "1",
        seconds=seconds,
        facts=numbers,
    )


def with_residuals(content: bytes, points: Sequence[TrackPoint]) -> bytes:
    """frames.csv with how far each given pose is from what the pictures show as last columns; without, where none was given."""
    residuals = {point.name: (point.position_residual_m, point.attitude_residual_deg) for point in points}
    header, *rows = csv.reader(io.StringIO(content.decode(), newline=""))
    kept = [i for i, name in enumerate(header) if name not in RESIDUALS]
    given = any(value is not None for values in residuals.values() for value in values)
    lines = [_csv_line([header[i] for i in kept] + [*(RESIDUALS if given else ())])]
    for row in rows:
        values = residuals.get(row[0], (None, None)) if given else ()
        lines.append(_csv_line([row[i] for i in kept] + ["" if value is None else f"{value:.4f}" for value in values]))
    return b"".join(lines)


def _csv_line(cells: Sequence[object]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(printable(cell) if isinstance(cell, str) else cell for cell in cells)
    return text.getvalue().encode()
