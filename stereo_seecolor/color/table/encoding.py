"""Between the numbers a camera writes and linear light, where the water's physics holds."""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.bins import bin_values
from stereo_seecolor.files import srgb

InputEncoding = Literal["srgb", "linear", "as-is"]
NODES = 16384
"""Steps of the encoding curve from 0 to 1: where it is steepest, in the dark, one is a fifth of an 8-bit step."""
REACH = 4
"""Light up to this many times full scale is told apart before it rolls off."""
CODES = 128
"""Codes of such light for 8 bits: steps a value."""
FULL_FROM, FULL_AT = 0.95, 0.99
"""Shares of full scale, encoded: from the second on, a value says only that there was at least so much light; between, in part."""


def decode(values: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """Encoded fractions of full scale -> linear light in [0, 1]; all but srgb unchanged."""
    return srgb.decode_srgb(values) if encoding == "srgb" else values


def encode(light: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """Linear light in [0, 1] -> what an image file holds: srgb, also for linear input (files are looked at); as-is unchanged."""
    return light if encoding == "as-is" else srgb.encode_srgb(light)


def decoding_slope(light: NDArray[np.float64], encoding: InputEncoding) -> NDArray[np.float64]:
    """d light / d value of what ``decode`` does, where it gives this light."""
    return srgb.decoding_slope(light) if encoding == "srgb" else np.ones_like(light)


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


@lru_cache
def known_values(bit_depth: int) -> NDArray[np.float32]:
    """(256,) or (65536,) how far to trust each value of an image: 1, and less the nearer it is to full scale, where it is 0."""
    full = 2**bit_depth - 1
    return np.asarray(np.clip((FULL_AT - np.arange(full + 1) / full) / (FULL_AT - FULL_FROM), 0, 1), dtype=np.float32)


@lru_cache
def code_curve(bit_depth: int) -> NDArray[np.uint16] | NDArray[np.float32]:
    """The codes of linear light 0, 1/NODES .. REACH: sRGB counted from where its power law begins, so that a factor on codes is one
    on light (but for the darkest). 8 bit: (REACH * NODES + 1,) uint16, CODES a value. 16 bit: one more, float32, 1 a value."""
    light = np.linspace(0, REACH, REACH * NODES + 1)
    codes = (encode(light, "srgb") + srgb.OFFSET) * (255 * CODES if bit_depth == 8 else 65535)
    return np.round(codes).astype(np.uint16) if bit_depth == 8 else np.append(codes, codes[-1]).astype(np.float32)
