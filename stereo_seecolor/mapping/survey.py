"""The survey that all stages of a map share, and the placement of its frames."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.geometry import transformed
from stereo_seecolor.mapping.frame_index import FrameIndex, Progress, silent
from stereo_seecolor.mapping.kept_frames import Frames, ScaledFrames, Unplaced


@dataclass(frozen=True, eq=False)
class Survey:
    """Frames, the rectified geometry that they share, their index, what receives the progress, and
    where the work runs.

    scratch: a folder for features, which are used again if they were found in the same frames; None
    for one that is deleted.
    """

    frames: Frames
    geometry: RectifiedPair
    index: FrameIndex
    progress: Progress = silent
    compute: Compute = field(default_factory=lambda: Threads(1))
    scratch: Path | None = None

    def scaled(self, scale: float) -> "Survey":
        """Scale all ranges by a factor."""
        return replace(
            self, frames=ScaledFrames(self.frames, scale), index=self.index.scaled(scale)
        )


@dataclass(frozen=True, eq=False)
class Placement:
    """Poses of a survey's N frames.

    T_world_camera: (N, 4, 4), NaN for a frame without a place. components: (N,) int, -1 for those;
    frames of two components have no reliable place relative to each other. unplaced: those frames
    by name. warnings: what a person should know.
    position_std_m, attitude_std_deg: (N,) standard errors, all axes together, NaN where unknown;
    None where none was estimated.
    """

    T_world_camera: NDArray[np.float64]
    components: NDArray[np.int64]
    unplaced: tuple[Unplaced, ...] = ()
    warnings: tuple[str, ...] = ()
    position_std_m: NDArray[np.float64] | None = None
    attitude_std_deg: NDArray[np.float64] | None = None

    @property
    def sizes(self) -> tuple[int, ...]:
        """Frames in each component, component 0, the largest, first."""
        return tuple(np.bincount(self.components[self.components >= 0]).tolist())

    def frames_of(self, component: int) -> NDArray[np.int64]:
        """The frames of a component."""
        return np.flatnonzero(self.components == component)

    def with_warnings(self, *warnings: str) -> "Placement":
        """Add warnings."""
        return replace(self, warnings=(*self.warnings, *warnings))


# A connected component of a survey, in local coordinates that single precision can hold.

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
    float32 (UTM). label: added to the messages of progress, "" for a survey in one component.
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
        T[:, :3, 3] -= offset_m
        count = len(placement.sizes)
        return cls(
            survey, frames, T, offset_m, f", component {number + 1} of {count}" if count > 1 else ""
        )

    def points_m(self, frame: int) -> NDArray[np.float64]:
        """The coarse points of a frame in local coordinates: (n, 3)."""
        return transformed(self.T_local_camera[frame], self.survey.index.points_m[frame])

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
