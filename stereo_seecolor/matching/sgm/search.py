"""Semi-global search of a pair: at reduced size over all disparities, then at full size in bands
around what was found.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.matching.census import Census, census, mirrored_census
from stereo_seecolor.matching.disparity import MatchedDisparity
from stereo_seecolor.matching.gray import Gray, GrayPair
from stereo_seecolor.matching.sgm.band import (
    FAR,
    P1_SHIFT,
    PENALTIES,
    TILE,
    WIDENING,
    Band,
    p2_maps,
)
from stereo_seecolor.matching.sgm.semiglobal import match_rows
from stereo_seecolor.matching.speckles import remove_speckles
from stereo_seecolor.records import Map, StereoFrame

__all__ = [
    "CONSTANTS",
    "FAR",
    "P1_SHIFT",
    "PENALTIES",
    "TILE",
    "Band",
    "SemiGlobalMatching",
    "bands",
    "is_first_run",
    "search",
]


@dataclass(frozen=True)
class SearchConstants:
    """strip, halo: rows of a strip, and rows beyond its ends in which its vertical paths settle;
    small, to fit a core's cache.

    ambiguous: uniqueness below which a pixel is left unknown, fraction of P2.
    band_edge_pixels, band_edge_tiles: where more than this fraction of a tile's pixels end on the
    edge of its band, in more than this fraction of a strip's tiles, these bands are widened and the
    strip is searched again.
    coarse_speckle_px: patches of the reduced image smaller than this are left out of the bands.
    Found by trial on synthetic reefs.
    """

    strip: int = 128
    halo: int = 16
    ambiguous: float = 0.05
    band_edge_pixels: float = 0.5
    band_edge_tiles: float = 0.01
    coarse_speckle_px: int = 10


CONSTANTS = SearchConstants()


class SemiGlobalMatching:
    """The engine ``sgm``: semi-global matching over the disparities lowest..highest, pixels."""

    refined = False

    def __init__(self, lowest: int, highest: int) -> None:
        self._lowest, self._highest = lowest, highest

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """Find the disparities of a pair; they depend on nothing else, whatever the number of
        threads.
        """
        low, high = self._lowest // pair.scale, -(-self._highest // pair.scale)
        coarse = search(
            pair.small_left, pair.small_right, Band.everywhere(pair.small_left.shape, low, high)
        ).disparity
        found = search(
            pair.left,
            pair.right,
            bands(coarse, pair.scale, pair.left.shape, self._lowest, self._highest),
        )
        return replace(found, reduced_fraction=float(np.isfinite(coarse).mean()))


def bands(coarse: Map, scale: int, shape: tuple[int, int], lowest: int, highest: int) -> Band:
    """The bands of an image of that shape around disparities at 1 / scale of its size, from which
    speckles are removed first.
    """
    remove_speckles(coarse, CONSTANTS.coarse_speckle_px)
    return Band.around(coarse, scale, shape, lowest, highest)


def is_first_run() -> bool:
    """Tell whether the search, which takes longest to compile, is not compiled on disk yet and can
    be kept there.
    """
    return match_rows.missing


def search(left: Gray, right: Gray, band: Band) -> MatchedDisparity:
    """Match two smoothed images over a band, in strips on all cores.

    Checks fail where the best disparity lies on the edge of its band, where another is as good, or
    where the right image disagrees; nothing was found where it lies on the edge or meets nothing in
    the right image.
    """
    strips = _Strips(left, right, band)
    list(core_pool().map(strips.search, range(0, left.shape[0], CONSTANTS.strip)))
    return MatchedDisparity(strips.disparity, strips.best, strips.uniqueness)


class _Strips:
    """The strips of a pair: what all of them need, and the maps that they fill."""

    def __init__(self, left: Gray, right: Gray, band: Band) -> None:
        pool = core_pool()
        self._band = band
        self._before = max(0, WIDENING - int(band.lowest.min()))
        after = max(0, int((band.lowest + band.count).max())) + WIDENING
        p2 = pool.submit(p2_maps, left)
        bits = pool.submit(census, left), pool.submit(mirrored_census, right, self._before, after)
        self._p2: NDArray[np.uint8] = p2.result()
        self._left: Census = bits[0].result()
        self._right: Census = bits[1].result()
        maps: Any = np.empty((3, *left.shape), np.float32)
        self.disparity: Map = maps[0]
        self.best: Map = maps[1]
        self.uniqueness: Map = maps[2]
        self._on_edge = np.zeros(band.lowest.shape, np.int32)

    def search(self, first: int) -> None:
        """Search the strip from row ``first`` on; where its tiles end on the edges of their bands,
        once more in wider bands.
        """
        end = min(first + CONSTANTS.strip, len(self.disparity))
        self._match(self._band, first, end)
        tiles = slice(first // TILE, -(-end // TILE))
        narrow = np.zeros(self._on_edge.shape, np.bool_)
        narrow[tiles] = self._on_edge[tiles] > CONSTANTS.band_edge_pixels * TILE**2
        if narrow[tiles].mean() > CONSTANTS.band_edge_tiles:
            self._match(self._band.widened(narrow), first, end)

    def _match(self, band: Band, first: int, end: int) -> None:
        rows = (
            max(0, first - CONSTANTS.halo),
            first,
            end,
            min(len(self.disparity), end + CONSTANTS.halo),
        )
        images = self._left, self._right, self._before
        costs = self._p2, PENALTIES.p2, CONSTANTS.ambiguous
        found = self.disparity, self.best, self.uniqueness
        widths = TILE * band.count.sum(axis=1)
        # By numpy, which asks for large pages: of a wide image this is the largest block, and small
        # ones take long to clear
        total = np.empty(int(widths[np.arange(first, end) // TILE].sum()), np.uint8)
        match_rows(images, (band.lowest, band.count), rows, costs, found, self._on_edge, total)
