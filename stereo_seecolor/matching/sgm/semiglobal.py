"""Semi-global matching (Hirschmueller 2008) of census images, each tile of the image over its own
band of disparities.

Tiles of TILE x TILE pixels search ``lowest .. lowest + count - 1``, count a multiple of LANES.
Paths run right, down, left and up; between tiles of different bands a path carries over what the
bands share (Rothermel et al. 2012, tSGM). Four pixels go at a time: four rows of a tile along the
rows, four columns of it across them, so that they always share a band. The image is cut into strips
of rows that are matched alone, each with rows beyond its ends to let the vertical paths settle:
memory stays small, strips go to threads, and the result does not depend on how many there are.

Costs of a row lie tile by tile, in a tile LANES disparities by LANES, in these pixel by pixel.
Every cost is below 128.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.sgm import vectors as steps
from stereo_seecolor.matching.sgm.band import BLOCK, FAR, LANES, PIXELS, TILE, WINDOW
from stereo_seecolor.records import Map

NOWHERE, FLOOR, ALONG = 0, BLOCK, 2 * BLOCK
"""Places in ``paths``: a block of FAR, one of least costs, and the paths along the rows; then come
those across them.
"""
LOW, COUNT, PLACE = 0, 1, 2
NEXT = TILE * LANES
"""From one pixel's costs to its next LANES disparities."""
MARGIN = TILE
"""Elements before the sums of a row and before the claims, which vector steps may read or write."""
BEST, LEAST, SECOND, BELOW, ABOVE, CHOSEN = range(6)

NEVER = -0x8000
"""Taken from the disparity of a claim; that of a pixel that nobody claimed."""


