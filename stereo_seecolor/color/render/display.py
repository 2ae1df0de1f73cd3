"""The exposure of an image for display, and the roll-off of highlights beyond full scale.

A scene is shown at one median brightness. If its brightest pixels would clip, light above mid-gray
is compressed: all channels of a pixel by one factor, which depends only on its brightest channel.
Chromaticity does not change, and light up to mid-gray stays linear.
"""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.water_gains import MID_GRAY
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values, encode
from stereo_seecolor.files import srgb
from stereo_seecolor.records import Image

BRIGHTEST_SHOWN = 0.97
"""Displayed value of the brightest pixel not to clip: a margin for the noise of a target."""
BRIGHTEST_LIGHT = float(srgb.decode_srgb(np.array(BRIGHTEST_SHOWN)))
"""The same in linear light."""
NODES = 16384
"""Steps of the encoding curve from light 0 to 1: at most a fifth of an 8-bit step."""
REACH = 5
"""Largest light, times full scale, that the roll-off distinguishes; it limits exposure, because
more makes the bright parts of an image flat and pale, and brightens noise. With 4, dark corals next
to sunlit sand are shown at a median of 0.13 to 0.14.
"""
CODES = {8: 128, 16: 1}
"""Codes per value, by bit depth: 8-bit values are rounded from 16-bit codes."""
FULL_FROM, FULL_AT = 0.95, 0.99
"""Encoded values: from the second on, a value is only a lower bound of the light; between the two,
in part.
"""


def brightest_channel(image: Image) -> Image:
    """The greatest of the three values of each pixel, (H, W)."""
    red, green, blue = cv2.split(image)  # numpy takes five times as long over a short axis
    return np.asarray(cv2.max(cv2.max(red, green), blue))


class Tone(NamedTuple):
    """exposure: gain of all channels. highlights: largest light, as a multiple of the brightest
    light shown, that is rolled off to it; 1 = no roll-off.
    """

    exposure: float
    highlights: float = 1.0


class Display(NamedTuple):
    """Tables that convert a camera's values to light, and light to displayed values; V = 256 or
    65536.

    decoded (V,): linear light of a value. known (V,): 1; less for values that the camera may have
    clipped. curve (81922,): codes of linear light 0, 1/NODES .. REACH, the last twice. codes
    (81922,): the same rounded, for look-up tables of 8 bits. values (81922,): displayed value of
    each code; of no nodes where highlights roll off. shoulder (5,): knee, length and bend of the
    roll-off, in codes; values per code; the value of code 0, negated, less a half for rounding.
    """

    decoded: NDArray[np.float32]
    known: NDArray[np.float32]
    curve: NDArray[np.float32]
    codes: NDArray[np.uint16]
    values: NDArray[np.uint16]
    shoulder: NDArray[np.float32]


@lru_cache(maxsize=8)
def display(bit_depth: int, encoding: InputEncoding, highlights: float) -> Display:
    """Compute the tables for images of 8 or 16 bits.

    Light up to mid-gray is shown linearly. Above it, the code of a pixel's brightest channel
    follows Reinhard's curve (2002, eq. 4), with slope 1 at mid-gray, which takes ``highlights``
    times the brightest light shown to that light; the other channels keep their ratio to it. Codes
    are sRGB values from the origin of its power law, so that a factor on codes is a factor on light
    (but for the darkest).
    """
    values, each = 2**bit_depth - 1, CODES[bit_depth]
    zero = 0.0 if encoding == "as-is" else srgb.OFFSET
    shoulder = [np.inf, 1.0, 0.0, 1 / each, values * zero - 0.5]
    if highlights > 1:
        light = np.array([MID_GRAY, BRIGHTEST_LIGHT, highlights * BRIGHTEST_LIGHT])
        knee, top, most = values * each * srgb.SCALE * light ** (1 / srgb.POWER)
        shoulder[:3] = knee, top - knee, ((top - knee) / (most - knee)) ** 2
    known = np.clip(
        (FULL_AT - np.arange(values + 1) / values) / (FULL_AT - FULL_FROM), 0, 1
    ).astype(np.float32)
    curve = _code_curve(bit_depth, encoding, zero)
    codes = np.round(np.minimum(curve, 65535)).astype(np.uint16)
    roll_off = np.array(shoulder, np.float32)
    displayed = np.clip(codes * roll_off[3] - roll_off[4], 0, 255).astype(np.uint16)
    displayed = displayed[: 0 if highlights > 1 else codes.size]
    return Display(decoded_values(bit_depth, encoding), known, curve, codes, displayed, roll_off)


@lru_cache
def _code_curve(bit_depth: int, encoding: InputEncoding, zero: float) -> NDArray[np.float32]:
    light = np.linspace(0, REACH, REACH * NODES + 1)
    codes = (encode(light, encoding) + zero) * (2**bit_depth - 1) * CODES[bit_depth]
    return np.append(codes, codes[-1]).astype(np.float32)
