"""Pixels of the left image that show something before the surface whose range was found: particles
in the water (marine snow), and hot pixels.

Their light is not that of the surface. A thousandth of such pixels is the brightest light of a
frame, which the fit of the water takes for a white surface. The right camera sees the surface there
without them.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from stereo_seecolor.matching.disparity import UNKNOWN
from stereo_seecolor.records import Image, Map, Mask, RangeMap, StereoFrame


@dataclass(frozen=True)
class ParticleLimits:
    """How much brighter than the right image a particle is. Of synthetic marine snow and hot pixels
    97 to 99 % of the pixels are found; in synthetic and real images without them, at most 0.2 % of
    the pixels are taken for particles.
    """

    differences: float = 8.0
    """Mean absolute differences between the images nearby (6.4 deviations of noise), and"""
    of_light: float = 0.15
    """this fraction of the mean value nearby."""
    halo_px: int = 2
    """Width of the blurred rim of a particle,"""
    halo: float = 0.25
    """where at least this fraction of the limit is exceeded."""
    block_px: int = 8
    """Nearby values are averaged over blocks of this size,"""
    nearby: float = 0.1
    """and over a square of this side, fraction of the image width."""


LIMITS = ParticleLimits()


def without_particles(frame: StereoFrame, found: RangeMap, fill: bool) -> RangeMap:
    """Take the ranges of pixels that show a particle out, with confidence and standard error: they
    are those of the surface behind it. fill: they stay, marked as filled in.
    """
    measured = found.confidence > 0
    where = _particles(_gray(frame.left), _gray(frame.right), found.disparity, measured)
    if not where.any():
        return found
    values = found.disparity, found.depth_m, found.range_m, found.range_std_m
    disparity, depth_m, range_m, range_std_m = (np.where(where, UNKNOWN, one) for one in values)
    found = replace(
        found, confidence=np.where(where, np.float32(0), found.confidence), range_std_m=range_std_m
    )
    if fill:
        return replace(found, filled=found.filled | where)
    return replace(found, disparity=disparity, depth_m=depth_m, range_m=range_m)


def _particles(left: Map, right: Map, disparity: Map, measured: Mask) -> Mask:
    """(H, W) the measured pixels where the left image is much brighter than the right one."""
    height, width = disparity.shape
    columns, rows = (np.arange(length, dtype=np.float32) for length in (width, height))
    met = columns - np.where(measured, disparity, np.float32(0))
    across = np.broadcast_to(rows[:, None], met.shape)
    matched = cv2.remap(right, met, np.ascontiguousarray(across), cv2.INTER_LINEAR)
    weight = measured.astype(np.float32)
    blocks = max(width // LIMITS.block_px, 1), max(height // LIMITS.block_px, 1)
    side = 2 * int(0.5 * LIMITS.nearby * blocks[0]) + 1

    def sum_nearby(values: Map) -> Map:
        return np.asarray(
            cv2.blur(
                cv2.resize(values * weight, blocks, interpolation=cv2.INTER_AREA), (side, side)
            ),
            np.float32,
        )

    light = sum_nearby(left)
    # sides differ in exposure and vignetting
    gain = light / np.maximum(sum_nearby(matched), np.float32(1e-3))
    brighter = left - matched * cv2.resize(gain, (width, height))
    usual = LIMITS.differences * sum_nearby(np.abs(brighter))
    pixels = np.maximum(sum_nearby(weight), np.float32(1e-3))
    limit = cv2.resize(np.maximum(usual, LIMITS.of_light * light) / pixels, (width, height))
    sure = ((brighter > limit) & measured).view(np.uint8)
    if not sure.any():
        return np.zeros_like(measured)
    beside = cv2.dilate(sure, np.ones((2 * LIMITS.halo_px + 1,) * 2, np.uint8)) > 0
    return np.asarray(beside & (brighter > LIMITS.halo * limit) & measured)


def _gray(image: Image) -> Map:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.float32)
