"""The interface of the matching engines, and the disparities that they return."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stereo_seecolor.matching.gray import GrayPair
from stereo_seecolor.records import Map, Mask, StereoFrame

UNKNOWN = np.float32(np.nan)


@dataclass(frozen=True, eq=False)
class MatchedDisparity:
    """Disparities of the left image of a pair.

    disparity: (H, W) float32 pixels, x_left - x_right, NaN where none passes the engine's checks.

    best: (H, W) the same, also where checks failed; NaN without any disparity. The same array as
    disparity if an engine returns only checked disparities.
    uniqueness: (H, W) cost of the best disparity more than 1 px away minus the cost of the best, as
    a fraction of P2; large if no other disparity fits.
    reduced_fraction: fraction of the pixels at reduced size that passed the checks; 0 for an engine
    that does not match at reduced size.
    """

    disparity: Map
    best: Map
    uniqueness: Map
    reduced_fraction: float = 0.0

    def forget(self, where: Mask) -> None:
        """Set all disparities to NaN where ``where`` (H, W) is True."""
        for disparity in (self.disparity, self.best):
            np.copyto(disparity, UNKNOWN, where=where)


class Engine(Protocol):
    """An engine that finds disparities. refined: True if they need no sub-pixel refinement."""

    refined: bool

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """Find the disparities of a rectified pair; safe to call from many threads."""


FIXED_UNIQUENESS = 0.5
"""Uniqueness of engines without one: the median of correct pixels of the synthetic reef."""
