"""What is matched of an image: its gray values at full depth, smoothed against sensor noise, and their census."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Image

Gray = NDArray[np.uint16]
Census = NDArray[np.uint32]

SMOOTHING_PX = 0.7
"""Sigma of the blur before the census, which compares single pixels: without it noise decides the comparisons."""

EDGE_LEVELS = 5
_REACH = 3
_PATTERN = np.array(
    [(dy, dx) for dy in (-3, -1, 0, 1, 3) for dx in range(-3, 4) if (dy + dx) % 2 == 0 and (dy, dx) != (0, 0)]
    + [(0, 1), (0, -1), (1, 0), (-1, 0)]
)
"""Every other pixel of a window of 7 x 7, and the four neighbors."""


def gray(image: Image) -> Gray:
    """(H, W) luma of an RGB image, blurred, 0..65535 whatever its depth: in haze the signal is finer than one step of 8 bits."""
    blurred = np.empty(image.shape[:2], np.uint16)
    outer, near, center = cv2.getGaussianKernel(5, SMOOTHING_PX, cv2.CV_32F)[:3, 0]
    full = np.float32(1 / 256 if image.dtype == np.uint16 else 1)
    _blurred_luma(np.ascontiguousarray(image).reshape(image.shape[0], -1), full, (center, near, outer), blurred)
    return blurred


def shrink(image: Gray, scale: int) -> Gray:
    """The image at 1 / scale, each pixel the mean of scale x scale; the last ones are filled up from the border."""
    height, width = image.shape
    padded = image
    if height % scale or width % scale:
        padded = cv2.copyMakeBorder(image, 0, -height % scale, 0, -width % scale, cv2.BORDER_REPLICATE)
    small: Gray = cv2.resize(padded, (-(-width // scale), -(-height // scale)), interpolation=cv2.INTER_AREA)
    return small


def census(image: Gray) -> Census:
    """(H, W) a bit for each neighbor that is darker (Zabih and Woodfill 1994): blind to exposure, gain and veiling light."""
    bits = np.empty(image.shape, np.uint32)
    _census(_padded(image), _PATTERN, bits)
    return bits


def mirrored_census(image: Gray, before: int, after: int) -> Census:
    """(H, before + W + after) the census mirrored left to right, between columns of zeros."""
    height, width = image.shape
    bits = np.zeros((height, before + width + after), np.uint32)
    _census(_padded(image), _PATTERN, bits[:, before : before + width][:, ::-1])
    return bits


def jump_costs(image: Gray, full: int, least: int) -> NDArray[np.uint8]:
    """(2, H + 8, W + 9) what a jump of disparity costs from the pixel above, and from the pixel to the left; more to fill tiles.

    Surfaces end where the image changes (Hirschmueller 2008, section 2.3): ``full`` on even ground, half of it where gray
    changes by EDGE_LEVELS, never under ``least``.
    """
    costs = np.full((2, image.shape[0] + 8, image.shape[1] + 9), full, np.uint8)
    _jump_costs(image, np.float32(full), np.float32(least), costs)
    return costs


@compiled
def _jump_costs(image: Gray, full: np.float32, least: np.float32, costs: NDArray[np.uint8]) -> None:
    height, width = image.shape
    scale = np.float32(1 / (256 * EDGE_LEVELS))
    for y in range(height):
        here, above, after = image[y], image[max(y - 1, 0)], image[y, 1:]
        down, right = costs[0, y], costs[1, y, 1:]
        for x in range(width):
            cost = full / (np.float32(1) + abs(np.float32(here[x]) - np.float32(above[x])) * scale)
            down[x] = np.int32(cost if cost > least else least)
        for x in range(width - 1):
            cost = full / (np.float32(1) + abs(np.float32(after[x]) - np.float32(here[x])) * scale)
            right[x] = np.int32(cost if cost > least else least)


def _padded(image: Gray) -> Gray:
    padded: Gray = cv2.copyMakeBorder(image, _REACH, _REACH, _REACH, _REACH, cv2.BORDER_REPLICATE)
    return padded


@compiled
def _blurred_luma(pixels: Any, full: Any, weights: tuple[Any, Any, Any], blurred: Gray) -> None:
    """pixels: (H, 3 W), red, green, blue in turn. weights: of the center, and of the first and second pixel on each side."""
    height, width = blurred.shape
    row, ring = np.empty(width + 4, np.float32), np.empty((5, width), np.float32)
    for y in range(-2, height + 2):
        _luma(pixels[min(max(y, 0), height - 1)], full, row[2 : width + 2])
        row[:2], row[width + 2 :] = row[2], row[width + 1]
        _blur(row[2:-2], row[1:-3], row[3:-1], row[:-4], row[4:], weights, np.float32(0), ring[y % 5])
        if y >= 2:
            above, here, below = ring[(y - 3) % 5], ring[(y - 2) % 5], ring[(y - 1) % 5]
            _blur(here, above, below, ring[(y - 4) % 5], ring[y % 5], weights, np.float32(0.5), blurred[y - 2])


@compiled
def _luma(pixels: Any, full: Any, luma: Any) -> None:
    red, green, blue = np.float32(77) * full, np.float32(150) * full, np.float32(29) * full
    for x in range(luma.size):
        luma[x] = red * np.float32(pixels[3 * x]) + green * np.float32(pixels[3 * x + 1]) + blue * np.float32(pixels[3 * x + 2])


@compiled
def _blur(center: Any, a: Any, b: Any, c: Any, d: Any, weights: tuple[Any, Any, Any], rounding: Any, blurred: Any) -> None:
    own, near, outer = weights
    for x in range(blurred.size):
        blurred[x] = own * center[x] + near * (a[x] + b[x]) + outer * (c[x] + d[x]) + rounding


@compiled
def _census(padded: Gray, pattern: NDArray[np.int64], bits: Census) -> None:
    height, width = bits.shape
    row = np.empty(width, np.uint32)
    for y in range(height):
        row[:] = 0
        center = padded[y + _REACH, _REACH : _REACH + width]
        for i in range(0, pattern.shape[0], 2):
            left, other_left = _REACH + pattern[i, 1], _REACH + pattern[i + 1, 1]
            one = padded[y + _REACH + pattern[i, 0], left : left + width]
            other = padded[y + _REACH + pattern[i + 1, 0], other_left : other_left + width]
            for x in range(width):
                row[x] = (row[x] << np.uint32(2)) | np.uint32(one[x] < center[x]) << np.uint32(1) | np.uint32(other[x] < center[x])
        bits[y] = row
