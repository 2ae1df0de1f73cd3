"""A folder of one shard's results, as ``merge`` takes it."""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import cast

from calibration.wording import counted
from stereo_seecolor.errors import InputError
from stereo_seecolor.records import FrameRow, Status, Water
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run
from stereo_seecolor.run_folder.layout import FRAMES_TABLE, RIG, WATER
from stereo_seecolor.run_folder.manifest import FrameRecord, Manifest
from stereo_seecolor.run_folder.water_file import read_waters


@dataclass(frozen=True, eq=False)
class Part:
    """A run's folder of some pairs of a dive; made by ``open``. run: its settings and inputs. rows: of frames.csv."""

    root: Path
    run: FinishedRun
    rows: tuple[FrameRow, ...]

    @classmethod
    def open(cls, root: Path) -> "Part":
        """Read a folder. Raises InputError if it holds no run over stereo pairs, or one that did not come to its end."""
        run = open_run(root)
        if run.geometry is None:
            raise InputError(f"{root}: the run knows no camera (made by correct?): only the results of run are merged")
        rows = tuple(read_rows(root / FRAMES_TABLE))
        pending = [row.name for row in rows if row.status == "pending"]
        if pending or run.state != "complete":
            left = f"not done: {counted(len(pending), 'pair')} ({pending[0]})" if pending else f"it is {run.state}"
            raise InputError(f"{root}: did not come to its end, {left}: run its line again first")
        return cls(root, run, rows)

    @cached_property
    def settings(self) -> str:
        """Hash of the rig and the settings that its range maps were made with."""
        return Manifest(self.root).dive().settings["range"]

    @property
    def rig(self) -> Path:
        """The calibration as the run used it."""
        return self.root / RIG

    def frames(self) -> Iterator[FrameRecord]:
        """What is recorded of its finished frames."""
        return Manifest(self.root).frames()

    def waters(self) -> Mapping[str, Water] | None:
        """Name of a finished frame -> its water; None where no water was taken out yet."""
        path = self.root / WATER
        return read_waters(path, [row.name for row in self.rows if row.status == "ok"]) if path.exists() else None


def read_rows(path: Path) -> list[FrameRow]:
    """Name, status, files, time and error of each row of a frames.csv. Raises InputError."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return [_row(row) for row in csv.DictReader(file)]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: cannot be read ({error}): run its line again first") from error


def _row(row: Mapping[str, str]) -> FrameRow:
    time_s = float(row["timestamp_s"]) if row["timestamp_s"] else None
    return FrameRow(row["name"], cast(Status, row["status"]), row["left"], row["right"], time_s, row["error"])
