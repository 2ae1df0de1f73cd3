"""Encoded image values <-> linear light, in which the model of the water holds."""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.range_bins import bin_values
from stereo_seecolor.files import srgb

InputEncoding = Literal["srgb", "linear", "as-is"]


def decode(values: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """Convert encoded fractions of full scale to linear light; only srgb changes them."""
    return srgb.decode_srgb(values) if encoding == "srgb" else values


def encode(light: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """Convert linear light to values of a file: sRGB, as people view it; or as-is."""
    return light if encoding == "as-is" else srgb.encode_srgb(light)


def decoding_slope(light: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """Compute d light / d value of sRGB at this light, which converts noise of values to light.

    It is also used for linear files, as sensor noise grows with light there, too; 1 for as-is.
    """
    return srgb.decoding_slope(light) if encoding != "as-is" else np.ones_like(light)


@lru_cache
def decoded_bins(bit_depth: int, encoding: InputEncoding) -> NDArray[np.float64]:
    """Return the linear light (V,) of each value bin of a moment table."""
    return decode(bin_values(bit_depth), encoding)


@lru_cache
def decoded_values(bit_depth: int, encoding: InputEncoding) -> NDArray[np.float32]:
    """Return the linear light, (256,) or (65536,), of each value of an image."""
    full = 2**bit_depth - 1
    return decode(np.arange(full + 1) / full, encoding).astype(np.float32)
