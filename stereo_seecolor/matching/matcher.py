"""The matching stage: a rectified pair in, its range map out."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.data import Map, Mask, RangeMap, StereoFrame
from stereo_seecolor.matching.band import Band
from stereo_seecolor.matching.images import Gray, census, gray, mirrored_census, shrink, smooth
from stereo_seecolor.matching.refine import refine_rows
from stereo_seecolor.matching.semiglobal import compare_rows, match_rows

UNKNOWN = np.float32(np.nan)
P1, P2 = 12, 100
"""What a change of disparity by one, or by more, costs on a path, in bits of the census."""
STRIP, HALO = 128, 16
"""Rows of a strip, and rows beyond its ends in which its vertical paths settle."""
LARGE_IMAGE_PX = 600_000
SPECKLE_PX = 100


@dataclass(frozen=True, eq=False)
class Found:
    """disparity: left, NaN at band edges. rival: lead over the next best, as a share of P2. left_right: |left - right|, px."""

    disparity: Map
    rival: Map
    left_right: Map


class Matcher:
    """Range maps of rectified pairs; built once for a run, safe to call from many threads.

    pair: the geometry of the rectified images. seen_left: (H, W) True where the rectified left image shows something.
    """

    def __init__(self, pair: RectifiedPair, config: MatchingConfig, seen_left: Mask | None = None) -> None:
        self._pair = pair
        self._seen_left = seen_left
        width, height = pair.image_size
        limits = pair.disparity_from_depth(np.array([config.max_range_m, config.min_range_m], dtype=np.float32))
        self._lowest = int(np.floor(limits[0]))
        self._highest = max(self._lowest + 1, min(int(np.ceil(limits[1])), width - 1))
        self._scale = 4 if width * height > LARGE_IMAGE_PX else 2

    def match(self, frame: StereoFrame) -> RangeMap:
        """The range map of a rectified pair (8 or 16 bit RGB); depends on nothing but that pair."""
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return self._match(frame, pool)

    def _match(self, frame: StereoFrame, pool: ThreadPoolExecutor) -> RangeMap:
        left, right = pool.map(gray, (frame.left, frame.right))
        band = self._band(left, right, pool)
        left, right = pool.map(smooth, (left, right))
        found = search(left, right, band, pool)
        disparity = without_speckles(np.where(found.left_right <= 1, found.disparity, UNKNOWN), SPECKLE_PX)
        if self._seen_left is not None:
            disparity = np.where(self._seen_left, disparity, UNKNOWN)
        strips = [(first, min(first + STRIP, disparity.shape[0])) for first in range(0, disparity.shape[0], STRIP)]
        parts = list(pool.map(lambda rows: refine_rows(left, right, disparity, rows), strips))
        refined, std = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
        return self._range_map(refined, std, found)

    def _band(self, left: Gray, right: Gray, pool: ThreadPoolExecutor) -> Band:
        small = [smooth(shrink(image, self._scale), 0.7) for image in (left, right)]
        low, high = self._lowest // self._scale, -(-self._highest // self._scale)
        found = search(small[0], small[1], Band.everywhere(small[0].shape, low, high), pool)
        coarse = without_speckles(np.where(found.left_right <= 1, found.disparity, UNKNOWN), 10)
        return Band.around(coarse, self._scale, left.shape, self._lowest, self._highest)

    def _range_map(self, disparity: Map, std: Map, found: Found) -> RangeMap:
        pair = self._pair
        depth_m = pair.depth_from_disparity(disparity)
        range_m = pair.range_from_depth(depth_m)
        known = np.isfinite(range_m)
        confidence = np.where(known, np.exp(-np.where(known, found.left_right, 0)), 0).astype(np.float32)
        return RangeMap(
            disparity=np.where(known, disparity, UNKNOWN),
            depth_m=depth_m,
            range_m=range_m,
            range_std_m=range_m * depth_m / np.float32(pair.focal_px * pair.baseline_m) * std,
            confidence=confidence,
            filled=np.zeros(known.shape, dtype=np.bool_),
        )


def search(left: Gray, right: Gray, band: Band, pool: ThreadPoolExecutor) -> Found:
    """Match two smoothed images over a band, in strips on the threads of the pool."""
    height, width = left.shape
    before = max(0, -int(band.lowest.min()))
    after = max(0, int((band.lowest + band.count).max()))
    left_census, right_census = census(left), mirrored_census(right, before, after)
    disparity, rival, left_right = (np.empty((height, width), np.float32) for _ in range(3))

    def strip(first: int) -> None:
        end = min(first + STRIP, height)
        rows = (max(0, first - HALO), first, end, min(height, end + HALO))
        match_rows(left_census, right_census, before, band.lowest, band.count, rows, P1, P2, disparity, rival, left_right)
        compare_rows(disparity[first:end], left_right[first:end])

    list(pool.map(strip, range(0, height, STRIP)))
    return Found(disparity, rival, left_right)


def without_speckles(disparity: Map, pixels: int) -> Map:
    """NaN also where fewer than that many connected pixels share a disparity."""
    known = np.isfinite(disparity)
    fixed = np.where(known, disparity * 16, -0x8000).astype(np.int16)
    cv2.filterSpeckles(fixed, -0x8000, pixels, 16)
    return np.where(fixed > -0x8000, disparity, UNKNOWN)
