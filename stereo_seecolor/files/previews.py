"""Preview pictures of images of any output format, and of ranges, that every browser shows."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.records import Map


@dataclass(frozen=True)
class PreviewSize:
    """The size of a preview. longer_px: longer side, pixels, at most. quality: of the JPEG."""

    longer_px: int
    quality: int


THUMBNAIL = PreviewSize(192, 72)
"""96 CSS pixels wide on a screen of double density; about 4 kB: 5,000 of them are 20 MB."""
SCREEN = PreviewSize(1600, 60)
"""A large screen's width. Enlarged twice it looks like the image: the loss is below the noise."""
LIVE = PreviewSize(480, 72)
"""Three beside each other on a laptop; about 30 kB."""
SMALL = (cv2.IMWRITE_JPEG_OPTIMIZE, 1)
"""A JPEG of the same pixels in 2 % less, for 4 ms of a picture of 1.4 megapixels. Progressive, it
takes another 2 % less, for 12 ms.
"""
RANGE_PX = 960
"""Longer side of a picture of ranges, about: enough for a page."""
NEAR, FAR = 0.02, 0.98
"""Quantiles of ranges with the brightest and the darkest color: single ones do not decide."""


def preview(pixels: NDArray[Any], size: PreviewSize) -> bytes:
    """A JPEG of an image (H, W) or (H, W, 3) RGB; uint8, uint16, or float32 linear light."""
    height, width = pixels.shape[:2]
    scale = size.longer_px / max(height, width)
    if scale < 1:
        smaller = max(1, round(width * scale)), max(1, round(height * scale))
        pixels = np.asarray(cv2.resize(pixels, smaller, interpolation=cv2.INTER_AREA))
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencode(
        ".jpg",
        cv2.cvtColor(eight_bit(pixels), cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_JPEG_QUALITY, size.quality, *SMALL],
    )
    return encoded.tobytes()


def range_picture(range_m: Map) -> tuple[NDArray[np.uint8], float, float]:
    """Draw ranges, near bright, unknown black: (h, w, 3) RGB; with the ranges of its brightest and
    darkest color, meters, NaN if none is known.

    Large maps are shown by every second pixel, or fewer.
    """
    step = max(1, max(range_m.shape) // RANGE_PX)
    small = range_m[::step, ::step]
    known = np.isfinite(small)
    if not known.any():
        return np.zeros((*small.shape, 3), np.uint8), np.nan, np.nan
    near_m, far_m = (float(value) for value in np.quantile(small[known], (NEAR, FAR)))
    scaled = np.clip((far_m - np.where(known, small, far_m)) / max(far_m - near_m, 1e-3), 0, 1)
    colors = (
        cv2.applyColorMap((255 * scaled).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
        * known[..., None]
    )
    return colors.astype(np.uint8), near_m, far_m
