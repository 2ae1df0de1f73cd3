"""Points of the map and the frames that see them, by projection and measured range."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.transforms import transform_points
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.records import Map
from stereo_seecolor.run_folder.layout import CLOUD
from stereo_seecolor.run_folder.posed_run import PosedRun

MOST_POINTS = 100_000
"""Points that are taken, evenly, from the map's cloud: as many as splat trainers begin with; the
cloud itself is in OUT/map.
"""
SAME_RANGE = 0.02
"""A frame sees a point whose distance differs from the measured range by less than this fraction:
else something stands before.
"""


@dataclass(frozen=True, eq=False)
class ObservedPoints:
    """Points of the map and their observations.

    position: (P, 3) meters, map coordinates. color: (P, 3) uint8. of_frame: for each frame the
    numbers (n,) of the points that it sees, and their pixels (n, 2), with (0, 0) in the center of
    the top left one.
    """

    position: NDArray[np.float64]
    color: NDArray[np.uint8]
    of_frame: tuple[tuple[NDArray[np.int64], NDArray[np.float64]], ...]


def observe(posed: PosedRun) -> ObservedPoints:
    """Points of the cloud that two frames see. Raises InputError for a damaged range map."""
    cloud = read_vertices(posed.map_folder / CLOUD)
    chosen = cloud[:: -(-len(cloud) // MOST_POINTS) or 1]
    position, color = np.asarray(chosen["position"], np.float64), np.asarray(chosen["color"])
    seen = [
        _seen(transform_points(T, position), posed.measured_range_m(frame), posed.geometry)
        for frame, T in zip(posed.frames, posed.T_camera_map, strict=True)
    ]
    times = np.bincount(np.concatenate([numbers for numbers, _ in seen]), minlength=len(position))
    kept = times >= 2
    renumbered = np.cumsum(kept) - 1
    of_frame = tuple(
        (renumbered[numbers[kept[numbers]]], pixels[kept[numbers]]) for numbers, pixels in seen
    )
    return ObservedPoints(position[kept], color[kept], of_frame)


def _seen(
    points: NDArray[np.float64], range_m: Map, geometry: RectifiedPair
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Which of points (P, 3) in the camera's axes a frame sees, and at which pixels."""
    height, width = range_m.shape
    numbers = np.flatnonzero(points[:, 2] > 0)
    pixels = geometry.project(points[numbers])
    inside = ((pixels > -0.5) & (pixels < (width - 0.5, height - 0.5))).all(axis=1)
    numbers, pixels = numbers[inside], pixels[inside]
    column, row = np.clip(np.round(pixels).astype(np.int64), 0, (width - 1, height - 1)).T
    distance_m = np.linalg.norm(points[numbers], axis=1)
    agree = np.abs(range_m[row, column] - distance_m) < SAME_RANGE * distance_m
    return numbers[agree], pixels[agree]
