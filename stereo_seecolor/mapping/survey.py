"""The survey that all stages of a map share, and the placement of its frames."""

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.sequences import Changed
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.mapping.frame_index import FrameIndex, Progress, silent
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced, scaled


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
        frames = Changed(self.frames, partial(scaled, scale=scale))
        return replace(self, frames=frames, index=self.index.scaled(scale))


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
