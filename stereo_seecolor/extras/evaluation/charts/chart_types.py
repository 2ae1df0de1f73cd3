"""Color charts: the places of their patches, and the colors that their makers publish."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

_PIXELS = 16
"""Pixels of the template in a unit, the side of a small patch."""
_GAP = 0.12
"""Width of the dark line between patches, units."""
_BLUR = 0.15
"""Blur of the template by water and lens, standard deviation, units."""
_FRAME_LEVEL = 0.08
"""Encoded value of the chart's black frame."""


@dataclass(frozen=True, eq=False)
class ChartType:
    """A kind of chart. srgb: (N, 3) in [0, 1], D65. cells: (N, 4) as x, y, width, height in units,
    from the first patch's corner.

    size: (width, height) in units. frame: its dark margin, units. grays: which patches are neutral.
    """

    name: str
    srgb: NDArray[np.float64]
    cells: NDArray[np.float64]
    size: tuple[float, float]
    frame: float
    grays: slice

    @cached_property
    def corners(self) -> NDArray[np.float32]:
        """(4, 2) of the patches' outline, units: the first patch's corner, then clockwise."""
        width, height = self.size
        return np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)

    @cached_property
    def template(self) -> NDArray[np.float32]:
        """(h, w, 3) encoded picture of the chart with its frame, 16 px a unit."""
        width, height = (round((side + 2 * self.frame) * _PIXELS) for side in self.size)
        picture = np.full((height, width, 3), _FRAME_LEVEL, np.float32)
        for color, (x, y, w, h) in zip(self.srgb, self.cells, strict=True):
            left, top = (self.frame + x + _GAP / 2) * _PIXELS, (self.frame + y + _GAP / 2) * _PIXELS
            right, bottom = left + (w - _GAP) * _PIXELS, top + (h - _GAP) * _PIXELS
            picture[round(top) : round(bottom), round(left) : round(right)] = color
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), _BLUR * _PIXELS), np.float32)

    def template_pixels(self, units: NDArray[np.floating]) -> NDArray[np.float64]:
        """(N, 2) pixels of the template at points (N, 2) in units."""
        return np.asarray((units + self.frame) * _PIXELS - 0.5, np.float64)


@dataclass(frozen=True, eq=False)
class FoundChart:
    """A chart in a picture. corners: (4, 2) pixels of the patches' outline, the first patch's
    first, then clockwise; those of a cut chart lie outside. score: correlation of its patches with
    the published colors. seen: (N,) patches that the picture shows.
    """

    type: ChartType
    corners: NDArray[np.float64]
    score: float
    seen: NDArray[np.bool_]


def _grid(columns: int, heights: tuple[float, ...]) -> NDArray[np.float64]:
    tops = np.concatenate([[0], np.cumsum(heights)[:-1]])
    return np.array(
        [
            [x, top, 1, height]
            for top, height in zip(tops, heights, strict=True)
            for x in range(columns)
        ]
    )


CLASSIC_SRGB = np.array(
    [
        [115, 82, 68], [194, 150, 130], [98, 122, 157], [87, 108, 67], [133, 128, 177], [103, 189,
        170],
        [214, 126, 44], [80, 91, 166], [193, 90, 99], [94, 60, 108], [157, 188, 64], [224, 163, 46],
        [56, 61, 150], [70, 148, 73], [175, 54, 60], [231, 199, 31], [187, 86, 149], [8, 133, 161],
        [243, 243, 242], [200, 200, 200], [160, 160, 160], [122, 122, 121], [85, 85, 85], [52, 52,
        52],
    ]
)  # fmt: skip
"""The 24 patches row by row, sRGB of 8 bits, as X-Rite publishes them."""
DKK_SRGB = np.array(
    [
        [255, 255, 255], [176, 180, 183], [150, 151, 155], [119, 120, 124], [88, 89, 91], [0, 0, 0],
        [236, 30, 40], [243, 244, 0], [94, 190, 68], [71, 172, 239], [23, 24, 83], [237, 0, 142],
        [171, 49, 59], [204, 128, 58], [44, 136, 165], [189, 84, 150], [197, 159, 139], [180, 147,
        125],
    ]
)  # fmt: skip
"""The 18 patches row by row: OpenCV's reference of its VINYL18 chart, as sRGB of 8 bits."""
SPYDER_SRGB = np.array(
    [
        [98, 187, 166], [126, 125, 174], [82, 106, 60], [87, 120, 155], [197, 145, 125], [112, 76,
        60],
        [222, 118, 32], [58, 88, 159], [195, 79, 95], [83, 58, 106], [157, 188, 54], [238, 158, 25],
        [0, 127, 159], [192, 75, 145], [245, 205, 0], [186, 26, 51], [57, 146, 64], [25, 55, 135],
        [249, 242, 238], [202, 198, 195], [161, 157, 154], [122, 118, 116], [80, 80, 78], [43, 41,
        43],
    ]
)  # fmt: skip
"""The 24 patches row by row, grays below, white at the left: sRGB of 8 bits, as Datacolor publishes
them (columns H to E of "SpyderCheckr Color Data V2").
"""

CLASSIC = ChartType(
    "ColorChecker Classic", CLASSIC_SRGB / 255, _grid(6, (1, 1, 1, 1)), (6, 4), 0.3, slice(18, 24)
)

DKK = ChartType("DGK / DKK 18", DKK_SRGB / 255, _grid(6, (2, 1, 1)), (6, 4), 0.2, slice(0, 6))

SPYDER = ChartType(
    "SpyderCheckr 24", SPYDER_SRGB / 255, _grid(6, (1, 1, 1, 1)), (6, 4), 0.3, slice(18, 24)
)

CHART_TYPES = (CLASSIC, DKK, SPYDER)
