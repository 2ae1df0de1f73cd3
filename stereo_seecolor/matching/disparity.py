"""What every engine of the matching stage gives."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stereo_seecolor.matching.gray import GrayPair
from stereo_seecolor.records import Map, Mask, StereoFrame

UNKNOWN = np.float32(np.nan)


@dataclass(frozen=True, eq=False)
class MatchedDisparity:
    """disparity: (H, W) pixels of the left image, x_left - x_right, NaN where nothing was found that passes the engine's checks.

    best: (H, W) the same, but also where the checks failed; NaN where nothing was found at all. The same array for an engine
    that gives only what it checked.
    uniqueness: (H, W) how much worse the best disparity beyond +-1 px is, as a fraction of P2; large where no other fits.
    reduced_fraction: of the pixels at reduced size, those that passed the checks; 0 for an engine that does not look there.
    """

    disparity: Map
    best: Map
    uniqueness: Map
    reduced_fraction: float = 0.0

    def forget(self, where: Mask) -> None:
        """Make unknown, checked or not, where ``where`` (H, W) is True."""
        for disparity in (self.disparity, self.best):
            np.copyto(disparity, UNKNOWN, where=where)


class Engine(Protocol):
    """Finds disparities. refined: True where they need no sub-pixel refinement. gray: it looks at the gray images alone."""

    refined: bool

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """The disparities of a rectified pair, from any thread."""


FIXED_UNIQUENESS = 0.5
"""For engines that give none: the median of well matched pixels of the synthetic reef."""
