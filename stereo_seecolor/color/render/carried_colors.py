"""Colors where a range was carried over, held within those that measured pixels of the same picture show.

Where the carried range is too large, too much backscatter is taken off, and red, of which water leaves least, gets far too much
gain: rims and caves before open water come out red. Open water has no range at all: what it scatters is taken for a surface, cyan,
blue or violet. So nothing of carried range is shown redder, greener or bluer than nearly all that was measured, nor shorter of red.
Each is meant against both other channels: what is redder against blue alone is yellow.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Mask

RED = 0


@dataclass(frozen=True)
class BoundSettings:
    """What counts as shown by measured pixels."""

    quantile: float = 0.95
    """Of one channel over another: wrong matches and the noise of far pixels may be a twentieth. Chosen on FLSea frame 0000; 0.99
    leaves an orange corner there."""
    least_light: float = 0.007
    """Of full scale, the channels divided by, in linear light: darker pixels' ratios are noise."""
    every_px: int = 8
    """Rows and columns that are examined."""
    fewest: int = 100
    """Measured pixels that say something."""


SETTINGS = BoundSettings()


class Bounds(NamedTuple):
    """most (3, 3), least (3, 3): of channel c over channel o, the ratios at [c, o] that nearly no measured pixel passes."""

    most: NDArray[np.float32]
    least: NDArray[np.float32]


def within_measured(image: NDArray[Any], carried: Mask, measured: Mask) -> NDArray[Any]:
    """The corrected (H, W, 3) image, its colors held within those of measured pixels where the range was carried over.

    image: encoded uint8 or uint16, or float32 in linear light.
    """
    bounds = _bounds(image, measured) if carried.any() else None
    if bounds is None:
        return image
    at = np.flatnonzero(carried)
    full = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else np.inf
    pixels = np.maximum(image.reshape(-1, 3)[at].T.astype(np.float32, order="C"), 0)
    held = pixels.copy()
    for c in range(3):
        a, b = _others(c)
        most = np.maximum(pixels[a] * bounds.most[c, a], pixels[b] * bounds.most[c, b])
        least = np.minimum(pixels[a] * bounds.least[c, a], pixels[b] * bounds.least[c, b]) if c == RED else 0
        held[c] = np.clip(pixels[c], least, np.minimum(most, full))
    changed = (held != pixels).any(axis=0)
    out = image.copy()
    out.reshape(-1, 3)[at[changed]] = held[:, changed].T
    return out


def _others(c: int) -> list[int]:
    return [o for o in range(3) if o != c]


def _bounds(image: NDArray[Any], measured: Mask) -> Bounds | None:
    """What measured pixels show; None where too few are measured."""
    every, encoded = SETTINGS.every_px, np.issubdtype(image.dtype, np.integer)
    dark = encode_srgb(np.array(SETTINGS.least_light)) * np.iinfo(image.dtype).max if encoded else SETTINGS.least_light
    seen = image[::every, ::every][measured[::every, ::every]].astype(np.float32)
    bounds = Bounds(np.full((3, 3), np.inf, np.float32), np.zeros((3, 3), np.float32))
    for c in range(3):
        others = _others(c)
        lit = seen[(seen[:, others] > dark).all(axis=1)]
        if len(lit) < SETTINGS.fewest:
            return None
        ratios = lit[:, [c]] / lit[:, others]
        bounds.most[c, others] = np.quantile(ratios, SETTINGS.quantile, axis=0)
        bounds.least[c, others] = np.quantile(ratios, 1 - SETTINGS.quantile, axis=0)
    return bounds
