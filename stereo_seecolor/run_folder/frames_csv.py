"""frames.csv, and the table of a run that it holds."""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from calibration.rig_errors import RangeError
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.sequences import Names, Packed, SomeNames
from stereo_seecolor.errors import InputError, printable
from stereo_seecolor.files.contained import regular_bytes
from stereo_seecolor.files.csv_tables import guarded, table_rows
from stereo_seecolor.files.keys import ContentKey
from stereo_seecolor.records import FrameRow, Numbers, Status
from stereo_seecolor.run_folder.cache import Compared
from stereo_seecolor.run_folder.finished_run import TrackPoint
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import PRODUCTS, Stage
from stereo_seecolor.run_folder.manifest import FrameRecord, Manifest, StageRecord

# frames.csv: the rows of a run as a table, written and read.

CHUNK = 500
"""Rows that are written at once."""
RESIDUALS = ("position_residual_m", "attitude_residual_deg")
"""Columns that a map with given poses adds."""
BETWEEN = "; "
"""Stands between the warnings of a frame; a warning's own becomes a comma."""
_TEXTS = frozenset({"name", "status", "kept", "left", "right", "timestamp_s", "error", "warnings"})
"""Columns that hold no number of the frame's facts or seconds."""


def frames_csv(rows: Sequence[FrameRow]) -> Iterator[bytes]:
    """Write the rows as lines of UTF-8 CSV, with columns in a fixed order and one ``<stage>_s``
    column for each stage.
    """
    facts, stages = set[str](), set[str]()
    for row in rows:
        facts.update(row.facts)
        stages.update(row.seconds)
    columns = ["name", "status", "kept", "left", "right", "timestamp_s", "error", "warnings"]
    yield _csv_line([*columns, *sorted(facts), *(f"{stage}_s" for stage in sorted(stages))])
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
    """Read the rows of a frames.csv. stages: those whose seconds it holds. Raises InputError if it
    is gone or damaged.
    """
    return _read(path, lambda cells: _with_numbers(_row(cells), cells, stages))


def read_rows(path: Path) -> tuple[FrameRow, ...]:
    """Read name, status, files, time and error alone of each row of a frames.csv. Raises InputError
    as ``read_frames``.
    """
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
    lines = [_csv_line([*kept, *(RESIDUALS if given else ())])]
    for row in table_rows(content):
        values = residuals.get(row["name"], (None, None)) if given else ()
        lines.append(
            _csv_line(
                [row[name] for name in kept]
                + ["" if value is None else f"{value:.4f}" for value in values]
            )
        )
    return b"".join(lines)


def _csv_line(cells: Sequence[object]) -> bytes:
    return _csv_text([cells])


