"""The files that describe a run: run.json and frames.csv."""

import json
import platform
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from calibration import Rectification
from calibration.errors import counted
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.sequences import Lazy, Names, SomeNames
from stereo_seecolor.config import RunConfig
from stereo_seecolor.files.atomic import write_replaceable
from stereo_seecolor.files.json_values import JsonText, Streamed, StreamedList, plain
from stereo_seecolor.files.text_documents import as_record, load_object
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.finished_run import RUN_FORMAT, RUN_VERSION, track_points
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_csv import (
    CurrentFrames,
    FrameTable,
    ProductSummary,
    RunSummary,
    frames_csv,
    with_residuals,
)
from stereo_seecolor.run_folder.layout import (
    DIVE_FILES,
    FRAMES_TABLE,
    INDEX,
    MAP,
    MEASURED_WATER,
    RUN,
    SET_ASIDE,
    WHAT_IS_WHERE,
    Stage,
    progress_file,
)
from stereo_seecolor.version import __version__

LIBRARIES = (
    "numpy",
    "scipy",
    "opencv-contrib-python-headless",
    "torch",
    "numba",
    "open3d",
    "open3d-cpu",
    "gtsam",
)
"""What shapes the numbers."""
NOT_REACHED = "not finished when the run was stopped; run the same line again to go on"


@dataclass(frozen=True)
class RunDescription:
    """The description of a run. inputs: by name. last: the stage after which a pair is done."""

    inputs: Mapping[str, str]
    config: RunConfig
    names: Names
    last: Stage
    rectification: Rectification | None = None
    command_line: Sequence[str] = ()


def write_reports(folder: RunFolder, run: RunDescription, summary: RunSummary) -> None:
    """Write run.json and frames.csv. Raises OutputError."""
    points = track_points(folder.root)
    table = frames_csv(summary.rows)
    rows = with_residuals(b"".join(table), points) if points else table
    described = JsonText(_content(run, summary, folder.dive.record.settings), indent=2)
    folder.dive.write_files({FRAMES_TABLE: rows, RUN: described}, {})


def renew_frames_table(folder: RunFolder) -> None:
    """Renew the residuals in frames.csv from the map; a damaged table is left to a run, which
    writes it. Raises OutputError.
    """
    path = folder.root / FRAMES_TABLE
    with suppress(ValueError, KeyError):
        if path.is_file():
            folder.dive.write(
                FRAMES_TABLE, with_residuals(path.read_bytes(), track_points(folder.root))
            )


def close_run(
    folder: RunFolder, run: RunDescription, complete: bool, compute: Compute
) -> CurrentFrames:
    """End a run. What belongs to no pair of a complete run is moved aside; what was made from
    frames that changed is deleted.

    compute: reads the frames' records; those of a run that was stopped are read here, since its
    cluster may be gone.
    """
    if complete:
        retired = sum(
            folder.frames.remove_stale(name)
            for name in folder.manifest.names()
            if name not in run.names
        )
        if retired:
            gone = f"{counted(retired, 'frame')} of an earlier run, no longer in the dive"
            folder.dive.removed.append(
                f"{gone}: what was made of it is kept in {folder.root / SET_ASIDE}"
            )
    current = CurrentFrames.of(folder, run.names, run.last, compute if complete else None)
    if complete:
        # of workers that were lost; not before, as a new worker looks for the cluster's own file
        folder.owned.remove_leftovers()
        sources = dict.fromkeys((MAP, INDEX), current.digests["corrected"]) | {
            MEASURED_WATER: current.digests["range"]
        }
        made_from = folder.dive.record.made_from
        stale = [
            name
            for name, source in sources.items()
            if made_from.get(name, source) != source and not folder.reads(name)
        ]
        if stale:
            folder.dive.remove(*stale)
    folder.dive.update(replace(folder.dive.record, state="complete" if complete else "stopped"))
    return current


