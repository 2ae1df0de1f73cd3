"""The matching stage: a rectified pair in, its range map out."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.data import Image, Map, Mask, RangeMap, StereoFrame

Gray = NDArray[np.uint8]

UNKNOWN = np.float32(np.nan)
SUBPIXELS = 16
BLOCK = 3
SPECKLE_PIXELS = 100
DISPARITY_STD_PX = 0.25


class Matcher:
    """Range maps of rectified pairs; built once for a run, safe to call from many threads.

    pair: the geometry of the rectified images. seen_left: (H, W) True where the rectified left image shows something.
    """

    def __init__(self, pair: RectifiedPair, config: MatchingConfig, seen_left: Mask | None = None) -> None:
        self._pair = pair
        self._seen_left = seen_left
        limits = pair.disparity_from_depth(np.array([config.min_range_m, config.max_range_m], dtype=np.float32))
        near, far = float(limits[0]), float(limits[1])
        self._lowest = int(np.floor(far))
        width = pair.image_size[0]
        self._count = max(16, -(-(min(int(np.ceil(near)) + 1, width) - self._lowest) // 16) * 16)

    def match(self, frame: StereoFrame) -> RangeMap:
        """The range map of a rectified pair (8 or 16 bit RGB); depends on nothing but that pair."""
        left, right = _gray(frame.left), _gray(frame.right)
        disparity = self._search(left, right)
        back = self._search(right[:, ::-1], left[:, ::-1])[:, ::-1]
        difference = _left_right_difference(disparity, back)
        disparity = np.where(difference <= 1, disparity, UNKNOWN)
        if self._seen_left is not None:
            disparity = np.where(self._seen_left, disparity, UNKNOWN)
        return self._range_map(disparity, difference)

    def _search(self, left: Gray, right: Gray) -> Map:
        pad = max(self._lowest + self._count, 0)
        left, right = (cv2.copyMakeBorder(image, 0, 0, pad, max(-self._lowest, 0), cv2.BORDER_REPLICATE) for image in (left, right))
        sgbm = cv2.StereoSGBM.create(
            minDisparity=self._lowest,
            numDisparities=self._count,
            blockSize=BLOCK,
            P1=8 * BLOCK**2,
            P2=32 * BLOCK**2,
            uniquenessRatio=5,
            speckleWindowSize=SPECKLE_PIXELS,
            speckleRange=1,
            mode=cv2.StereoSGBM_MODE_SGBM_3WAY,
        )
        fixed = sgbm.compute(left, right)[:, pad : pad + self._pair.image_size[0]]
        return np.where(fixed >= self._lowest * SUBPIXELS, fixed / np.float32(SUBPIXELS), UNKNOWN).astype(np.float32)

    def _range_map(self, disparity: Map, difference: Map) -> RangeMap:
        pair = self._pair
        depth_m = pair.depth_from_disparity(disparity)
        range_m = pair.range_from_depth(depth_m)
        known = np.isfinite(range_m)
        confidence = np.where(known, np.exp(-np.where(known, difference, 0)), 0).astype(np.float32)
        std = range_m * depth_m * np.float32(DISPARITY_STD_PX / (pair.focal_px * pair.baseline_m))
        return RangeMap(
            disparity=np.where(known, disparity, UNKNOWN),
            depth_m=depth_m,
            range_m=range_m,
            range_std_m=std,
            confidence=confidence,
            filled=np.zeros(known.shape, dtype=np.bool_),
        )


def _gray(image: Image) -> Gray:
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    gray: Gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return gray


def _left_right_difference(left: Map, right: Map) -> Map:
    """|d_left(x) - d_right(x - d_left)| in pixels; inf where either is unknown."""
    width = left.shape[1]
    known = np.isfinite(left)
    target = np.rint(np.arange(width) - np.where(known, left, 0)).astype(np.intp)
    inside = known & (target >= 0) & (target < width)
    met = np.take_along_axis(right, np.clip(target, 0, width - 1), axis=1)
    difference = np.where(inside & np.isfinite(met), np.abs(left - met), np.inf)
    return difference.astype(np.float32)
