"""The files that describe a run: run.json and frames.csv."""

import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from calibration import Rectification
from calibration.errors import counted
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.names import Names, SomeNames
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import RUN_FORMAT
from stereo_seecolor.files.json_values import JsonText, Streamed, StreamedList, plain
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.current_frames import CurrentFrames
from stereo_seecolor.run_folder.finished_map import track_points
from stereo_seecolor.run_folder.finished_run import RUN_VERSION
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import FrameTable, ProductSummary, RunSummary
from stereo_seecolor.run_folder.frames_csv import frames_csv, with_residuals
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
NOT_REACHED = "not finished when the run was stopped; run the same command again to continue"


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
    """Renew the residuals in frames.csv from the map, if it is intact. Raises OutputError."""
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
            folder.dive.removed.append(f"{gone}: its results are kept in {folder.root / SET_ASIDE}")
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

    table: the rows of the pairs. done: of their names, those whose last stage is current.
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
        if row.status != "ok" or self.done.chosen[number]:
            return row
        return replace(row, status="pending", error=NOT_REACHED)


def products(folder: RunFolder, current: CurrentFrames) -> tuple[ProductSummary, ...]:
    """The current products of OUT in a summary's order, and whether this run wrote them."""
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