def _csv_text(rows: Iterable[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(
        [guarded(printable(cell)) if isinstance(cell, str) else cell for cell in row]
        for row in rows
    )
    return text.getvalue().encode()


# The table of a run, with a row for each pair and each file without a partner; its problems, and
# its summary.

_PATH = re.compile(r"^[^\s/]*/.*?: ")
_NUMBER = re.compile(r"[-+]?\d[\d.]*")


class FrameTable:
    """The rows of a dive in the order in which they came. failed: name of a pair that failed ->
    why.
    """

    def __init__(self) -> None:
        self.failed: dict[str, str] = {}
        self._rows: Packed[FrameRow] = Packed()
        self._names = Names()

    def add(self, row: FrameRow) -> None:
        """Add the row of a pair, or extend the row that it has by what a later stage found."""
        if row.status == "failed":
            self.failed[row.name] = row.error
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
        """Find the row of a pair; None where there is none."""
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

    notes: what concerns the whole dive. wall_seconds: from start to end. stopped: it was
    interrupted. products: what is current.
    plan: what was planned, and what it took, where a plan of these pairs and settings lay in OUT.
    missing_shards: of the dive, which were not merged. wrong: numbers of the dive as a whole that
    are wrong, as notes say. ranges: the error of ranges, where the check of the dive measured it.
    """

    rows: Sequence[FrameRow]
    notes: tuple[str, ...] = ()
    wall_seconds: float = 0.0
    stopped: bool = False
    products: tuple[ProductSummary, ...] = ()
    plan: Compared | None = None
    missing_shards: tuple[str, ...] = ()
    wrong: frozenset[Numbers] = frozenset()
    ranges: RangeError | None = None

    @property
    def all_done(self) -> bool:
        """Tell whether every file of the whole dive found its partner, every pair went through, and
        no check found numbers of the dive wrong.
        """
        unfinished = self.stopped or self.missing_shards or self.count("ok") != len(self.rows)
        return not unfinished and not self.wrong

    def count(self, status: Status) -> int:
        """The number of rows of that status."""
        return self._tally.counts[status]

    @property
    def kept(self) -> int:
        """The number of pairs that an earlier run had finished."""
        return self._tally.kept

    @cached_property
    def _tally(self) -> "_Tally":
        """The sums over all rows, in one pass: the rows of a large dive are unpacked one by one."""
        counts, seconds, kept = Counter[str](), Counter[str](), 0
        for row in self.rows:
            counts[row.status] += 1
            seconds.update(row.seconds)
            kept += row.kept
        return _Tally(counts, kept, seconds)

    def totals(self) -> dict[str, Any]:
        """The totals of the run as JSON stores them."""
        return {
            "pairs": self.count("ok") + self.count("failed"),
            "ok": self.count("ok"),
            "failed": self.count("failed"),
            "unpaired_files": self.count("unpaired"),
            "pending": self.count("pending"),
            "kept": self.kept,
            "stopped": self.stopped,
            "wall_seconds": round(self.wall_seconds, 3),
            "stage_seconds": {
                stage: round(seconds, 3) for stage, seconds in self.stage_seconds().items()
            },
            "notes": list(self.notes),
            **{f"{numbers}_are_wrong": True for numbers in sorted(self.wrong)},
            **({"range_error": asdict(self.ranges)} if self.ranges else {}),
            **({"missing_shards": list(self.missing_shards)} if self.missing_shards else {}),
            **({"plan": asdict(self.plan)} if self.plan else {}),
        }

    def problems(self) -> list[tuple[str, int, str]]:
        """List errors and warnings, the most frequent first, as (what, how often, first name);
        those that differ in numbers alone count as one.
        """
        return [
            (problem.what, len(problem.names), problem.names[0])
            for problem in problems_of(self.rows)
        ]

    def stage_seconds(self) -> dict[str, float]:
        """Sum the seconds of each stage over all pairs, the slowest first."""
        return dict(self._tally.seconds.most_common())


@dataclass(frozen=True)
class _Tally:
    """counts: rows of each status. kept: pairs that an earlier run had finished. seconds: of each
    stage, over all rows.
    """

    counts: Counter[str]
    kept: int
    seconds: Counter[str]


@dataclass(frozen=True)
class Problem:
    """A kind of error or warning. what: its text, as it came first. names: of the frames that have
    it, in order.
    """

    what: str
    names: tuple[str, ...]


def problems_of(rows: Sequence[FrameRow]) -> list[Problem]:
    """Group errors and warnings into kinds, the most frequent first; those that differ in numbers
    alone are one kind.
    """
    seen: dict[str, tuple[str, list[str]]] = {}
    for row in rows:
        for text in (*((row.error,) if row.error else ()), *row.warnings):
            what = _PATH.sub("", text).removeprefix(f"{row.name}: ")
            seen.setdefault(_NUMBER.sub("", what), (what, []))[1].append(row.name)
    return sorted(
        (Problem(what, tuple(names)) for what, names in seen.values()),
        key=lambda problem: -len(problem.names),
    )


# The current products of a run, found in one pass over the records of its frames: a dive may have
# a million, on a shared disk.

GROUP = 250
"""Records that are read together: a tenth of a second's work."""


@dataclass(frozen=True)
class CurrentFrames:
    """What is current in OUT.

    done: the frames of the run whose last stage is current. digests: stage -> hash of all frames of
    which it is current (``DiveFiles.digest``). made: product -> number of frames that have a
    current one. written: number of those that this run wrote.
    """

    done: SomeNames
    digests: dict[Stage, str]
    made: Counter[str]
    written: Counter[str]

    @classmethod
    def of(
        cls, folder: RunFolder, names: Names, last: Stage, compute: Compute | None
    ) -> "CurrentFrames":
        """Examine the frames of a run with these names. last: its last stage. compute: reads the
        records; None reads them in this process.
        """
        done, made, written = np.zeros(len(names), np.bool_), Counter[str](), Counter[str]()
        keys: dict[Stage, ContentKey] = {"range": ContentKey(), "corrected": ContentKey()}
        for frame in _records(folder.manifest, compute):
            written_now = folder.frames.written.stages(frame.name)
            for stage, record in frame.stages.items():
                if not folder.dive.record.is_current(frame, stage):
                    continue
                made.update(record.outputs.keys())
                if stage in written_now:
                    written.update(record.outputs.keys())
                if stage in keys:
                    keys[stage].add((frame.name, record.key))
                if stage == last and (number := names.number(frame.name)) is not None:
                    done[number] = True
        return cls(
            SomeNames(names, done), {stage: key.value for stage, key in keys.items()}, made, written
        )


def _records(manifest: Manifest, compute: Compute | None) -> Iterable[FrameRecord]:
    """What matters here of all records, by name."""
    names, read = manifest.names(), _RecordsOf(manifest)
    groups = [names[start : start + GROUP] for start in range(0, len(names), GROUP)]
    return chain.from_iterable(compute.each(read, groups) if compute else map(read, groups))


@dataclass(frozen=True)
class _RecordsOf:
    """The records of some frames: keys, settings and products of their stages."""

    manifest: Manifest

    def __call__(self, names: Sequence[str]) -> list[FrameRecord]:
        found = (self.manifest.frame(name) for name in names)
        return [
            FrameRecord(
                frame.name,
                stages={stage: _without_facts(record) for stage, record in frame.stages.items()},
            )
            for frame in found
            if frame
        ]


def _without_facts(record: StageRecord) -> StageRecord:
    return replace(
        record,
        outputs=dict.fromkeys(record.outputs.keys() & PRODUCTS.keys(), ""),
        facts={},
        warnings=(),
    )
