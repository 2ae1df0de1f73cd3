"""Between the numbers a camera writes and linear light, where the water's physics holds."""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.tables import bin_values

InputEncoding = Literal["srgb", "linear", "as-is"]
NODES = 16384
"""Steps of the encoding curve from 0 to 1: where it is steepest, in the dark, one is a fifth of an 8-bit step."""


def decode(values: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """Encoded shares of full scale -> linear light in [0, 1]; srgb by IEC 61966-2-1, the others unchanged."""
    if encoding != "srgb":
        return values
    return np.asarray(np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4))


def encode(light: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """Linear light in [0, 1] -> what an image file holds: srgb, also for linear input (files are looked at); as-is unchanged."""
    if encoding == "as-is":
        return light
    return np.asarray(np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055))


@lru_cache
def decoded_bins(bit_depth: int, encoding: InputEncoding) -> NDArray[np.float64]:
    """(V,) linear light of each value bin of a moment table."""
    return decode(bin_values(bit_depth), encoding)


@lru_cache
def decoded_values(bit_depth: int, encoding: InputEncoding) -> NDArray[np.float32]:
    """(256,) or (65536,) linear light of each value of an image."""
    full = 2**bit_depth - 1
    return decode(np.arange(full + 1) / full, encoding).astype(np.float32)


@lru_cache
def encoding_curve(bit_depth: int, encoding: InputEncoding) -> NDArray[np.uint8] | NDArray[np.float32]:
    """What linear light 0, 1/NODES .. 1 becomes in a file.

    8 bit: (NODES + 1,) uint8. 16 bit: (NODES + 2,) float32 to interpolate and round down: a half is in, the last is twice there.
    """
    light = np.linspace(0, 1, NODES + 1)
    values = encode(light, encoding) * (2**bit_depth - 1) + 0.5
    return values.astype(np.uint8) if bit_depth == 8 else np.append(values, values[-1]).astype(np.float32)
