"""What every engine of the matching stage gives."""

from dataclasses import dataclass
from typing import Protocol

from stereo_seecolor.matching.gray import GrayPair
from stereo_seecolor.records import Map, StereoFrame


@dataclass(frozen=True, eq=False)
class MatchedDisparity:
    """disparity: (H, W) pixels of the left image, x_left - x_right, NaN where nothing was found.

    uniqueness: (H, W) how much worse the best disparity beyond +-1 px is, as a fraction of P2; large where no other fits.
    """

    disparity: Map
    uniqueness: Map


class Engine(Protocol):
    """Finds disparities. refined: True where they need no sub-pixel refinement. gray: it looks at the gray images alone."""

    refined: bool

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """The disparities of a rectified pair, from any thread."""


FIXED_UNIQUENESS = 0.5
"""For engines that give none: the median of well matched pixels of the drawn reef."""
