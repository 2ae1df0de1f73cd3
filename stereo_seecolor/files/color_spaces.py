"""Color spaces of photographs other than sRGB, in which cameras and raw converters save images."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.records import Array

SpaceName = Literal["srgb", "adobe-rgb", "display-p3", "prophoto"]
CLOSE = 0.03
"""Difference of two primaries, XYZ: profiles of one space differ by 0.002, spaces by 0.07."""


@dataclass(frozen=True)
class ColorSpace:
    """title: for messages. red, green, blue, white: chromaticities x, y. gamma: power by which
    values are decoded; None: the curve of sRGB.
    """

    title: str
    red: tuple[float, float]
    green: tuple[float, float]
    blue: tuple[float, float]
    white: tuple[float, float]
    gamma: float | None = None

    def decode(self, values: Array) -> Array:
        """Convert encoded values to linear light, both 0 to 1."""
        return decode_srgb(values) if self.gamma is None else np.asarray(values**self.gamma)


D50, D65 = (0.34567, 0.35850), (0.3127, 0.3290)
SPACES: dict[SpaceName, ColorSpace] = {
    # IEC 61966-2-1; Adobe RGB (1998), 2005-05; Apple's Display P3 (SMPTE EG 432-1); ISO 22028-2
    "srgb": ColorSpace("sRGB", (0.64, 0.33), (0.30, 0.60), (0.15, 0.06), D65),
    "adobe-rgb": ColorSpace("Adobe RGB", (0.64, 0.33), (0.21, 0.71), (0.15, 0.06), D65, 563 / 256),
    "display-p3": ColorSpace("Display P3", (0.680, 0.320), (0.265, 0.690), (0.150, 0.060), D65),
    "prophoto": ColorSpace(
        "ProPhoto RGB", (0.7347, 0.2653), (0.1596, 0.8404), (0.0366, 0.0001), D50, 1.8
    ),
}
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
"""Response of the eye's receptors in chromatic adaptation (ICC.1:2022, annex E)."""


@cache
def primaries(space: SpaceName) -> Array:
    """(3, 3) XYZ of red, green and blue, in columns, adapted to D50 as in ICC profiles."""
    own = SPACES[space]
    unscaled = np.stack([_xyz(corner) for corner in (own.red, own.green, own.blue)], axis=1)
    of_white = unscaled * np.linalg.solve(unscaled, _xyz(own.white))
    there, here = BRADFORD @ _xyz(own.white), BRADFORD @ _xyz(D50)
    return np.asarray(np.linalg.solve(BRADFORD, (here / there)[:, None] * (BRADFORD @ of_white)))


def to_srgb(space: SpaceName) -> Array:
    """(3, 3) from linear light of a space to that of sRGB; rows sum to 1."""
    matrix = np.linalg.solve(primaries("srgb"), primaries(space))
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))


def space_of(columns: Array) -> SpaceName | None:
    """The space with these ``primaries``; None if there is none."""
    off = {space: float(np.abs(primaries(space) - columns).max()) for space in SPACES}
    nearest = min(off, key=lambda space: off[space])
    return nearest if off[nearest] < CLOSE else None


def _xyz(chromaticity: tuple[float, float]) -> Array:
    x, y = chromaticity
    return np.array([x / y, 1.0, (1 - x - y) / y])
