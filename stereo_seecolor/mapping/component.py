"""A connected component of a survey, in local coordinates that single precision can hold."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import transform_points
from stereo_seecolor.mapping.survey import Placement, Survey

NEAR_M = 1000.0
"""Cameras this near the world's origin need no other: float32 resolves 0.06 mm there."""
ORIGIN_STEP_M = 100.0
"""Local origins lie on whole multiples of this, and so do voxels and cells whose size divides it:
repeated surveys share them.
"""


@dataclass(frozen=True, eq=False)
class Component:
    """Frames of a survey that are connected.

    frames: their numbers. T_local_camera: (N, 4, 4) of all of the survey's frames, valid for these.
    offset_m: (3,) of the local coordinates in the world: zero unless the world's are too large for
    float32 (UTM; in z only depths of over a kilometer). label: added to the messages of progress,
    "" for a survey in one component.
    """

    survey: Survey
    frames: NDArray[np.int64]
    T_local_camera: NDArray[np.float64]
    offset_m: NDArray[np.float64]
    label: str = ""

    @classmethod
    def of(cls, survey: Survey, placement: Placement, number: int) -> "Component":
        """Select component ``number`` of a placement."""
        frames = placement.frames_of(number)
        T = placement.T_world_camera.copy()
        positions = T[frames, :3, 3]
        offset_m = np.zeros(3)
        if np.abs(positions).max() > NEAR_M:
            offset_m = np.rint(np.median(positions, axis=0) / ORIGIN_STEP_M) * ORIGIN_STEP_M
            if np.abs(positions[:, 2]).max() <= NEAR_M:
                offset_m[2] = 0.0  # heights in rasters are the world's
        T[:, :3, 3] -= offset_m
        count = len(placement.sizes)
        return cls(
            survey, frames, T, offset_m, f", component {number + 1} of {count}" if count > 1 else ""
        )

    def points_m(self, frame: int) -> NDArray[np.float64]:
        """The coarse points of a frame in local coordinates: (n, 3)."""
        return transform_points(self.T_local_camera[frame], self.survey.index.points_m[frame])

    @cached_property
    def reach_m(self) -> float:
        """The largest local coordinate of any point seen, meters."""
        return max(
            (
                float(np.abs(points).max())
                for i in self.frames
                if len(points := self.points_m(int(i)))
            ),
            default=0.0,
        )
