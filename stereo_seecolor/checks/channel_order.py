"""Red and blue exchanged from some image of a dive on: told by the colors of images before and
after.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.checks.sample import DiveImages, evenly_spaced
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair


@dataclass(frozen=True)
class OrderSettings:
    """Constants of the check.

    looked_at: pairs over the dive that are compared, each with the next.
    quantiles: of each channel of an image; step_px: between the pixels that are counted.
    dark: fraction of full scale that is added, since the noise of dark pixels is no color.
    apart, times: by how much the logarithms of two images' red and blue over green must differ at
    least, and how many times as much as with red and blue exchanged. Of neighbors and of every
    fifth frame of a real reef, FLSea and the sample dive: at most 0.3 times as given, 3.6 and more
    exchanged; nearly gray images at most 1.1 times.
    """

    looked_at: int = 5
    quantiles: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)
    step_px: int = 4
    dark: float = 0.015
    apart: float = 0.05
    times: float = 2.0


SETTINGS = OrderSettings()
Colors = NDArray[np.float64]
"""(3, quantiles) logarithms of the values of R, G, B."""


def order_notes(images: DiveImages) -> tuple[str, ...]:
    """The left image from which on red and blue are exchanged against those before."""
    pairs, config = images.pairs, images.config.input
    looked_at = evenly_spaced(range(len(pairs)), SETTINGS.looked_at)
    with suppress(InputError):
        before = _colors(pairs[0], config) if pairs else None
        for first, last in pairwise(looked_at):
            after = _colors(pairs[last], config)
            if before is not None and _are_exchanged(before, after):
                place = _first_exchanged(pairs, first, last, config)
                return (
                    f"input: {pairs[place].left.name} and what follows hold red and blue in each "
                    f"other's place, compared with {pairs[place - 1].left.name} and before: bring "
                    "all files to one order, or run the two parts apart, one of them with --set "
                    "input.channels=bgr",
                )
            before = after
    return ()


def _first_exchanged(pairs: Sequence[Pair], first: int, last: int, config: InputConfig) -> int:
    """The first image that is exchanged, by halves of the stretch after one that is not."""
    while last - first > 1:
        middle = (first + last) // 2
        if _are_exchanged(_colors(pairs[first], config), _colors(pairs[middle], config)):
            last = middle
        else:
            first = middle
    return last


def _colors(pair: Pair, config: InputConfig) -> Colors:
    image = read_image(pair.left, config)[:: SETTINGS.step_px, :: SETTINGS.step_px]
    values = np.quantile(image.reshape(-1, 3), SETTINGS.quantiles, axis=0).T
    return np.log(values / np.iinfo(image.dtype).max + SETTINGS.dark)


def _are_exchanged(one: Colors, other: Colors) -> bool:
    given, exchanged = _apart(one, other), _apart(one, other[::-1])
    return given > max(SETTINGS.apart, SETTINGS.times * exchanged)


def _apart(one: Colors, other: Colors) -> float:
    """How much red and blue over green differ between two images."""
    off = one - other
    return float(np.abs(off[[0, 2]] - off[1]).mean())
