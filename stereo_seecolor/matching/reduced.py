"""Matching at reduced size: for speed, and for images without detail at full size."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.blocks import in_blocks
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.matching.disparity import UNKNOWN
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.records import Image, Mask, RangeMap, StereoFrame

SIZES = (2, 4)
LEAST_DETAIL = 0.88
"""Least number of matched pixels at full size, as a fraction of that at reduced size. Real reef,
Teddy, synthetic scenes, also with much noise: 0.94 to 1.02; the reef enlarged by 2: 0.94 to 0.97
(half size matches 4 to 7 % more), by 4: 0.66 to 0.82 (24 to 40 % more).
"""
LEAST_PIXELS = 1_000_000
"""Least pixels of an image at reduced size. Smaller images lack texture, not size: at half of
450x375 Teddy with noise and half its contrast is 74 % known instead of 49 %, but 10 % of this is
wrong by over two pixels instead of 3 % (at a quarter 19 %).
"""


MakeMatcher = Callable[[RectifiedPair, MatchingConfig, Mask | None], Matcher]
"""Makes the matcher of one size: ``Matcher``, or that of a device."""


class ReducedMatcher:
    """A Matcher on images ``shrink`` times smaller along both axes; each value is repeated over
    shrink x shrink pixels.

    The last pixels of a row or column that do not fill a block are unknown.
    """

    def __init__(
        self,
        pair: RectifiedPair,
        config: MatchingConfig,
        seen_left: Mask | None,
        shrink: int,
        make: MakeMatcher = Matcher,
    ) -> None:
        self._shrink, self._size = shrink, pair.image_size
        seen: Mask | None = (
            None if seen_left is None else np.asarray(in_blocks(seen_left, shrink).all(axis=(1, 3)))
        )
        self._matcher = make(pair.reduced(shrink), config, seen)

    def match(self, frame: StereoFrame) -> RangeMap:
        """Compute the range map of a rectified pair, at the pair's size."""
        return self.enlarged(self.matched(frame)[0])

    def matched(self, frame: StereoFrame) -> tuple[RangeMap, float]:
        """Compute range map and detail, as Matcher.matched does, of the smaller images."""
        small = StereoFrame(
            frame.name, self._smaller(frame.left), self._smaller(frame.right), frame.timestamp_s
        )
        return self._matcher.matched(small)

    def known(self, range_map: RangeMap) -> float:
        """The fraction of full-size pixels with a range in ``range_map``, of ``matched``."""
        width, height = self._size
        return int(np.isfinite(range_map.disparity).sum()) * self._shrink**2 / (width * height)

    def enlarged(self, range_map: RangeMap) -> RangeMap:
        """Enlarge a range map of ``matched`` to the size of the pair."""
        pixels = replace(range_map, disparity=range_map.disparity * np.float32(self._shrink))
        large = pixels.each(self._larger)
        np.nan_to_num(large.confidence, copy=False)
        return replace(large, vertical_px=range_map.vertical_px * self._shrink)

    def _smaller(self, image: Image) -> Image:
        width, height = self._size[0] // self._shrink, self._size[1] // self._shrink
        whole = image[: height * self._shrink, : width * self._shrink]
        small: Image = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
        return small

    def _larger(self, values: NDArray[Any]) -> NDArray[Any]:
        height, width = values.shape
        plain = values.view(np.uint8) if values.dtype == np.bool_ else values
        size = (width * self._shrink, height * self._shrink)
        large = cv2.resize(plain, size, interpolation=cv2.INTER_NEAREST_EXACT).view(values.dtype)
        missing = (0, self._size[1] - size[1]), (0, self._size[0] - size[0])
        unknown = UNKNOWN if values.dtype == np.float32 else 0
        return np.pad(large, missing, constant_values=unknown) if missing != _NOTHING else large


_NOTHING = ((0, 0), (0, 0))


class DetailMatcher:
    """Matches a large pair at half or a quarter of its size if full size shows too little detail.

    Examples: large sensors with soft optics, turbid water, enlarged or strongly compressed images.
    There, noise determines the comparisons of neighboring pixels.
    """

    def __init__(
        self,
        pair: RectifiedPair,
        config: MatchingConfig,
        seen_left: Mask | None = None,
        make: MakeMatcher = Matcher,
    ) -> None:
        self._full = make(pair, config, seen_left)
        width, height = pair.image_size
        self._sizes = tuple(
            shrink for shrink in SIZES if width * height >= LEAST_PIXELS * shrink**2
        )
        self._smaller = partial(ReducedMatcher, pair, config, seen_left, make=make)
        self._built: dict[int, ReducedMatcher] = {}

    def match(self, frame: StereoFrame) -> RangeMap:
        """The range map of a rectified pair; a warning says if the size was reduced."""
        found, detail = self._full.matched(frame)
        if detail >= LEAST_DETAIL or not self._sizes:
            return found
        known = float(np.isfinite(found.disparity).mean())
        # half the memory of a large pair; where no smaller size knows more, which is rare, it is
        # made again
        del found
        return self._at_smaller_size(frame, known) or self._full.match(frame)

    def at(self, shrink: int) -> ReducedMatcher:
        """The matcher at 1 / shrink of the size."""
        if shrink not in self._built:
            self._built[shrink] = self._smaller(shrink)
        return self._built[shrink]

    def _at_smaller_size(self, frame: StereoFrame, known: float) -> RangeMap | None:
        """The range map at a size that knows more than this fraction of the pixels; else None."""
        best: tuple[ReducedMatcher, RangeMap, int] | None = None
        for shrink in self._sizes:
            matcher = self.at(shrink)
            found, detail = matcher.matched(frame)
            if matcher.known(found) <= known:
                break
            best, known = (matcher, found, shrink), matcher.known(found)
            if detail >= LEAST_DETAIL:
                break
        if best is None:
            return None
        matcher, found, shrink = best
        warning = f"the images show little detail at their full size: matched at 1/{shrink} of it"
        return replace(matcher.enlarged(found), warnings=(*found.warnings, warning))
