"""The folder of one shard's results, as ``merge`` reads it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from calibration.errors import counted
from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.errors import InputError
from stereo_seecolor.records import FrameRow, Numbers, Water
from stereo_seecolor.run_folder.finished_run import (
    FinishedRun,
    geometry_of,
    open_run,
    wrong_numbers,
)
from stereo_seecolor.run_folder.frames_csv import read_rows
from stereo_seecolor.run_folder.layout import FRAMES_TABLE, RIG, WATER
from stereo_seecolor.run_folder.manifest import FrameRecord, Manifest
from stereo_seecolor.run_folder.water_file import read_waters
from stereo_seecolor.water.model import read_water_document


@dataclass(frozen=True, eq=False)
class Part:
    """A run's folder of some pairs of a dive; made by ``open``. rows: of frames.csv."""

    root: Path
    run: FinishedRun
    rows: tuple[FrameRow, ...]

    @classmethod
    def open(cls, root: Path) -> "Part":
        """Read a folder. Raises InputError if it holds no finished run over stereo pairs."""
        run = open_run(root)
        geometry_of(run, "a merge")
        rows = read_rows(root / FRAMES_TABLE)
        pending = [row.name for row in rows if row.status == "pending"]
        if pending or run.state != "complete":
            left = (
                f"not done: {counted(len(pending), 'pair')} ({pending[0]})"
                if pending
                else f"it is {run.state}"
            )
            raise InputError(
                f"{root}: did not come to its end, {left}: run its command again first"
            )
        return cls(root, run, rows)

    @cached_property
    def shard(self) -> Shard | None:
        """The shard of the dive that was run; None if the run was of all pairs."""
        kind = Manifest(self.root).dive().identity.get("kind", "")
        return Shard.parse(kind.partition(" shard ")[2]) if " shard " in kind else None

    @property
    def of_dive(self) -> int:
        """The number of pairs of the whole dive that it is a shard of."""
        number: int = self.run.totals.get("pairs_of_dive", 0)
        return number

    @cached_property
    def settings(self) -> str:
        """The hash of the rig and the settings that its range maps were made with."""
        return Manifest(self.root).dive().settings["range"]

    @property
    def wrong(self) -> frozenset[Numbers]:
        """The numbers of the dive as a whole that the run's checks found wrong."""
        return wrong_numbers(self.run.totals)

    @property
    def rig_notes(self) -> tuple[str, ...]:
        """The notes of its run on the calibration."""
        return tuple(note for note in self.run.totals["notes"] if note.startswith("calibration: "))

    @property
    def rig(self) -> Path:
        """The calibration as the run used it."""
        return self.root / RIG

    def source(self, path: str) -> Path:
        """An input of its run, as given where it is found so, else from where the run was."""
        given = Path(path)
        return given if given.exists() else self.run.working_directory / given

    @property
    def shared_water(self) -> Mapping[str, object] | None:
        """The water that all its frames were corrected with; None of waters of single frames, and
        where none was taken out yet.
        """
        path = self.root / WATER
        return read_water_document(path).get("water") if path.exists() else None

    def frames(self) -> Iterator[FrameRecord]:
        """Read the records of its finished frames."""
        return Manifest(self.root).frames()

    def waters(self) -> Mapping[str, Water] | None:
        """Read the water of each finished frame by name; None where no water was taken out yet."""
        path = self.root / WATER
        return (
            read_waters(path, [row.name for row in self.rows if row.status == "ok"])
            if path.exists()
            else None
        )
