"""The matching stage: a rectified pair in, its range map out."""

from dataclasses import replace

import cv2
import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.matching import diagnostics as inspection
from stereo_seecolor.matching.confidence import trust_rows
from stereo_seecolor.matching.fill import fill
from stereo_seecolor.matching.onnx_engine import Network
from stereo_seecolor.matching.refine import refine_rows
from stereo_seecolor.matching.sgm.band import Band
from stereo_seecolor.matching.sgm.images import Gray, gray, shrink
from stereo_seecolor.matching.sgm.search import LARGE_IMAGE_PX, Found, remove_speckles, search
from stereo_seecolor.matching.triangulation import measure_rows
from stereo_seecolor.records import Mask, RangeMap, StereoFrame

Pair = tuple[Gray, Gray]

UNKNOWN = np.float32(np.nan)
SPECKLE_PX, COARSE_SPECKLE_PX = 100, 10
HOT_STRIP = 128
"""Rows that are refined, judged and measured together while they are in the processor's cache."""
LEFT_RIGHT_PX = 1.0
"""Largest difference between a network's disparity and that of the pixel of the right image that it meets."""
RIVAL_OF_NETWORK = 0.5
"""A network names no rival; this is what matching gives a good pixel."""


class Matcher:
    """Range maps of rectified pairs; built once for a run, safe to call from many threads.

    pair: the geometry of the rectified images. seen_left: (H, W) True where the rectified left image shows something.
    Raises ConfigError or DeviceError for an engine that cannot run.
    """

    def __init__(self, pair: RectifiedPair, config: MatchingConfig, seen_left: Mask | None = None) -> None:
        self._pair = pair
        self._config = config
        self._seen_left = seen_left
        self._network = Network(config.model) if config.engine == "onnx" else None
        width, height = pair.image_size
        nearest_m = config.min_range_m / float(pair.ray_length.max())  # depth, in the corner farthest from the axis
        limits = pair.disparity_from_depth(np.array([config.max_range_m, nearest_m], dtype=np.float32))
        self._lowest = int(np.floor(limits[0]))
        self._highest = max(self._lowest + 1, min(int(np.ceil(limits[1])), width - 1))
        self._scale = 4 if width * height > LARGE_IMAGE_PX else 2

    def match(self, frame: StereoFrame) -> RangeMap:
        """The range map of a rectified pair (8 or 16 bit RGB); depends on nothing but that pair.

        A pair that cannot be matched gives a map without a known pixel and says why in ``warnings``.
        """
        pool = core_pool()
        left, right = pool.map(gray, (frame.left, frame.right))
        small_left, small_right = pool.map(lambda image: shrink(image, self._scale), (left, right))
        small = small_left, small_right
        reason = inspection.unusable(*small)
        if reason:
            return self._unknown(f"{reason}: no range is known")
        if self._network:
            return self._range_map(self._predicted(self._network, frame), (left, right))
        coarse = self._coarse(small)
        repeating = pool.submit(inspection.repeated, small_left, (self._highest - self._lowest) // self._scale)
        band = Band.around(coarse.disparity, self._scale, left.shape, self._lowest, self._highest)
        found, repeated = search(left, right, band), repeating.result()
        self._forget(found, repeated)
        range_map = self._range_map(found, (left, right))
        every = slice(None, None, self._scale), slice(None, None, self._scale)
        measured = np.where(range_map.filled[every], UNKNOWN, range_map.disparity[every])
        told = (
            inspection.repeats(repeated),
            inspection.one_sided(small_left, measured, repeated, self._scale),
            inspection.misaligned(found.row_shift_px),
        )
        return replace(range_map, warnings=tuple(warning for warning in told if warning))

    def _coarse(self, small: Pair) -> Found:
        """The pair at a fraction of its size, searched over all ranges, to learn where the bottom is."""
        low, high = self._lowest // self._scale, -(-self._highest // self._scale)
        coarse = search(small[0], small[1], Band.everywhere(small[0].shape, low, high))
        remove_speckles(coarse.disparity, COARSE_SPECKLE_PX)
        return coarse

    def _forget(self, found: Found, repeated: Mask) -> None:
        """Nothing is known where the (small) image repeats itself."""
        if repeated.any():
            height, width = found.disparity.shape
            found.disparity[repeated.repeat(self._scale, axis=0).repeat(self._scale, axis=1)[:height, :width]] = UNKNOWN

    def _predicted(self, network: Network, frame: StereoFrame) -> Found:
        """A network's disparity, checked as matching's is: against that of the pair mirrored and swapped."""
        disparity = network.disparity(frame.left, frame.right)
        back = network.disparity(frame.right[:, ::-1], frame.left[:, ::-1])[:, ::-1]
        width = disparity.shape[1]
        met = np.rint(np.arange(width, dtype=np.float32) - disparity)
        other = np.take_along_axis(back, np.clip(met, 0, width - 1).astype(np.int64), axis=1)
        agree = (met >= 0) & (met < width) & (np.abs(other - disparity) <= LEFT_RIGHT_PX)
        return Found(np.where(agree, disparity, UNKNOWN), np.full_like(disparity, RIVAL_OF_NETWORK))

    def _range_map(self, found: Found, sharp: Pair) -> RangeMap:
        """Check, refine, judge, and turn into meters, in strips on all cores."""
        pair, checked = self._pair, found.disparity
        remove_speckles(checked, SPECKLE_PX)
        if self._seen_left is not None:
            np.copyto(checked, UNKNOWN, where=~self._seen_left)
        # One block: the allocator then keeps its memory from pair to pair, and the system need not clear it anew.
        disparity, sure, std, depth_m, range_m, range_std_m = np.empty((6, *checked.shape), np.float32)
        filled = np.zeros(checked.shape, np.bool_)
        contrast = [float(cv2.meanStdDev(image[::4, ::4].copy())[1][0, 0]) for image in sharp]
        gain = contrast[0] / max(contrast[1], 1e-6)
        limits_m = self._config.min_range_m, self._config.max_range_m
        strips = [slice(first, min(first + HOT_STRIP, checked.shape[0])) for first in range(0, checked.shape[0], HOT_STRIP)]

        def measure(rows: slice) -> None:
            maps = disparity[rows], sure[rows], std[rows], filled[rows], depth_m[rows], range_m[rows], range_std_m[rows]
            measure_rows(pair, limits_m, rows.start, *maps)

        def judge(rows: slice) -> None:
            support, relief = refine_rows(sharp[0], sharp[1], gain, checked, rows.start, disparity[rows], std[rows])
            if self._network:
                disparity[rows] = checked[rows]
            trust_rows(self._config.min_confidence, found.rival[rows], support, relief, disparity[rows], sure[rows])
            if not self._config.fill:
                measure(rows)

        list(core_pool().map(judge, strips))
        if self._config.fill:
            whole = fill(disparity)
            if self._seen_left is not None:
                whole[~self._seen_left] = UNKNOWN
            filled = np.isnan(disparity) & np.isfinite(whole)
            disparity = whole
            list(core_pool().map(measure, strips))
        return RangeMap(disparity, depth_m, range_m, range_std_m, sure, filled)

    def _unknown(self, warning: str) -> RangeMap:
        width, height = self._pair.image_size
        nothing = np.full((height, width), UNKNOWN)
        none = np.zeros((height, width), np.float32)
        return RangeMap(nothing, nothing, nothing, nothing, none, np.zeros((height, width), np.bool_), (warning,))
