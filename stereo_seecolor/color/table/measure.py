"""Makes the moment table of an image and its range map."""

import numpy as np

from stereo_seecolor.color.table import counting
from stereo_seecolor.color.table.moment_table import VALUE_BINS, MomentTable
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Image, Map


def measure(image: Image, range_m: Map, every: int = 1) -> MomentTable:
    """The moment table of an image's pixels with a known range (finite, above 0).

    image: (H, W, 3) uint8 or uint16. range_m: (H, W) float32 meters.
    every: only the middle one of each ``every`` rows is counted.
    Raises ColorError for other shapes or types.
    """
    check_pair(image, range_m)
    depth = 8 if image.dtype == np.uint8 else 16
    return MomentTable(*counting.count(image, range_m, VALUE_BINS[depth], every), depth)


def check_pair(image: Image, range_m: Map) -> None:
    """Raise ColorError where an image or its range map has a wrong shape or type."""
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype not in (np.uint8, np.uint16):
        raise ColorError(
            f"image of shape {image.shape} and type {image.dtype}: needs (H, W, 3), uint8 or uint16"
        )
    if range_m.shape != image.shape[:2]:
        raise ColorError(
            f"range map of {range_m.shape[1::-1]} pixels for an image of {image.shape[1::-1]}: "
            "the two must be the same size"
        )
