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

    disparity: (H, W) float32 pixels, x_left - x_right, NaN where nothing was found that passes the
    engine's checks.

    best: (H, W) the same, but also where the checks failed; NaN where nothing was found at all. The
    same array for an engine that gives only what it checked.
    uniqueness: (H, W) how much worse the best disparity beyond +-1 px is, as a fraction of P2;
    large where no other fits.
    reduced_fraction: of the pixels at reduced size, those that passed the checks; 0 for an engine
    that does not look there.
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
    """An engine that finds disparities. refined: True if they need no sub-pixel refinement."""

    refined: bool

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """Find the disparities of a rectified pair; safe to call from many threads."""


FIXED_UNIQUENESS = 0.5
"""Uniqueness for engines that give none: the median of well matched pixels of the synthetic
reef.
"""
