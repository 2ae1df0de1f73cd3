"""The gray images that are matched: full bit depth, smoothed, at full and reduced size."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.records import Image, StereoFrame

Gray = NDArray[np.uint16]
"""(H, W) uint16 luma, 0..65535; 256 is a gray level of an 8-bit image."""

LARGE_IMAGE_PX = 600_000
"""Larger images are reduced to a quarter, smaller ones to half. In larger ones speckles are removed
at every second pixel, because the filter runs on one core, and patches are larger, too.
"""
SMOOTHING_PX = 0.7
"""Sigma of the blur before the census, which without it would encode noise."""


@dataclass(frozen=True, eq=False)
class GrayPair:
    """The gray images of a rectified pair, and both at 1 / scale of their size."""

    left: Gray
    right: Gray
    small_left: Gray
    small_right: Gray
    scale: int

    @classmethod
    def from_frame(cls, frame: StereoFrame, scale: int) -> "GrayPair":
        """Convert a rectified pair of 8 or 16 bit images."""
        left, right = core_pool().map(gray, (frame.left, frame.right))
        small_left, small_right = core_pool().map(lambda image: shrink(image, scale), (left, right))
        return cls(left, right, small_left, small_right, scale)


def gray(image: Image) -> Gray:
    """Convert an RGB image to blurred luma: (H, W) uint16, 0..65535 at any depth, since in haze the
    signal is finer than one step of 8 bits.
    """
    blurred = np.empty(image.shape[:2], np.uint16)
    outer, near, center = cv2.getGaussianKernel(5, SMOOTHING_PX, cv2.CV_32F)[:3, 0]
    full = np.float32(1 / 256 if image.dtype == np.uint16 else 1)
    _blurred_luma(
        np.ascontiguousarray(image).reshape(image.shape[0], -1),
        full,
        (center, near, outer),
        blurred,
    )
    return blurred


def shrink(image: Gray, scale: int) -> Gray:
    """Reduce an image to 1 / scale, each pixel the mean of scale x scale; incomplete blocks at the
    end are filled up from the border.
    """
    height, width = image.shape
    padded = image
    if height % scale or width % scale:
        padded = cv2.copyMakeBorder(
            image, 0, -height % scale, 0, -width % scale, cv2.BORDER_REPLICATE
        )
    small: Gray = cv2.resize(
        padded, (-(-width // scale), -(-height // scale)), interpolation=cv2.INTER_AREA
    )
    return small


@compiled
def _blurred_luma(pixels: Any, full: Any, weights: tuple[Any, Any, Any], blurred: Gray) -> None:
    """pixels: (H, 3 W), red, green, blue in turn. weights: of the center, and of the first and
    second pixel on each side.
    """
    height, width = blurred.shape
    row, ring = np.empty(width + 4, np.float32), np.empty((5, width), np.float32)
    for y in range(-2, height + 2):
        _luma(pixels[min(max(y, 0), height - 1)], full, row[2 : width + 2])
        row[:2], row[width + 2 :] = row[2], row[width + 1]
        _blur(
            row[2:-2], row[1:-3], row[3:-1], row[:-4], row[4:], weights, np.float32(0), ring[y % 5]
        )
        if y >= 2:
            above, here, below = ring[(y - 3) % 5], ring[(y - 2) % 5], ring[(y - 1) % 5]
            _blur(
                here,
                above,
                below,
                ring[(y - 4) % 5],
                ring[y % 5],
                weights,
                np.float32(0.5),
                blurred[y - 2],
            )


@compiled
def _luma(pixels: Any, full: Any, luma: Any) -> None:
    red, green, blue = np.float32(77) * full, np.float32(150) * full, np.float32(29) * full
    for x in range(luma.size):
        luma[x] = (
            red * np.float32(pixels[3 * x])
            + green * np.float32(pixels[3 * x + 1])
            + blue * np.float32(pixels[3 * x + 2])
        )


@compiled
def _blur(
    center: Any,
    a: Any,
    b: Any,
    c: Any,
    d: Any,
    weights: tuple[Any, Any, Any],
    rounding: Any,
    blurred: Any,
) -> None:
    own, near, outer = weights
    for x in range(blurred.size):
        blurred[x] = own * center[x] + near * (a[x] + b[x]) + outer * (c[x] + d[x]) + rounding
