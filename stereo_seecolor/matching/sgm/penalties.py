"""What a change of disparity from one pixel to the next costs on a path of the semi-global search."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.gray import Gray
from stereo_seecolor.matching.sgm.layout import TILE


@dataclass(frozen=True)
class Penalties:
    """In bits of the census, of which 22 can differ (Hirschmueller 2008, eq. 13). A path's costs must stay below 128.

    p1: a change by one pixel of disparity. p2: any larger change where the image is even. p2_least: the same on a strong edge.
    edge_levels: gray levels (of 255) from one pixel to the next that halve p2.
    Found by trial on drawn reefs and scenes of cards, clear to turbid.
    """

    p1: int = 12
    p2: int = 99
    p2_least: int = 15
    edge_levels: float = 5.0


PENALTIES = Penalties()


def p2_maps(image: Gray) -> NDArray[np.uint8]:
    """(2, H + 8, W + 9) P2 from the pixel above, and from the pixel to the left; more rows and columns to fill tiles.

    Surfaces end where the image changes (Hirschmueller 2008, section 2.3).
    """
    maps = np.full((2, image.shape[0] + TILE, image.shape[1] + TILE + 1), PENALTIES.p2, np.uint8)
    scale = np.float32(1 / (256 * PENALTIES.edge_levels))
    _p2_maps(image, np.float32(PENALTIES.p2), np.float32(PENALTIES.p2_least), scale, maps)
    return maps


@compiled
def _p2_maps(image: Gray, full: np.float32, least: np.float32, scale: np.float32, maps: NDArray[np.uint8]) -> None:
    height, width = image.shape
    for y in range(height):
        here, above, after = image[y], image[max(y - 1, 0)], image[y, 1:]
        down, right = maps[0, y], maps[1, y, 1:]
        for x in range(width):
            cost = full / (np.float32(1) + abs(np.float32(here[x]) - np.float32(above[x])) * scale)
            down[x] = np.int32(cost if cost > least else least)
        for x in range(width - 1):
            cost = full / (np.float32(1) + abs(np.float32(after[x]) - np.float32(here[x])) * scale)
            right[x] = np.int32(cost if cost > least else least)