@dataclass(frozen=True, eq=False)
class FinalRows(Lazy[FrameRow]):
    """Rows of all pairs and files: a pair is ok only after its last stage; one that the run did not
    come to is pending.

    table: what is known of the pairs. done: of their names, those whose last stage is current.
    """

    table: FrameTable
    done: SomeNames
    unpaired: Sequence[FrameRow]

    def __len__(self) -> int:
        return len(self.done.names) + len(self.unpaired)

    def __iter__(self) -> Iterator[FrameRow]:
        return map(self.item, range(len(self)))

    def item(self, number: int) -> FrameRow:
        """Make the row of this number."""
        if number >= len(self.done.names):
            return self.unpaired[number - len(self.done.names)]
        name = self.done.names.item(number)
        row = self.table.row(name)
        if row is None:
            return FrameRow(name, "pending", error=NOT_REACHED)
        return (
            row
            if row.status != "ok" or self.done.chosen[number]
            else replace(row, status="pending", error=NOT_REACHED)
        )


def products(folder: RunFolder, current: CurrentFrames) -> tuple[ProductSummary, ...]:
    """List the current products of OUT in the order of a summary, and whether this run wrote
    them.
    """
    files = folder.dive.record.files
    names = {
        name
        for path in files
        for name in (path, path.split("/")[0])
        if (folder.root / name).exists()
    }
    counts = current.made | {name: 1 for name in (*DIVE_FILES, MAP) if name in names}
    written = current.written | {
        name: int(name in folder.dive.written) for name in (*DIVE_FILES, MAP)
    }
    listed = [name for name in WHAT_IS_WHERE if counts.get(name)]
    return tuple(
        ProductSummary(
            folder.root / name, WHAT_IS_WHERE[name], _source(written.get(name, 0), counts[name])
        )
        for name in listed
    )


def _source(written: int, count: int) -> Any:
    if written == count:
        return "written"
    return "partly kept from an earlier run" if written else "kept from an earlier run"


def _content(
    run: RunDescription, summary: RunSummary, settings: Mapping[Stage, str]
) -> dict[str, Any]:
    rectification = run.rectification
    content: dict[str, Any] = plain(
        {
            "format": RUN_FORMAT,
            "format_version": RUN_VERSION,
            "version": __version__,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "command_line": list(run.command_line),
            "working_directory": str(Path.cwd()),
            "host": platform.node(),
            "platform": platform.platform(),
            "libraries": {"python": sys.version.split()[0]}
            | {name: _version(name) for name in LIBRARIES},
            "inputs": {
                **run.inputs,
                "files": Streamed(
                    lambda: ((row.name, row.hashes) for row in summary.rows if row.hashes)
                ),
            },
            "settings": {
                stage: key for stage, key in settings.items() if stage != "page"
            },  # which is made of what this describes
            "config": run.config.model_dump(mode="json"),
            "geometry": asdict(rectification.pair) if rectification else None,
            "T_rectified_left": rectification.T_rectified_left.tolist() if rectification else None,
            "frames": StreamedList(lambda: run.names),
            "totals": summary.totals(),
        }
    )
    return content


@cache
def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:
        return None


# The progress of a run, kept in OUT while it works, for ``status``.

EVERY_S = 2.0
"""Seconds between two writings: often enough for a person who looks on, and nothing beside the
files of a pair.
"""


@dataclass(frozen=True)
class ExpectedPasses:
    """The expected passes of a run. seconds: of one core for each pair, by pass in their order.
    planned: whether ``plan`` measured them on this dive.
    """

    seconds: dict[str, float]
    planned: bool = False

    def of(self, *passes: str) -> "ExpectedPasses":
        """Select these passes."""
        return ExpectedPasses(
            {name: self.seconds[name] for name in passes if name in self.seconds}, self.planned
        )


USUAL = ExpectedPasses({"ranges": 0.19, "light": 0.07, "waters": 0.01, "colors": 0.14})
"""Of pairs of 1280x1024 (docs/fleets.md). Larger pairs take longer, but about the same shares,
which are all that is used of it.
"""


