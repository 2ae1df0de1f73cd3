"""Semi-global search of a pair: all disparities at reduced size, then bands at full size."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.matching.census import census, mirrored_census
from stereo_seecolor.matching.disparity import MatchedDisparity
from stereo_seecolor.matching.gray import Gray, GrayPair
from stereo_seecolor.matching.sgm.band import FAR, P1_SHIFT, TILE, WIDENING, Band
from stereo_seecolor.matching.sgm.penalties import PENALTIES, p2_maps
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
    Chosen on synthetic reefs.
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
        """Find the disparities of a pair; they do not depend on the number of threads."""
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
    """The bands around disparities at 1 / scale of the size, without speckles."""
    remove_speckles(coarse, CONSTANTS.coarse_speckle_px)
    return Band.around(coarse, scale, shape, lowest, highest)


def is_first_run() -> bool:
    """Whether the compiled search, the slowest to compile, is not yet on disk but can be."""
    return match_rows.missing


def search(left: Gray, right: Gray, band: Band) -> MatchedDisparity:
    """Match two smoothed images over a band, in strips on all cores.

    A strip whose tiles end on the edges of their bands is searched once more in wider bands.
    Checks fail where the best disparity lies on the edge of its band, where another one is as good,
    or where the right image disagrees. There is no disparity where the best lies on the edge or its
    match lies outside the right image.
    """
    pool = core_pool()
    before = max(0, WIDENING - int(band.lowest.min()))
    after = max(0, int((band.lowest + band.count).max())) + WIDENING
    p2, census_left = pool.submit(p2_maps, left), pool.submit(census, left)
    census_right = pool.submit(mirrored_census, right, before, after)
    images = census_left.result(), census_right.result(), before
    costs = p2.result(), PENALTIES.p2, CONSTANTS.ambiguous
    disparity, best, uniqueness = found = tuple(np.empty((3, *left.shape), np.float32))
    on_edge = np.zeros(band.lowest.shape, np.int32)
    height = len(left)

    def search_strip(first: int) -> None:
        end = min(first + CONSTANTS.strip, height)
        rows = max(0, first - CONSTANTS.halo), first, end, min(height, end + CONSTANTS.halo)
        of_tiles = band.lowest, band.count
        match_rows(images, of_tiles, rows, costs, found, on_edge, _room(band, first, end))
        tiles = slice(first // TILE, -(-end // TILE))
        narrow = np.zeros(on_edge.shape, np.bool_)
        narrow[tiles] = on_edge[tiles] > CONSTANTS.band_edge_pixels * TILE**2
        if narrow[tiles].mean() > CONSTANTS.band_edge_tiles:
            wider = band.widened(narrow)
            of_tiles = wider.lowest, wider.count
            match_rows(images, of_tiles, rows, costs, found, on_edge, _room(wider, first, end))

    list(pool.map(search_strip, range(0, height, CONSTANTS.strip)))
    return MatchedDisparity(disparity, best, uniqueness)


def _room(band: Band, first: int, end: int) -> NDArray[np.uint8]:
    """Room for the sums of these rows, one for each disparity of their bands. Made by numpy, which
    asks for large pages: of a wide image this is the largest block, and small ones take long to
    clear.
    """
    widths = TILE * band.count.sum(axis=1)
    return np.empty(int(widths[np.arange(first, end) // TILE].sum()), np.uint8)
