"""sRGB's transfer curve (IEC 61966-2-1) between linear and encoded values, both 0..1."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Float = TypeVar("Float", bound=np.floating)

POWER, SCALE, OFFSET = 2.4, 1.055, 0.055
"""Encoded = SCALE light^(1 / POWER) - OFFSET, above the linear part."""
LINEAR_SLOPE, LINEAR_LIGHT, LINEAR_ENCODED = 12.92, 0.0031308, 0.04045
"""Encoded = LINEAR_SLOPE light, up to this light and this encoded value."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green and blue."""


def decode_srgb(encoded: NDArray[Float]) -> NDArray[Float]:
    """Encoded values -> linear light, any shape, same dtype.

    Negative values stay on the linear part; values above 1 follow the curve.
    """
    curved = ((np.maximum(encoded, LINEAR_ENCODED) + OFFSET) / SCALE) ** POWER
    return np.where(encoded <= LINEAR_ENCODED, encoded / LINEAR_SLOPE, curved).astype(
        encoded.dtype, copy=False
    )


def encode_srgb(light: NDArray[Float]) -> NDArray[Float]:
    """Linear light -> encoded values, any shape, same dtype; see ``decode_srgb``."""
    curved = SCALE * np.maximum(light, LINEAR_LIGHT) ** (1 / POWER) - OFFSET
    return np.where(light <= LINEAR_LIGHT, light * LINEAR_SLOPE, curved).astype(
        light.dtype, copy=False
    )


def decoding_slope(light: NDArray[Float]) -> NDArray[Float]:
    """d light / d encoded at this linear light, any shape, same dtype."""
    curved = POWER / SCALE * np.maximum(light, LINEAR_LIGHT) ** (1 - 1 / POWER)
    return np.where(light <= LINEAR_LIGHT, 1 / LINEAR_SLOPE, curved).astype(light.dtype, copy=False)
