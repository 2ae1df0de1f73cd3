"""The matching stage on a device, as ``matching.matcher`` does it on the processor: from a
rectified pair to its range map.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.device import sgm
from stereo_seecolor.device.memory import Memory
from stereo_seecolor.device.surroundings import (
    fattening,
    judge,
    log_odds,
    refine,
    remove_speckles,
    surroundings,
)
from stereo_seecolor.matching import diagnostics
from stereo_seecolor.matching.confidence import least_odds
from stereo_seecolor.matching.gray import SMOOTHING_PX
from stereo_seecolor.matching.interpolation import fill
from stereo_seecolor.matching.matcher import SPECKLE_PX, Matcher
from stereo_seecolor.matching.refine import error_factor
from stereo_seecolor.matching.sgm.search import Band, bands
from stereo_seecolor.records import Map, Mask, RangeMap, StereoFrame


class DeviceRanges(NamedTuple):
    """The maps of a RangeMap on a device, (H, W) each."""

    disparity: Tensor
    depth_m: Tensor
    range_m: Tensor
    range_std_m: Tensor
    confidence: Tensor
    filled: Tensor


class DeviceMatcher(Matcher):
    """A Matcher whose pixels stay on a device: gray, search, refinement, confidence, ranges.

    The processor gets the reduced images, for the search's bands and for the warnings. Engines
    other than ``sgm`` run as usual.
    """

    def __init__(
        self,
        memory: Memory,
        pair: RectifiedPair,
        config: MatchingConfig,
        seen_left: Mask | None = None,
    ) -> None:
        super().__init__(pair, config, seen_left)
        self._memory = memory
        self._rays = torch.from_numpy(pair.ray_length).to(memory.device)
        self._seen = None if seen_left is None else torch.from_numpy(seen_left).to(memory.device)

    def matched(self, frame: StereoFrame) -> tuple[RangeMap, float]:
        """As ``Matcher.matched``; the ranges also stay on the device."""
        if self._config.engine != "sgm":
            return super().matched(frame)
        left, right = (gray(self._memory.tensor(image)) for image in (frame.left, frame.right))
        small_left, small_right = (
            shrink(image, self._scale).cpu().numpy().astype(np.uint16) for image in (left, right)
        )
        reason = diagnostics.unusable(small_left, small_right)
        if reason:
            return RangeMap.unknown(
                self._pair.image_size[::-1], f"{reason}: no range is known"
            ), 1.0
        repeating = core_pool().submit(
            diagnostics.repeated, small_left, (self._highest - self._lowest) // self._scale
        )
        found, coarse_fraction = self._search(left, right)
        vertical_px = diagnostics.vertical_px_of(
            _row_costs(left, right, found.disparity, diagnostics.VERTICAL_SEARCH_PX)
        )
        repeated = repeating.result()
        found = self._kept(found, repeated | diagnostics.blank(small_left))
        detail = (
            float(found.disparity.isfinite().float().mean()) / coarse_fraction
            if coarse_fraction
            else 1.0
        )
        range_map = self._on_processor(self.ranges(found, left, right))
        warnings = self._warnings(small_left, range_map, repeated, vertical_px)
        sharpness = diagnostics.right_sharpness(
            left.cpu().numpy(), right.cpu().numpy(), range_map.disparity
        )
        found_ranges = replace(
            range_map,
            right_sharpness=sharpness,
            vertical_px=vertical_px,
            rows_are_off=diagnostics.rows_are_off(vertical_px),
            warnings=warnings,
        )
        return found_ranges, detail

    def _search(self, left: Tensor, right: Tensor) -> tuple[sgm.FoundDisparities, float]:
        """The search at reduced size, then in bands around it; and the fraction known there."""
        lowest, highest = self._lowest // self._scale, -(-self._highest // self._scale)
        small_left, small_right = (shrink(image, self._scale) for image in (left, right))
        everywhere = Band.everywhere((small_left.shape[0], small_left.shape[1]), lowest, highest)
        coarse: Map = sgm.search(small_left, small_right, everywhere).disparity.cpu().numpy()
        shape = left.shape[0], left.shape[1]
        return sgm.search(
            left, right, bands(coarse, self._scale, shape, self._lowest, self._highest)
        ), float(np.isfinite(coarse).mean())

    def _kept(
        self, matched: sgm.FoundDisparities, no_match: NDArray[np.bool_]
    ) -> sgm.FoundDisparities:
        """What was found without speckles and what cannot be matched or seen."""
        height, width = matched.disparity.shape
        forgotten = torch.from_numpy(no_match).to(matched.disparity.device)
        forgotten = forgotten.repeat_interleave(self._scale, 0).repeat_interleave(self._scale, 1)[
            :height, :width
        ]
        disparity = remove_speckles(matched.disparity.masked_fill(forgotten, torch.nan), SPECKLE_PX)
        best = matched.best.masked_fill(forgotten, torch.nan)
        if self._seen is None:
            return matched._replace(disparity=disparity, best=best)
        return matched._replace(
            disparity=disparity.where(self._seen, torch.nan), best=best.where(self._seen, torch.nan)
        )

    def ranges(self, matched: sgm.FoundDisparities, left: Tensor, right: Tensor) -> DeviceRanges:
        """Refine disparities, judge and triangulate them, as ``Matcher.range_map``."""
        refined, around = (
            refine(left, right, matched.disparity, matched.best),
            surroundings(matched.disparity, matched.best, left),
        )
        odds = log_odds(matched.uniqueness, refined, around)
        least = self._config.min_confidence
        fat = fattening(matched.best, left, around, odds, least_odds(least))
        disparity, confidence = judge(odds, fat, refined.disparity, least)
        left_gray, right_gray = (image.cpu().numpy().astype(np.uint16) for image in (left, right))
        std = refined.std * error_factor(left_gray, right_gray, disparity.cpu().numpy())
        filled = torch.zeros_like(disparity, dtype=torch.bool)
        if self._config.fill:
            whole = torch.from_numpy(fill(disparity.cpu().numpy())).to(disparity.device)
            whole = whole if self._seen is None else whole.where(self._seen, torch.nan)
            disparity, filled = whole, disparity.isnan() & whole.isfinite()
        return self._triangulated(disparity, confidence, std, filled)

    def _triangulated(
        self, disparity: Tensor, confidence: Tensor, std: Tensor, filled: Tensor
    ) -> DeviceRanges:
        """As ``matching.triangulation``. std: standard error of the disparity, pixels."""
        pair, scale = self._pair, self._pair.focal_px * self._pair.baseline_m
        shifted = disparity - (pair.cx_left_px - pair.cx_right_px)
        depth_m = scale / shifted
        range_m = depth_m * self._rays
        known = (
            (shifted > 0)
            & (range_m >= self._config.min_range_m)
            & (range_m <= self._config.max_range_m)
        )
        depth_m, range_m, disparity = (
            part.where(known, torch.nan) for part in (depth_m, range_m, disparity)
        )
        measured = known & ~filled
        std_m = range_m * depth_m * std.where(measured, torch.nan) / scale
        return DeviceRanges(
            disparity, depth_m, range_m, std_m, confidence.where(measured, 0), filled & known
        )

    def _on_processor(self, maps: DeviceRanges) -> RangeMap:
        disparity, depth_m, range_m, range_std_m, confidence, filled = (
            self._memory.array(part) for part in maps
        )
        return RangeMap(disparity, depth_m, range_m, range_std_m, confidence, filled)


def gray(image: Tensor) -> Tensor:
    """(H, W) float32 blurred luma of an (H, W, 3) image of 8 or 16 bits, as ``matching.gray.gray``:
    whole numbers 0..65535.
    """
    full = 1 / 256 if image.dtype == torch.uint16 else 1.0
    red, green, blue = image.to(torch.float32).unbind(2)
    luma = 77 * full * red + 150 * full * green + 29 * full * blue
    outer, near, center = (
        float(w) for w in cv2.getGaussianKernel(5, SMOOTHING_PX, cv2.CV_32F)[:3, 0]
    )
    rows = F.pad(luma[None, None], (2, 2, 2, 2), mode="replicate")[0, 0]
    height, width = luma.shape
    a, b, c, d, e = (rows[:, k : k + width] for k in range(5))
    rows = center * c + near * (b + d) + outer * (a + e)
    a, b, c, d, e = (rows[k : k + height] for k in range(5))
    return (center * c + near * (b + d) + outer * (a + e) + 0.5).floor()


def shrink(image: Tensor, scale: int) -> Tensor:
    """As ``matching.gray.shrink``."""
    height, width = image.shape
    whole = F.pad(image[None, None], (0, -width % scale, 0, -height % scale), mode="replicate")
    return F.avg_pool2d(whole, scale)[0, 0].round()


def _row_costs(left: Tensor, right: Tensor, disparity: Tensor, most: int) -> NDArray[np.float64]:
    """As ``diagnostics._row_costs``."""
    height, width = disparity.shape
    rows = torch.arange(most, max(height - most, most), 16, device=left.device)[:, None]
    columns = torch.arange(0, width, 16, device=left.device)
    d = disparity[rows, columns]
    met = (columns - d.nan_to_num().round().to(torch.int64)).clamp(0, width - 1)
    here, there = sgm.census(left)[rows, columns], sgm.census(right)
    costs = [
        sgm.bits_in(here ^ there[rows + by, met]).where(d.isfinite(), 0).sum()
        for by in range(-most, most + 1)
    ]
    return torch.stack(costs).cpu().numpy().astype(np.float64)
