"""How bright a picture is shown: its exposure, and where light goes that is then beyond full scale.

A few white cards or flashes of sun set the exposure of a picture whose brightest may not clip, and leave a shaded reef black. So
a scene that is dark against its own brightest is shown brighter, and what is above mid-gray is then compressed: all channels of a
pixel by one factor, which depends on its brightest channel alone. Chromaticity stays, and all up to mid-gray stays linear.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.gains import MID_GRAY
from stereo_seecolor.color.table.encoding import (
    CODES,
    InputEncoding,
    code_curve,
    decode,
    decoded_values,
    encoding_curve,
    known_values,
)
from stereo_seecolor.files import srgb

BRIGHTEST_SHOWN = 0.97
"""Of full scale, as displayed: where the brightest pixel that may not clip comes to lie; a white card's noise needs the rest."""


class Tone(NamedTuple):
    """exposure: gain of all channels. highlights: how many times the brightest light shown is rolled off to it; 1 = none is."""

    exposure: float
    highlights: float = 1.0


@dataclass(frozen=True, eq=False)
class Looks:
    """The look-ups between a camera's values and a picture's, V = 256 or 65536.

    decoded (V,): linear light of a value. known (V,): 1, and less where the value is so high that the light may have been anything
    above. curve: what linear light becomes in a file (``encoding_curve``); where it rolls off, its code (``code_curve``). shoulder:
    empty, or where light rolls off (5,) float32: knee, length and bend in codes; values a code, and the value of code 0, negated.
    """

    decoded: NDArray[np.float32]
    known: NDArray[np.float32]
    curve: NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]
    shoulder: NDArray[np.float32]


@lru_cache(maxsize=8)
def looks(bit_depth: int, encoding: InputEncoding, highlights: float) -> Looks:
    """The look-ups for images of 8 or 16 bits.

    Up to mid-gray all is shown in proportion. Above, the code of a pixel's brightest channel follows Reinhard's curve (2002, eq.
    4), of slope 1 at mid-gray, by which ``highlights`` times the brightest light shown becomes that; the others keep their ratios
    to it.
    """
    decoded, known = decoded_values(bit_depth, encoding), known_values(bit_depth)
    if highlights <= 1:
        return Looks(decoded, known, encoding_curve(bit_depth, encoding), np.empty(0, np.float32))
    values, codes = 2**bit_depth - 1, CODES if bit_depth == 8 else 1
    brightest = float(decode(np.array(BRIGHTEST_SHOWN), "srgb"))
    light = np.array([MID_GRAY, brightest, highlights * brightest])
    knee, top, most = values * codes * srgb.SCALE * light ** (1 / srgb.POWER)
    shoulder = [knee, top - knee, ((top - knee) / (most - knee)) ** 2, 1 / codes, values * srgb.OFFSET - 0.5]
    return Looks(decoded, known, code_curve(bit_depth), np.array(shoulder, np.float32))
