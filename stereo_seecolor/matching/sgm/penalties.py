"""Penalties of semi-global matching: the cost of a change of disparity along a path."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.gray import Gray
from stereo_seecolor.matching.sgm.band import TILE


@dataclass(frozen=True)
class Penalties:
    """Penalties in bits of the census, of which 22 can differ (Hirschmueller 2008, eq. 13). A
    path's costs must stay below 128.

    p2: cost of a change by more than one pixel of disparity where the image is uniform. p2_least:
    the same on a strong edge. A change by one pixel costs P1, a quarter of this (layout.P1_SHIFT).
    texture_levels: difference of gray (of 255) between neighbors that texture and noise reach:
    smaller ones are not edges.
    edge_levels: levels beyond these that halve p2.
    Chosen on a real reef, Teddy and synthetic reefs, clear and turbid (docs/matching.md).
    """

    p2: int = 99
    p2_least: int = 6
    texture_levels: float = 4.0
    edge_levels: float = 2.0


PENALTIES = Penalties()


def p2_maps(image: Gray) -> NDArray[np.uint8]:
    """Compute P2 for steps from the pixel above, and from the pixel to the left: (2, H + 8, W + 9)
    uint8, padded to whole tiles.

    Surfaces end where the image changes (Hirschmueller 2008, section 2.3).
    """
    maps = np.full((2, image.shape[0] + TILE, image.shape[1] + TILE + 1), PENALTIES.p2, np.uint8)
    limits = np.float32(PENALTIES.p2), np.float32(PENALTIES.p2_least)
    _p2_maps(
        image,
        limits,
        np.float32(256 * PENALTIES.texture_levels),
        np.float32(1 / (256 * PENALTIES.edge_levels)),
        maps,
    )
    return maps


@compiled
def _p2_maps(
    image: Gray, limits: tuple[Any, Any], texture: Any, scale: Any, maps: NDArray[np.uint8]
) -> None:
    (full, least), (height, width) = limits, image.shape
    for y in range(height):
        here, above, after = image[y], image[max(y - 1, 0)], image[y, 1:]
        down, right = maps[0, y], maps[1, y, 1:]
        for x in range(width):
            change = abs(np.float32(here[x]) - np.float32(above[x]))
            cost = full / (np.float32(1) + max(change - texture, np.float32(0)) * scale)
            down[x] = np.int32(cost if cost > least else least)
        for x in range(width - 1):
            change = abs(np.float32(after[x]) - np.float32(here[x]))
            cost = full / (np.float32(1) + max(change - texture, np.float32(0)) * scale)
            right[x] = np.int32(cost if cost > least else least)