@compiled
def match_rows(
    images: tuple[NDArray[np.uint32], NDArray[np.uint32], int],
    band: tuple[NDArray[np.int32], NDArray[np.int32]],
    rows: tuple[int, int, int, int],
    penalties: tuple[NDArray[np.uint8], int, float],
    results: tuple[Map, Map, Map],
    on_edge: NDArray[np.int32],
    total: NDArray[np.uint8],
) -> None:
    """Fill rows[1]..rows[2]-1 of the maps ``results`` from rows[0]..rows[3]-1 of the census images;
    rows[0] starts a tile.

    images: the left census (H, W); the right one (H, before + W + ...) mirrored, the pixel x at
    column before + W - 1 - x, zero outside the image; before. band: lowest and count of each tile.
    penalties: P2 maps (p2_maps), the largest P2, and the uniqueness below which a pixel stays
    unknown.
    results: disparity of the left image, with the parabola's fraction; NaN where the best lies on
    the edge of its band, where it is not unique, or where the pixel of the right image that it
    meets chose, from the same costs, another by more than one pixel. Then the same with these
    latter two; then uniqueness: how much worse the best disparity beyond +-1 is, as a fraction of
    P2.
    on_edge: for each tile, the number of pixels whose best disparity lies on the edge of its band
    is added.
    total: work memory, a sum for each disparity of the bands of rows[1]..rows[2]-1, row after row.
    """
    left, right, before_left = images
    lowest, count = band
    p2, P2, ambiguous = penalties
    start, first, end, stop = rows
    tile_row = start // TILE
    bands, lengths, most, widest = _layout(
        lowest, count, tile_row, (stop - 1) // TILE - tile_row + 1
    )
    row_places = np.zeros(end - first + 1, np.int64)
    for row in range(end - first):
        row_places[row + 1] = row_places[row] + lengths[(first + row) // TILE - tile_row]
    cost, along = np.empty(TILE * most, np.uint8), np.empty(TILE * most, np.uint8)
    sums = np.empty(most + 2 * TILE * LANES, np.uint16)
    winner = np.empty((6, left.shape[1] + TILE), np.int16)
    claims = np.empty(TILE + right.shape[1] + WINDOW, np.uint32)
    paths = np.zeros(ALONG + 3 * widest + 2 * most, np.uint8)
    paths[:BLOCK] = FAR
    origin = before_left + left.shape[1] - 1
    scale, least_uniqueness = np.float32(1 / P2), np.float32(ambiguous)
    for sweep in range(2):
        top, bottom = (start, end) if sweep == 0 else (first, stop)
        before, now = ALONG + 3 * widest, ALONG + 3 * widest + most
        paths[before:] = 0
        tiles = -(-(bottom - top) // TILE)
        for i in range(tiles):
            y = top + TILE * (i if sweep == 0 else tiles - 1 - i)
            tile, tall = y // TILE - tile_row, min(TILE, bottom - y)
            own = bands[tile]
            if i > 0:
                _change_bands(paths, before, now, bands[tile - 1 if sweep == 0 else tile + 1], own)
                before, now = now, before
            _costs(left[y : y + tall], right[y : y + tall], origin, own, cost, most)
            inside = first <= y < end
            if inside:
                _along(sweep, own, cost, along, most, p2[1], y, paths, widest)
            for turn in range(tall):
                row = turn if sweep == 0 else tall - 1 - turn
                _across(own, cost, row * most, p2[0], y + row + sweep, paths, before, now)
                before, now = now, before
                if inside:
                    place = row_places[y + row - first]
                    _sum(sweep, paths, before, along, row * most, total, place, lengths[tile], sums)
                if inside and sweep == 1:
                    _choose(sums, own, origin, winner, claims)
                    maps = results[0][y + row], results[1][y + row], results[2][y + row]
                    _judge(
                        winner,
                        claims,
                        MARGIN + origin,
                        (scale, least_uniqueness),
                        maps,
                        on_edge[y // TILE],
                    )


@compiled
def _layout(lowest: NDArray[np.int32], count: NDArray[np.int32], tile_row: int, rows: int) -> Any:
    """(rows, 3, tiles): each tile's lowest disparity, count, and place in a row of costs; (rows,)
    lengths of these rows; the largest of them, and of the tiles'.
    """
    tiles = lowest.shape[1]
    bands = np.empty((rows, 3, tiles), np.int64)
    lengths = np.empty(rows, np.int64)
    most = widest = 0
    for row in range(rows):
        place = 0
        for tile in range(tiles):
            bands[row, LOW, tile] = lowest[tile_row + row, tile]
            bands[row, COUNT, tile] = count[tile_row + row, tile]
            bands[row, PLACE, tile] = place
            place += TILE * bands[row, COUNT, tile]
            widest = max(widest, TILE * bands[row, COUNT, tile])
        lengths[row] = place
        most = max(most, place)
    return bands, lengths, most, widest


@compiled
def _costs(bits: Any, others: Any, origin: int, band: Any, cost: Any, most: int) -> None:
    """The costs of some rows, ``most`` apart; beyond the rows' ends they are 0, with which a path
    has not begun.
    """
    rows, width = bits.shape
    for row in range(rows):
        for tile in range(band.shape[1]):
            for k in range(0, band[COUNT, tile], LANES):
                place = row * most + band[PLACE, tile] + k * TILE
                met = origin + band[LOW, tile] + k
                for x in range(tile * TILE, min(tile * TILE + TILE, width)):
                    steps.hamming(
                        bits[row, x], others[row], met - x, cost, place + LANES * (x % TILE)
                    )
                if tile * TILE + TILE > width:
                    cost[place + LANES * (width % TILE) : place + LANES * TILE] = 0


@compiled
def _along(
    sweep: int,
    band: Any,
    cost: Any,
    along: Any,
    most: int,
    p2: Any,
    y: int,
    paths: Any,
    widest: int,
) -> None:
    """The paths along a row of tiles, whose first row is y, right in sweep 0 and left in sweep 1,
    to ``along``.
    """
    tiles, p2_stride = band.shape[1], p2.shape[1]
    before, now, spare = ALONG, ALONG + widest, ALONG + 2 * widest
    first = 0 if sweep == 0 else tiles - 1
    low, count = band[LOW, first], band[COUNT, first]
    paths[before : before + TILE * count] = 0
    for i in range(tiles):
        tile = i if sweep == 0 else tiles - 1 - i
        if band[LOW, tile] != low or band[COUNT, tile] != count:
            _slide(paths, before, spare, low, count, band[LOW, tile], band[COUNT, tile])
            before, spare = spare, before
            low, count = band[LOW, tile], band[COUNT, tile]
        column, onward = (0, 1) if sweep == 0 else (TILE - 1, -1)
        place = band[PLACE, tile] + column * LANES
        j = y * p2_stride + tile * TILE + column + sweep
        if count == LANES:
            steps.steps(
                paths, before, cost, place, along, onward * LANES, most, p2, j, onward, p2_stride
            )
            continue
        for _ in range(TILE):
            for half in range(0, TILE, PIXELS):
                at = half * LANES
                _advance(
                    paths, before + at, now + at, count,
                    cost, place + half * most, most, p2, j + half * p2_stride, p2_stride,
                )  # fmt: skip
                for k in range(0, count, LANES):
                    steps.scatter(
                        paths, now + at + k * TILE, along, place + half * most + k * TILE, most
                    )
            before, now = now, before
            place, j = place + onward * LANES, j + onward


@compiled
def _across(
    band: Any, cost: Any, row: int, p2: Any, y: int, paths: Any, before: int, now: int
) -> None:
    """The paths across the rows take one step, from paths[before:] to paths[now:], both laid out as
    a row's costs.
    """
    for tile in range(band.shape[1]):
        for half in range(0, TILE, PIXELS):
            place = band[PLACE, tile] + half * LANES
            j = y * p2.shape[1] + tile * TILE + half
            _advance(
                paths, before + place, now + place, band[COUNT, tile], cost, row + place, LANES, p2,
                j, 1
            )  # fmt: skip


@compiled(inline=True)
def _advance(
    paths: Any, before: int, now: int, count: int,
    cost: Any, c: int, cost_stride: int, p2: Any, j: int, p2_stride: int,
) -> None:  # fmt: skip
    """Four pixels' paths take one step."""
    if count == LANES:
        steps.step(paths, before, now, cost, c, cost_stride, p2, j, p2_stride)
        return
    last = before + (count // LANES - 1) * NEXT
    steps.fold(paths, before, last, FLOOR)
    for block in range(before + NEXT, last, NEXT):
        steps.fold(paths, block, FLOOR, FLOOR)
    for on in range(0, last - before + NEXT, NEXT):
        block = before + on
        below, above = block - NEXT if on else NOWHERE, block + NEXT if block < last else NOWHERE
        steps.step_of_many(
            paths, below, block, above, FLOOR, now + on, cost, c + on, cost_stride, p2, j, p2_stride
        )


@compiled
def _sum(
    sweep: int,
    paths: Any,
    now: int,
    along: Any,
    row: int,
    total: Any,
    place: int,
    length: int,
    sums: Any,
) -> None:
    """Sum a row's paths: those of sweep 0 to total, all four to sums."""
    for k in range(0, length, BLOCK):
        if sweep == 0:
            steps.add(paths, now + k, along, row + k, total, place + k)
        else:
            steps.add_wide(paths, now + k, along, row + k, total, place + k, sums, MARGIN + k)


@compiled
def _change_bands(paths: Any, before: int, now: int, band: Any, new: Any) -> None:
    """Carry a row of paths over to the bands of the next row of tiles."""
    for tile in range(band.shape[1]):
        source, target = before + band[PLACE, tile], now + new[PLACE, tile]
        _slide(
            paths,
            source,
            target,
            band[LOW, tile],
            band[COUNT, tile],
            new[LOW, tile],
            new[COUNT, tile],
        )


@compiled
def _slide(
    paths: Any, source: int, target: int, low: int, count: int, new_low: int, new_count: int
) -> None:
    """Copy costs of TILE pixels from band low.. to where new_low.. finds them; others are FAR."""
    for k in range(0, new_count, LANES):
        first = k + new_low - low
        block = first // LANES
        for pixel in range(TILE):
            piece = source + (block * TILE + pixel) * LANES
            lower = piece if 0 <= block < count // LANES else NOWHERE
            upper = piece + NEXT if -1 <= block < count // LANES - 1 else NOWHERE
            steps.slide(
                paths, lower, upper, first - block * LANES, target + k * TILE + pixel * LANES
            )


@compiled
def _choose(sums: Any, band: Any, origin: int, winner: Any, claims: Any) -> None:
    """One row: each left pixel's best disparity and sums around; each right pixel's best."""
    width = winner.shape[1] - TILE
    claims[:] = 0xFFFFFFFF
    for tile in range(band.shape[1]):
        low, count = band[LOW, tile], band[COUNT, tile]
        place, first = MARGIN + band[PLACE, tile], tile * TILE
        if count == LANES:
            steps.winners(sums, place, np.int16(low), winner, first, winner.shape[1])
        else:
            for x in range(TILE):
                _winner(sums, place + LANES * x, low, count, winner, first + x)
        for k in range(0, count, LANES):
            if tile == band.shape[1] - 1:
                sums[place + k * TILE + LANES * (width - first) : place + (k + LANES) * TILE] = (
                    0xFFFF
                )
            steps.claim(
                sums, place + k * TILE, np.int16(low + k), claims, MARGIN + origin - first + low + k
            )


@compiled(inline=True)
def _winner(sums: Any, at: int, low: int, count: int, winner: Any, x: int) -> None:
    """What ``winners`` notes, for a pixel with more than LANES disparities."""
    least, best = 0xFFFF, 0
    for k in range(0, count, LANES):
        key = int(steps.smallest(sums, at + k * TILE))
        if key >> 4 < least:
            least, best = key >> 4, k + (key & 15)
    second = 0xFFFF
    for k in range(0, count, LANES):
        second = min(second, int(steps.smallest_but(sums, at + k * TILE, np.int16(best - k))))
    winner[BEST, x], winner[LEAST, x], winner[SECOND, x] = low + best, least, second
    winner[BELOW, x] = sums[_place(at, best - 1)] if best > 0 else -1
    winner[ABOVE, x] = sums[_place(at, best + 1)] if best < count - 1 else -1


@compiled(inline=True)
def _place(at: int, k: int) -> int:
    return at + (k & -LANES) * TILE + (k & (LANES - 1))


@compiled
def _judge(
    winner: Any, claims: Any, met: int, limits: tuple[Any, Any], found: Any, on_edge: Any
) -> None:
    """One row of disparities, with the parabola's fraction, where they pass the checks; of all of
    them; and of uniqueness.

    limits: 1 / P2, and the least uniqueness.
    """
    scale, least_uniqueness = limits
    disparity_row, any_row, uniqueness = found
    width = disparity_row.size
    chosen_row = winner[CHOSEN]
    best_row = winner[BEST]
    least_row = winner[LEAST]
    second_row = winner[SECOND]
    below_row, above_row = winner[BELOW], winner[ABOVE]
    for x in range(width):
        chosen_row[x] = (
            np.int32(claims[met - x + np.int64(best_row[x])] & np.uint32(0xFFFF)) + NEVER
        )
        on_edge[x // TILE] += (below_row[x] < 0) | (above_row[x] < 0)
    half, one, unknown = np.float32(0.5), np.float32(1), np.float32(np.nan)
    for x in range(width):
        least, best = np.int32(least_row[x]), np.int32(best_row[x])
        below, above = np.int32(below_row[x]), np.int32(above_row[x])
        lead = np.float32(np.int32(second_row[x]) - least) * scale
        bend = np.float32(max(max(below, above) - least, np.int32(1)))
        disparity = np.float32(best) + half * np.float32(below - above) / bend
        mutual = abs(disparity - np.float32(chosen_row[x])) <= one
        inside = (best <= np.int32(x)) & (np.int32(x) - best < np.int32(width))
        possible = (below >= 0) & (above >= 0) & inside
        good = possible & (lead >= least_uniqueness) & mutual
        disparity_row[x] = disparity if good else unknown
        any_row[x] = disparity if possible else unknown
        uniqueness[x] = lead
