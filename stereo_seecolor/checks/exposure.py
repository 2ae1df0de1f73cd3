"""Frames too badly exposed for their colors: almost black, or clipped by the camera."""

from dataclasses import dataclass
from functools import reduce

import numpy as np

from stereo_seecolor.color.render.display import FULL_AT
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values
from stereo_seecolor.records import Image, Map


@dataclass(frozen=True)
class ExposureLimits:
    """Limits of brightness beyond which a frame gets a warning."""

    dark: float = 0.005
    """Linear light of the brightest channel (16 of 255 in sRGB): noise is a tenth of it."""
    dark_fraction: float = 0.9
    """Fraction of pixels of known range that are darker: open water around a lit object is less."""
    clipped_fraction: float = 0.1
    """Fraction of these pixels that are clipped: highlights and white cards fill less."""
    step_px: int = 4
    """Only every fourth row and column is examined."""


LIMITS = ExposureLimits()


def exposure_warnings(image: Image, range_m: Map, encoding: InputEncoding) -> tuple[str, ...]:
    """A warning for each fault of a frame's exposure, judged where its range is known; empty for a
    good exposure.

    image: (H, W, 3) uint8 or uint16. range_m: (H, W), NaN where unknown.
    """
    small = image[:: LIMITS.step_px, :: LIMITS.step_px]
    brightest = reduce(np.maximum, np.moveaxis(small, 2, 0))[
        np.isfinite(range_m[:: LIMITS.step_px, :: LIMITS.step_px])
    ]
    if not brightest.size:
        return ()
    light = decoded_values(8 * image.dtype.itemsize, encoding)
    if np.quantile(light[brightest], LIMITS.dark_fraction) < LIMITS.dark:
        return ("the frame is almost black: its colors are mostly noise",)
    clipped = float((brightest >= FULL_AT * np.iinfo(image.dtype).max).mean())
    if clipped > LIMITS.clipped_fraction:
        return (
            (
                f"overexposed: {clipped:.0%} of the frame is clipped by the camera, and its color "
                "not recoverable"
            ),
        )
    return ()
