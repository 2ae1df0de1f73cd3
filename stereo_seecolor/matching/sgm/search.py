"""Match two images over a band of disparities: census, semi-global matching in strips, and the checks on what it finds."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.matching.diagnostics import row_shift_px
from stereo_seecolor.matching.sgm.band import WIDENING, Band
from stereo_seecolor.matching.sgm.images import Gray, census, jump_costs, mirrored_census
from stereo_seecolor.matching.sgm.semiglobal import match_rows
from stereo_seecolor.matching.sgm.vectors import TILE
from stereo_seecolor.records import Map

NOTHING = -0x8000
P1, P2, P2_LEAST = 12, 99, 15
"""What a change of disparity by one, or by more (on even ground, on an edge), costs on a path, in bits of the census."""
STRIP, HALO = 128, 16
"""Rows of a strip, and rows beyond its ends in which its vertical paths settle."""
LARGE_IMAGE_PX = 600_000
AMBIGUOUS = 0.05
"""Lead over the next best, as a share of P2, below which a pixel matches both."""
TOO_NARROW_TILE, TOO_NARROW_STRIP = 0.5, 0.01
"""Share of a tile's pixels that end on the edge of its band, and share of such tiles, with which a strip is searched again."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a search found for the left image.

    disparity: pixels, NaN where the best lies on the edge of its band, another is as good, or the right image disagrees.
    rival: lead over the next best, as a share of P2.
    row_shift_px: how far the rows of the right image lie below the left's.
    """

    disparity: Map
    rival: Map
    row_shift_px: float = 0.0


def search(left: Gray, right: Gray, band: Band) -> Found:
    """Match two smoothed images over a band, in strips on all cores.

    Where a strip's tiles end on the edges of their bands, these are widened and the strip is searched once more.
    """
    pool = core_pool()
    height, width = left.shape
    before = max(0, WIDENING - int(band.lowest.min()))
    after = max(0, int((band.lowest + band.count).max())) + WIDENING
    jump_job = pool.submit(jump_costs, left, P2, P2_LEAST)
    census_jobs = pool.submit(census, left), pool.submit(mirrored_census, right, before, after)
    jump, left_census, right_census = jump_job.result(), census_jobs[0].result(), census_jobs[1].result()
    disparity, rival = np.empty((2, height, width), np.float32)
    ended = np.zeros(band.lowest.shape, np.int32)

    def strip(first: int) -> None:
        end = min(first + STRIP, height)
        rows = (max(0, first - HALO), first, end, min(height, end + HALO))

        def match(band: Band) -> None:
            lowest, count = band.lowest, band.count
            match_rows(left_census, right_census, before, lowest, count, rows, jump, P1, P2, AMBIGUOUS, disparity, rival, ended)

        match(band)
        tiles = slice(first // TILE, -(-end // TILE))
        narrow = np.zeros(ended.shape, np.bool_)
        narrow[tiles] = ended[tiles] > TOO_NARROW_TILE * TILE**2
        if narrow[tiles].mean() > TOO_NARROW_STRIP:
            match(band.widened(narrow))

    list(pool.map(strip, range(0, height, STRIP)))
    return Found(disparity, rival, row_shift_px(left_census, right_census, before + width - 1, disparity))


def remove_speckles(disparity: Map, pixels: int) -> None:
    """Make NaN where fewer than that many connected pixels share a disparity; large images are judged on every second pixel."""
    every = 2 if disparity.size > LARGE_IMAGE_PX else 1
    fixed = np.empty((-(-disparity.shape[0] // every), -(-disparity.shape[1] // every)), np.int16)
    _thinned(disparity, every, fixed)
    kept = fixed.copy()
    cv2.filterSpeckles(kept, NOTHING, pixels // every**2, 16)
    speckle = cv2.compare(kept, fixed, cv2.CMP_NE)
    _without(disparity, every, speckle)


@compiled
def _thinned(disparity: Map, every: int, fixed: NDArray[np.int16]) -> None:
    for y in range(fixed.shape[0]):
        for x in range(fixed.shape[1]):
            d = disparity[y * every, x * every]
            fixed[y, x] = np.int16(d * np.float32(16)) if np.isfinite(d) else np.int16(NOTHING)


@compiled
def _without(disparity: Map, every: int, speckle: NDArray[np.uint8]) -> None:
    for y in range(speckle.shape[0]):
        for x in range(speckle.shape[1]):
            if speckle[y, x]:
                disparity[y * every : (y + 1) * every, x * every : (x + 1) * every] = np.nan
