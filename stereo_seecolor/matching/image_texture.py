"""The texture of an image, distinguished from noise: images of open water, even sand and thick haze
have none to match.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.blocks import in_blocks
from stereo_seecolor.matching.gray import LARGE_IMAGE_PX, Gray, gray, shrink
from stereo_seecolor.records import Image, StereoFrame

BLOCK = 32
"""Side of a block, pixels of the reduced image."""
LEAST_RATIO = 0.8
"""Of the amplitude at half the reduced size to that at the reduced size. White noise 0.50 to 0.70;
nine of ten blocks of real reefs, FLSea and Teddy 0.8 and more; a synthetic bottom in haze, of which
a third still matches, 0.85 (median).
"""
STRONG_LEVELS = 4.0
"""Amplitude, reduced, that no noise reaches: 2 with 10 levels of noise a pixel."""
LEAST_LEVELS = 0.3
"""Amplitude at half the reduced size, of 255, that rounding and compression reach: 0.1 to 0.2 in
the water of FLSea's frames; a synthetic bottom in haze 0.15 if hardly a pixel matches, 0.4 if most
do.
"""
LEAST_FRACTION = 0.25
"""Of an image's blocks; real reefs, FLSea and Teddy 0.70 to 1.00, half of them in the dark 0.44;
the water in FLSea's frames 0.00 to 0.20, synthetic open water, even sand and haze 0.00 to 0.19.
"""


def sides_without_texture(frame: StereoFrame) -> tuple[str, ...]:
    """Name the sides ("left", "right") with too little texture for matching."""
    images = (("left", frame.left), ("right", frame.right))
    return tuple(side for side, image in images if textured_fraction(image) < LEAST_FRACTION)


def textured_fraction(image: Image) -> float:
    """The fraction (0..1) of the blocks of an RGB image, 8 or 16 bits deep, that show texture.

    The mean of 2 x 2 pixels halves white noise and preserves texture. Medians exclude drifting
    particles, which are few and bright.
    """
    whole = gray(image)
    small = shrink(whole, 4 if whole.size > LARGE_IMAGE_PX else 2)
    if min(small.shape) < BLOCK:
        return 1.0  # too small to tell
    fine = _amplitude(small, BLOCK)
    coarse = _amplitude(shrink(small, 2), BLOCK // 2)[: fine.shape[0], : fine.shape[1]]
    textured = (coarse > LEAST_RATIO * fine) & (coarse > LEAST_LEVELS) | (fine > STRONG_LEVELS)
    return float(textured.mean())


def _amplitude(image: Gray, block: int) -> NDArray[Any]:
    """Median departure of a block's pixels from the mean of 5 x 5 around them, of 255."""
    departure = cv2.absdiff(image, cv2.blur(image, (5, 5)))
    return np.asarray(np.median(in_blocks(departure, block), axis=(1, 3)) / 256)
