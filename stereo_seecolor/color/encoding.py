"""Between the numbers a camera writes and linear light, where the water's physics holds."""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.tables import bin_values

InputEncoding = Literal["srgb", "linear", "as-is"]
NODES = 16384
"""Nodes of the encoding curve between 0 and 1; between them it is interpolated (error below 0.1 of a 16-bit step)."""


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
def encoding_nodes(bit_depth: int, encoding: InputEncoding) -> NDArray[np.float32]:
    """(NODES + 2,) the values of an image, plus one half for rounding down, at linear light 0, 1/NODES .. 1, 1."""
    light = np.append(np.linspace(0, 1, NODES + 1), 1.0)
    return np.asarray(encode(light, encoding) * (2**bit_depth - 1) + 0.5, dtype=np.float32)
