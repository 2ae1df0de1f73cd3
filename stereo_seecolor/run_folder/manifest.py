"""The manifest: which files the program wrote into OUT, by frame, and which are current.

A frame's record is written before its files are renamed into place, with the stamps that they will
have: so, whenever the program is killed, each file in a product's place is either known to the
manifest or somebody else's.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import TEMPORARY_PREFIX, write_atomic
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.run_folder.layout import MANIFEST, Stage, record_subfolder, state
from stereo_seecolor.run_folder.own_paths import (
    ForeignPathError,
    check_own_paths,
    check_product_paths,
)
from stereo_seecolor.run_folder.stamp import Stamp

FORMAT, VERSION = "stereo-seecolor/manifest", 2
SPREAD = "spread"
"""Folder of the records of a large dive, which lie in folders in it."""
DEPENDS_ON: dict[Stage, tuple[Stage, ...]] = {
    "range": (),
    "corrected": ("range",),
    "rectified": (),
    "page": ("range", "corrected"),
}


@dataclass(frozen=True)
class StageRecord:
    """A finished stage of a frame.

    key: hash of all that its outputs depend on. settings: hash of the settings alone. water: hash
    of the water taken out.
    outputs: product -> path relative to OUT. facts: columns of frames.csv. warnings: what the stage
    had to say.
    """

    key: str
    settings: str = ""
    water: str = ""
    outputs: dict[str, str] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class InputRecord:
    """An input file as it was read. sha256: hash of its content."""

    path: str
    stamp: Stamp
    sha256: str


@dataclass(frozen=True)
class FrameRecord:
    """The record of a frame.

    inputs: by side. files: path relative to OUT -> the stamps that a file of ours there may have.
    subfolder: folder of its products in the folders of a large dive, "" in those of a small one.
    """

    name: str
    timestamp_s: float | None = None
    inputs: dict[str, InputRecord] = field(default_factory=dict)
    stages: dict[Stage, StageRecord] = field(default_factory=dict)
    files: dict[str, tuple[Stamp, ...]] = field(default_factory=dict)
    subfolder: str = ""

    def with_stage(self, stage: Stage, record: StageRecord) -> "FrameRecord":
        """This frame after a stage; the stages that depend on it are no longer finished."""
        kept = {name: old for name, old in self.stages.items() if stage not in DEPENDS_ON[name]}
        return replace(self, stages={**kept, stage: record})


@dataclass(frozen=True)
class DiveRecord:
    """The record of the whole folder.

    identity: the dive and the kind of command that OUT belongs to. state: running until the run
    ends by itself.
    settings: stage -> hash of the settings of the latest run. waters: frame name -> hash of its
    water ("*" for all frames).
    files: path relative to OUT -> stamps, for files of the whole dive, those of the map among them.
    made_from: path or folder -> hash of the frames that it was made from.
    """

    identity: dict[str, str] = field(default_factory=dict)
    state: Literal["running", "stopped", "complete"] = "running"
    settings: dict[Stage, str] = field(default_factory=dict)
    waters: dict[str, str] = field(default_factory=dict)
    files: dict[str, tuple[Stamp, ...]] = field(default_factory=dict)
    made_from: dict[str, str] = field(default_factory=dict)

    def is_current(self, frame: FrameRecord, stage: Stage) -> bool:
        """Whether a stage of a frame has the settings, and the water, of the latest run."""
        record = frame.stages.get(stage)
        if record is None or record.settings != self.settings.get(stage):
            return False
        if not all(self.is_current(frame, earlier) for earlier in DEPENDS_ON[stage]):
            return False
        return stage != "corrected" or record.water == self.waters.get(
            frame.name, self.waters.get("*")
        )


class Manifest:
    """The manifest of OUT, on disk: one file for the dive and one for each frame."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._dive_file = state(root, MANIFEST)
        self._frames = state(root, "frames")

    def exists(self) -> bool:
        """Tell whether the program wrote into this folder before."""
        return self._dive_file.is_file()

    def dive(self) -> DiveRecord:
        """Read the record of the dive. Raises OutputError if it is damaged, of another version, or
        names what is not in OUT.
        """
        try:
            content = load_object(self._dive_file)
            if (content.pop("format"), content.pop("version")) != (FORMAT, VERSION):
                raise ValueError("another version")
            record = as_record(DiveRecord, content)
            check_own_paths((*record.files, *record.made_from))
        except ForeignPathError as error:
            raise _refused(self._dive_file, error) from error
        except (OSError, ValueError, KeyError) as error:
            raise OutputError(
                f"{self._dive_file}: is damaged or of another version ({error!s:.100}): choose "
                "another --out; nothing was changed"
            ) from error
        return record

    def save_dive(self, record: DiveRecord) -> None:
        """Write the record of the dive. Raises OutputError."""
        write_atomic(
            self._dive_file,
            json.dumps({"format": FORMAT, "version": VERSION, **asdict(record)}).encode(),
        )

    def forget_dive(self) -> None:
        """Delete the record of the dive. Raises OSError."""
        self._dive_file.unlink(missing_ok=True)

    def names(self) -> list[str]:
        """The frames that have a record, sorted, without temporary files of killed processes."""
        found = (self._frames.glob(f"{each}*.json") for each in ("", f"{SPREAD}/*/"))
        files = (path for paths in found for path in paths)
        return sorted({file.stem for file in files if not file.name.startswith(TEMPORARY_PREFIX)})

    def frame(self, name: str) -> FrameRecord | None:
        """Read the record of a frame; None where there is none, or it is damaged (its files are
        then made again).

        Raises OutputError for one that is another frame's, or that names what is not in OUT.
        """
        file = self._known_file(name)
        try:
            record = as_record(FrameRecord, load_object(file))
            if record.name != name:
                raise ForeignPathError(f"it is of a frame {record.name!r}")
            if record.subfolder and not record.subfolder.isdecimal():
                raise ForeignPathError(f"its subfolder is {record.subfolder!r}")
            outputs = (path for one in record.stages.values() for path in one.outputs.values())
            check_product_paths((*record.files, *outputs))
        except ForeignPathError as error:
            raise _refused(file, error) from error
        except (OSError, ValueError):
            return None
        return record

    def frames(self) -> Iterator[FrameRecord]:
        """Read all records that are not damaged, by name."""
        return (frame for name in self.names() if (frame := self.frame(name)))

    def save_frame(self, record: FrameRecord) -> None:
        """Write the record of a frame. Raises OutputError."""
        write_atomic(
            self._frame_file(record.name, record.subfolder), json.dumps(asdict(record)).encode()
        )

    def remove_frame(self, name: str) -> None:
        """Delete the record of a frame whose files were deleted."""
        self._known_file(name).unlink(missing_ok=True)

    def _known_file(self, name: str) -> Path:
        flat = self._frame_file(name, "")
        is_flat = flat.exists() or not (self._frames / SPREAD).is_dir()
        return flat if is_flat else self._frame_file(name, SPREAD)

    def _frame_file(self, name: str, subfolder: str) -> Path:
        folder = self._frames / SPREAD / record_subfolder(name) if subfolder else self._frames
        return folder / f"{name}.json"


def _refused(file: Path, error: ForeignPathError) -> OutputError:
    return OutputError(
        f"{file}: does not have the form that this program writes: {error}; nothing outside this "
        "folder was changed: choose another folder"
    )
