"""Finished runs as others read them: posed frames for exports, frames for a map, and the part of a
shard.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.errors import counted
from stereo_seecolor.compute.interface import Shard
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.geometry import estimated_range_std_m, inverse, pose, rotation_from_quaternion
from stereo_seecolor.records import FrameRow, GeoOrigin, Map, SurveyFrame, Water
from stereo_seecolor.run_folder.dive_files import read_waters
from stereo_seecolor.run_folder.finished_run import (
    FinishedFrame,
    FinishedMap,
    FinishedRun,
    geometry_of,
    open_map,
    open_run,
)
from stereo_seecolor.run_folder.frame_products import MASK_CODES
from stereo_seecolor.run_folder.frames_csv import read_rows
from stereo_seecolor.run_folder.layout import CLOUD, FRAMES_TABLE, MAP, MESH, RIG, WATER
from stereo_seecolor.run_folder.manifest import FrameRecord, Manifest

# The frames of a finished run as a map reads them, one at a time.


class SurveyFrames(Lazy[SurveyFrame]):
    """The current frames of a run, in the dive's order, or those that are given.

    geometry: of the rectified images. T_rectified_left: (4, 4), from the raw left camera's axes.
    range_scale: how many times as long to take their ranges.
    Raises InputError if the run has no calibration, holds no finished frame, or holds frames of two
    settings.
    """

    def __init__(
        self,
        run: FinishedRun,
        range_scale: float = 1.0,
        frames: Sequence[FinishedFrame] | None = None,
    ) -> None:
        geometry, T_rectified_left = geometry_of(run, "a map"), run.T_rectified_left
        assert T_rectified_left is not None
        if run.stale or run.unfinished:
            others = {"of earlier settings": run.stale, "not finished": run.unfinished}
            said = " and ".join(
                f"{len(names)} are {what} ({names[0]})" for what, names in others.items() if names
            )
            raise InputError(
                f"{run.root}: was stopped midway: {len(run.frames)} frames are finished with the "
                f"latest settings, {said}: run the same line again first"
            )
        if not run.frames or any("corrected" not in frame.products for frame in run.frames):
            raise InputError(
                f"{run.root}: holds no frame that went through all stages: run it to its end first"
            )
        self.geometry, self.T_rectified_left = geometry, T_rectified_left
        self._frames, self._range_scale = run.frames if frames is None else frames, range_scale

    @property
    def finished(self) -> Sequence[FinishedFrame]:
        """The finished frames, in order."""
        return self._frames

    def __len__(self) -> int:
        return len(self._frames)

    def item(self, number: int) -> SurveyFrame:
        """Read one frame. Raises FrameError if one of its files is gone or damaged."""
        frame = self._frames[number]
        try:
            return self._read(frame).scaled(self._range_scale)
        except InputError as error:
            raise FrameError(frame.name, str(error)) from error

    def _read(self, frame: FinishedFrame) -> SurveyFrame:
        confidence = self._pixels(frame, "confidence")
        range_m: Map = self._pixels(frame, "range")
        range_m[confidence == 0] = np.nan
        has_std = "range_std" in frame.products
        return SurveyFrame(
            name=frame.name,
            timestamp_s=frame.timestamp_s,
            color=eight_bit(self._pixels(frame, "corrected")),
            range_m=range_m,
            range_std_m=self._pixels(frame, "range_std")
            if has_std
            else estimated_range_std_m(range_m, self.geometry),
            confidence=confidence,
            unrecoverable=self._pixels(frame, "mask") == MASK_CODES["color not recoverable"],
        )

    def _pixels(self, frame: FinishedFrame, product: str) -> NDArray[Any]:
        pixels = frame.read(product)
        if pixels.shape[1::-1] != self.geometry.image_size:
            raise InputError(
                f"{frame.products[product]}: is gone or damaged: run again, which makes it again"
            )
        return pixels


# The input of every export: corrected frames, the camera they share, and its pose for each of
# them.

SOME = 20
"""Frames that tell how large a pixel is."""


@dataclass(frozen=True, eq=False)
class PosedRun:
    """A finished run and the poses of its map's main component.

    geometry: of the corrected images, pinhole without distortion; pixel (0, 0) is the center of the
    top left one.
    frames: those that are in the map. T_map_camera: (N, 4, 4), meters, from the rectified left
    camera (x right, y down, z forward) to the map's own coordinates (z up), which are those of
    cloud.ply and mesh.ply.
    """

    run: FinishedRun
    map: FinishedMap
    geometry: RectifiedPair
    frames: tuple[FinishedFrame, ...]
    T_map_camera: NDArray[np.float64]

    def measured_range_m(self, frame: FinishedFrame) -> Map:
        """Read the measured ranges of a frame, scaled as in the map: (H, W), NaN where there are
        none. Raises InputError.
        """
        return np.float32(self.map.range_scale) * frame.measured_range_m()

    @property
    def survey(self) -> SurveyFrames:
        """The frames with their ranges as the map takes them, each read when asked for. Raises
        InputError.
        """
        return SurveyFrames(self.run, self.map.range_scale, self.frames)

    @property
    def map_folder(self) -> Path:
        """OUT/map."""
        return self.map.folder

    @property
    def offset_m(self) -> NDArray[np.float64]:
        """The offset from the map's own coordinates to its world: (3,), to be added."""
        return np.array(self.map.offset_m, np.float64)

    @property
    def origin(self) -> GeoOrigin | None:
        """The world's origin on Earth, None if unknown."""
        return self.map.origin

    @property
    def voxel_m(self) -> float:
        """Edge of the map's voxels."""
        return self.map.cell_m["voxel_m"]

    @property
    def principal_point_px(self) -> tuple[float, float]:
        """The principal point as most programs count pixels: (0.5, 0.5) is the center of the top
        left one.
        """
        return self.geometry.cx_left_px + 0.5, self.geometry.cy_px + 0.5

    @cached_property
    def pixel_m(self) -> float:
        """Meters a pixel of the images where they see the bottom, median over some frames; NaN
        where nothing was measured.
        """
        some = self.frames[:: -(-len(self.frames) // SOME) or 1]
        depths_m = [self.geometry.depth_from_range(self.measured_range_m(frame)) for frame in some]
        known = [float(np.nanmedian(depth)) for depth in depths_m if np.isfinite(depth).any()]
        return float(np.median(known)) / self.geometry.focal_px if known else float("nan")

    @cached_property
    def T_camera_map(self) -> NDArray[np.float64]:
        """The inverse of T_map_camera: (N, 4, 4)."""
        return inverse(self.T_map_camera)


def spaced(numbers: Iterable[float], digits: int = 12) -> str:
    """Numbers with that many significant digits, in a line."""
    return " ".join(f"{number:.{digits}g}" for number in numbers)


def _poses(path: Path) -> NDArray[np.float64]:
    """The rows (N, 8) of a TUM file of the program's own. Raises OSError; ValueError for damage."""
    lines = path.read_text(encoding="ascii").splitlines()
    rows = np.array([line.split() for line in lines if not line.startswith("#")], np.float64)
    if rows.ndim != 2 or rows.shape[1] != 8 or not np.isfinite(rows).all():
        raise ValueError("trajectory.tum holds no poses, or rows that are none")
    if (np.abs(np.linalg.norm(rows[:, 4:], axis=1) - 1) > QUATERNION_TOLERANCE).any():
        raise ValueError("trajectory.tum holds a quaternion that is not a rotation")
    return rows


QUATERNION_TOLERANCE = 1e-6
"""Of the length of a quaternion that was written with nine digits."""


def open_posed_run(out: Path) -> PosedRun:
    """The run in ``out`` with the poses of its map. Raises InputError if it has no map, or one that
    is damaged.
    """
    run, folder = open_run(out), out / MAP
    made = open_map(out) if all((folder / name).is_file() for name in (CLOUD, MESH)) else None
    if run.geometry is None or made is None:
        raise InputError(
            f"{out}: holds no map with the poses of the frames: make it with "
            f"stereo-seecolor fuse {out}"
        )
    try:
        rows = _poses(folder / "trajectory.tum")
        T = pose(rotation_from_quaternion(rows[:, 4:]), rows[:, 1:4] - np.array(made.offset_m))
    except (OSError, ValueError, IndexError) as error:
        raise InputError(
            f"{folder}: is damaged ({error}): make the map again with stereo-seecolor fuse {out}"
        ) from error
    if len(made.track) != len(T):
        raise InputError(
            f"{folder}: trajectory.tum and poses.csv differ: make the map again with "
            f"stereo-seecolor fuse {out}"
        )
    current = {frame.name: frame for frame in run.frames}
    chosen = [i for i, point in enumerate(made.track) if point.name in current]
    return PosedRun(
        run, made, run.geometry, tuple(current[made.track[i].name] for i in chosen), T[chosen]
    )


# The folder of one shard's results, as ``merge`` reads it.


@dataclass(frozen=True, eq=False)
class Part:
    """A run's folder of some pairs of a dive; made by ``open``. run: the finished run. rows: of
    frames.csv.
    """

    root: Path
    run: FinishedRun
    rows: tuple[FrameRow, ...]

    @classmethod
    def open(cls, root: Path) -> "Part":
        """Read a folder. Raises InputError if it holds no run over stereo pairs, or one that did
        not come to its end.
        """
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
            raise InputError(f"{root}: did not come to its end, {left}: run its line again first")
        return cls(root, run, rows)

    @cached_property
    def shard(self) -> Shard | None:
        """The shard of the dive that was run; None where the run was of all pairs that it was
        given.
        """
        kind = Manifest(self.root).dive().identity.get("kind", "")
        return Shard.parse(kind.partition(" shard ")[2]) if " shard " in kind else None

    @cached_property
    def settings(self) -> str:
        """The hash of the rig and the settings that its range maps were made with."""
        return Manifest(self.root).dive().settings["range"]

    @property
    def ranges_are_wrong(self) -> bool:
        """Tell whether the run's checks found ranges of the dive as a whole wrong."""
        return bool(self.run.totals.get("ranges_are_wrong"))

    @property
    def rig_notes(self) -> tuple[str, ...]:
        """The notes of its run on the calibration."""
        return tuple(note for note in self.run.totals["notes"] if note.startswith("calibration: "))

    @property
    def rig(self) -> Path:
        """The calibration as the run used it."""
        return self.root / RIG

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
