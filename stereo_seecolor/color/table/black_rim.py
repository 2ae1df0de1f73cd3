"""Detects black rims around an image: the edge of a port or lens hood, or bars of a wide format.

All surfaces of a scene lie behind water with backscatter, so black pixels with a range are not part
of the scene; with a few of them the fit would give no backscatter.
"""

from dataclasses import dataclass
from functools import reduce

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values
from stereo_seecolor.records import Image, Map


@dataclass(frozen=True)
class RimLimits:
    """Limits of a black rim."""

    black: float = 0.0025
    """Linear light of the brightest channel (8 of 255 in sRGB), and at most"""
    of_bright: float = 0.02
    """of the value that nine tenths of pixels do not exceed: an almost black image has no rim."""
    corners: int = 2
    """Least black corners of the image: a shadow seldom fills two."""
    soft: float = 0.04
    """Fraction of the longer side: a blurred port darkens the image so far from a rim,"""
    soft_edge: float = 0.7
    """if the light next to the rim is below this fraction of the light at that distance."""
    hard_px: int = 2
    """Examined rows and columns that are left out at a sharp edge, where pixels show both."""
    looked_at_px: int = 256
    """Rows and columns are subsampled if the longer side has more than twice this number."""
    corner_px: int = 12
    """Size of the area that is examined first, in each corner."""


LIMITS = RimLimits()
CORNERS = ([0, 0, -1, -1], [0, -1, 0, -1])


def without_rim(image: Image, range_m: Map, encoding: InputEncoding) -> Map:
    """Set ranges at a black rim of the image to NaN; return the map itself if there is none.

    image: (H, W, 3) uint8 or uint16. range_m: (H, W) meters.
    """
    if not _may_have_rim(image, encoding):
        return range_m
    step = max(max(image.shape) // LIMITS.looked_at_px, 1)
    light = _brightest(image[::step, ::step], encoding)
    black = light < min(LIMITS.black, LIMITS.of_bright * float(np.quantile(light, 0.9)))
    _, regions = cv2.connectedComponents(black.astype(np.uint8))
    of_corners = regions[CORNERS]
    if np.count_nonzero(of_corners) < LIMITS.corners:
        return range_m
    rim = np.isin(regions, of_corners[of_corners > 0]).astype(np.uint8)
    by_px, small = _edge_px(rim, light), range_m[::step, ::step]
    if by_px == LIMITS.hard_px and not np.isfinite(small[rim > 0]).any():
        return range_m
    rim = _wider(rim, by_px)
    rim[:by_px], rim[-by_px:], rim[:, :by_px], rim[:, -by_px:] = 1, 1, 1, 1
    full = rim.repeat(step, axis=0).repeat(step, axis=1)[: image.shape[0], : image.shape[1]]
    left = np.where(full > 0, np.float32(np.nan), range_m)
    return left if np.isfinite(left).any() else range_m


def _edge_px(rim: NDArray[np.uint8], light: NDArray[np.float32]) -> int:
    """Width of the edge of a rim, pixels. rim: (H, W), 1 where black. light: (H, W)."""
    hard, soft = LIMITS.hard_px, int(np.ceil(LIMITS.soft * max(light.shape)))
    beside, beyond = (
        light[(_wider(rim, by) == 0) & (_wider(rim, by + 1) > 0)] for by in (hard, soft)
    )
    sharp = (
        not beside.size
        or not beyond.size
        or np.median(beside) >= LIMITS.soft_edge * np.median(beyond)
    )
    return hard if sharp else soft


def _wider(rim: NDArray[np.uint8], by_px: int) -> NDArray[np.uint8]:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by_px + 1, 2 * by_px + 1))
    return np.asarray(cv2.dilate(rim, disc), np.uint8)


def _may_have_rim(image: Image, encoding: InputEncoding) -> bool:
    """Whether enough corners are dark for a rim: a quick test that rules out most frames."""
    first, last = slice(LIMITS.corner_px), slice(-LIMITS.corner_px, None)
    corners = (
        _brightest(image[rows, columns], encoding)
        for rows in (first, last)
        for columns in (first, last)
    )
    return (
        sum(bool(corner.size) and float(np.median(corner)) <= LIMITS.black for corner in corners)
        >= LIMITS.corners
    )


def _brightest(image: Image, encoding: InputEncoding) -> NDArray[np.float32]:
    """(H, W) linear light of the brightest channel."""
    values = reduce(np.maximum, (image[..., channel] for channel in range(3)))
    return np.asarray(decoded_values(8 * image.dtype.itemsize, encoding)[values])
