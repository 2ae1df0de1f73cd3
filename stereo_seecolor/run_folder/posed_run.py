"""The input of every export: corrected frames, the camera they share, and its pose for each."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from shlex import quote

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.transforms import inverse, rigid_transform, rotation_from_quaternion
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.whole_files import damaged_map
from stereo_seecolor.records import GeoOrigin, Map
from stereo_seecolor.run_folder.finished_map import FinishedMap, open_map
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun, open_run
from stereo_seecolor.run_folder.layout import CLOUD, MAP, MESH
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

MATCH_PX = 3.0
"""Errors of neighboring pixels are alike over about half a census window."""
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
    def left_out(self) -> str:
        """A note on finished frames that are in other parts of the map, or in none; "" for none."""
        count = len(self.run.frames) - len(self.frames)
        return (
            f"only the map's main part: {count} of {len(self.run.frames)} frames are in other "
            "parts of the map, or in none"
            if count
            else ""
        )

    @property
    def survey(self) -> SurveyFrames:
        """The frames with their ranges as the map takes them, one by one. Raises InputError."""
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
        """The principal point as most programs count: (0.5, 0.5) is the first pixel's center."""
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

    @property
    def correlation_m(self) -> float:
        """Distance on the bottom over which errors of heights are alike."""
        return MATCH_PX * self.pixel_m

    @cached_property
    def T_camera_map(self) -> NDArray[np.float64]:
        """The inverse of T_map_camera: (N, 4, 4)."""
        return inverse(self.T_map_camera)


def _poses(path: Path) -> NDArray[np.float64]:
    """The rows (N, 8) of a TUM file of the program's own. Raises OSError; ValueError for damage."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = np.array([line.split() for line in lines if not line.startswith("#")], np.float64)
    if rows.ndim != 2 or rows.shape[1] != 8 or not np.isfinite(rows).all():
        raise ValueError("trajectory.tum contains no poses, or invalid rows")
    if (np.abs(np.linalg.norm(rows[:, 4:], axis=1) - 1) > QUATERNION_TOLERANCE).any():
        raise ValueError("trajectory.tum holds a quaternion that is not a rotation")
    return rows


QUATERNION_TOLERANCE = 1e-6
"""Of the length of a quaternion that was written with nine digits."""


def open_posed_run(out: Path) -> PosedRun:
    """The run in ``out`` with its map's poses. Raises InputError without an intact map."""
    run, folder = open_run(out), out / MAP
    made = open_map(out) if all((folder / name).is_file() for name in (CLOUD, MESH)) else None
    if run.geometry is None or made is None:
        raise InputError(
            f"{out}: holds no map with the poses of the frames: make it with "
            f"stereo-seecolor fuse {quote(str(out))}"
        )
    try:
        rows = _poses(folder / "trajectory.tum")
        T = rigid_transform(
            rotation_from_quaternion(rows[:, 4:]), rows[:, 1:4] - np.array(made.offset_m)
        )
    except (OSError, ValueError, IndexError) as error:
        raise damaged_map(folder, error) from error
    if len(made.track) != len(T):
        raise damaged_map(folder, "trajectory.tum and poses.csv differ")
    current = {frame.name: frame for frame in run.frames}
    chosen = [i for i, point in enumerate(made.track) if point.name in current]
    return PosedRun(
        run, made, run.geometry, tuple(current[made.track[i].name] for i in chosen), T[chosen]
    )