@dataclass(frozen=True)
class Progress:
    """The progress of a pass over a dive. began_s, updated_s: seconds since 1970. failures: reason,
    how often, first frame.

    new: of the pairs that are done, those that no earlier run had done. earlier: passes before this
    one: name, new pairs, seconds.
    """

    stage: str
    total: int
    done: int
    failed: int
    began_s: float
    updated_s: float
    new: int
    earlier: list[tuple[str, int, float]]
    expected: ExpectedPasses
    failures: list[tuple[str, int, str]] = field(default_factory=list)

    @property
    def ends_s(self) -> float | None:
        """The time at which the pass will end at its rate so far, seconds since 1970; None before
        its first pair.
        """
        if not self.done:
            return None
        return self.began_s + (self.updated_s - self.began_s) * self.total / self.done

    @property
    def to_come(self) -> list[str]:
        """The passes after this one."""
        names = list(self.expected.seconds)
        return names[names.index(self.stage) + 1 :] if self.stage in names else []

    @property
    def run_ends_s(self) -> float | None:
        """The time at which the run will end, seconds since 1970, if the passes go on at the pace
        so far relative to what was expected of them.

        None where no pair was done that tells how fast it goes.
        """
        each, so_far = (
            self.expected.seconds,
            [*self.earlier, (self.stage, self.new, self.updated_s - self.began_s)],
        )
        timed = [
            (new * each[name], seconds) for name, new, seconds in so_far if new and name in each
        ]
        expected_s = sum(seconds for seconds, _ in timed)
        if self.stage not in each or not expected_s:
            return None
        pace = sum(seconds for _, seconds in timed) / expected_s
        ends_s = self.ends_s or self.began_s + pace * each[self.stage] * self.total
        return ends_s + pace * self.total * sum(each[name] for name in self.to_come)

    @classmethod
    def load(cls, root: Path) -> "Progress | None":
        """Read the latest progress; None where there is none, or it is damaged."""
        try:
            return as_record(cls, load_object(progress_file(root)))
        except (OSError, ValueError):
            return None


class ProgressFile:
    """A listener that hears of every pair of a pass, and writes the progress every few seconds."""

    def __init__(self, root: Path) -> None:
        self._root, self._expected = root, ExpectedPasses({})
        self._failed: list[FrameRow] = []
        self._earlier: list[tuple[str, int, float]] = []
        self._stage, self._total, self._done, self._new = "", 0, Counter[str](), 0
        self._began_s = self._written_s = 0.0

    def expect(self, passes: ExpectedPasses) -> None:
        """Set the passes to come, unless more are expected already."""
        if not passes.seconds.keys() <= self._expected.seconds.keys():
            self._expected = passes

    def begin(self, stage: str, total: int) -> None:
        """A pass over ``total`` pairs begins. Raises OutputError."""
        now_s = time.time()
        if self._stage:
            self._earlier.append((self._stage, self._new, now_s - self._began_s))
        self._stage, self._total, self._failed, self._done, self._new = (
            stage,
            total,
            [],
            Counter(),
            0,
        )
        self._began_s = now_s
        self._write()

    def advance(self, row: FrameRow) -> None:
        """Count a pair that is through the pass. Raises OutputError."""
        self._done[row.status] += 1
        self._new += not row.kept
        self._failed += [row] if row.status == "failed" else []
        if time.time() - self._written_s >= EVERY_S or self._done.total() == self._total:
            self._write()

    def _write(self) -> None:
        self._written_s = time.time()
        done, failed = self._done.total(), self._done["failed"]
        counts = self._stage, self._total, done, failed, self._began_s, self._written_s, self._new
        progress = Progress(
            *counts, self._earlier, self._expected, RunSummary(self._failed).problems()
        )
        write_replaceable(progress_file(self._root), json.dumps(asdict(progress)).encode())
