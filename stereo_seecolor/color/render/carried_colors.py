"""Colors where a range was carried over, held within those that measured pixels of the same picture show.

Where the carried range is too large, too much backscatter is taken off, and red, of which water leaves least, gets far too much
gain: rims and caves before open water come out red. No pixel of carried range is shown redder than nearly all measured ones, both
against green and against blue: what is redder against blue alone is yellow.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Mask


@dataclass(frozen=True)
class RednessSettings:
    """What counts as shown by measured pixels."""

    quantile: float = 0.95
    """Of their red over green and over blue: wrong matches and the noise of far pixels may be a twentieth. Chosen on FLSea frame
    0000; 0.99 leaves an orange corner there."""
    least_light: float = 0.007
    """Of full scale, green and blue, in linear light: darker pixels' ratios are noise."""
    every_px: int = 8
    """Rows and columns that are examined."""
    fewest: int = 100
    """Measured pixels that say something."""


SETTINGS = RednessSettings()


def less_red(image: NDArray[Any], carried: Mask, measured: Mask) -> NDArray[Any]:
    """The corrected (H, W, 3) image, its red lowered where the range was carried over and hardly any measured pixel is as red.

    image: encoded uint8 or uint16, or float32 in linear light.
    """
    most = _most_red(image, measured) if carried.any() else None
    if most is None:
        return image
    at = np.flatnonzero(carried)
    pixels = image.reshape(-1, 3)[at]
    bound = np.maximum((pixels[:, 1:] * most).max(axis=1), 0)
    redder = pixels[:, 0] > bound
    out = image.copy()
    out.reshape(-1, 3)[at[redder], 0] = bound[redder]
    return out


def _most_red(image: NDArray[Any], measured: Mask) -> NDArray[np.float32] | None:
    """(2,) red over green and over blue that nearly no measured pixel passes; None where too few are measured."""
    every, encoded = SETTINGS.every_px, np.issubdtype(image.dtype, np.integer)
    least = encode_srgb(np.array(SETTINGS.least_light)) * np.iinfo(image.dtype).max if encoded else SETTINGS.least_light
    seen = image[::every, ::every][measured[::every, ::every]].astype(np.float32)
    lit = seen[(seen[:, 1:] > least).all(axis=1)]
    if len(lit) < SETTINGS.fewest:
        return None
    return np.asarray(np.quantile(lit[:, :1] / lit[:, 1:], SETTINGS.quantile, axis=0), np.float32)
