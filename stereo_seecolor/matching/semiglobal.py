"""Semi-global matching (Hirschmueller 2008) of census images, each tile of the image over its own band of disparities.

Tiles of TILE x TILE pixels search ``lowest .. lowest + count - 1``, count a multiple of LANES. Paths run right, down, left
and up; between tiles of different bands a path carries over what the bands share (Rothermel et al. 2012, tSGM). The image
is cut into strips of rows that are matched alone, each with rows beyond its ends to let the vertical paths settle: memory
stays small, strips go to threads, and the result does not depend on how many there are.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereo_seecolor.data import Map
from stereo_seecolor.matching.vectors import (
    FAR,
    LANES,
    add,
    add3,
    claim,
    hamming,
    path_step,
    path_step_alone,
    shift,
    smallest,
    smallest_but,
)

TILE = 8
SHIFTED = 1
"""Place in the scratch of the costs of a pixel whose band differs, brought to where the next one looks for them."""

NEVER = -0x8000

_compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = njit(cache=True, nogil=True, boundscheck=False)

_inlined: Callable[[Callable[..., Any]], Callable[..., Any]] = njit(cache=True, nogil=True, boundscheck=False, forceinline=True)


@_compiled
def match_rows(
    left: NDArray[np.uint32],
    right: NDArray[np.uint32],
    offset: int,
    lowest: NDArray[np.int32],
    count: NDArray[np.int32],
    rows: tuple[int, int, int, int],
    jump: NDArray[np.uint16],
    P1: int,
    P2: int,
    disparity: Map,
    rival: Map,
    back: Map,
) -> None:
    """Fill rows[1]..rows[2]-1 of the three maps from rows[0]..rows[3]-1 of the census images.

    left: (H, W). right: (H, offset + W + ...) mirrored, the pixel x at column offset + W - 1 - x, zero where nothing was seen.
    jump: (2, H + 1, W + 1) what a jump costs from the pixel above, and from the pixel to the left.
    disparity: of the left image, with the parabola's fraction; NaN where the best lies on the edge of its band.
    rival: how much worse the best disparity beyond +-1 is, as a share of P2. back: whole disparity of the right image,
    from the same costs, NaN where no left pixel looked.
    """
    start, first, end, stop = rows
    width = left.shape[1]
    origin = offset + width - 1
    tile_row = start // TILE
    bands, lengths = _layout(lowest, count, tile_row, (stop - 1) // TILE - tile_row + 1, width)
    row_places = np.zeros(end - first + 1, np.int64)
    for row in range(end - first):
        row_places[row + 1] = row_places[row] + lengths[(first + row) // TILE - tile_row]
    total = np.empty(row_places[-1], np.uint16)
    cost = np.empty(count.max(), np.uint16)
    along = _scratch(cost.size)
    along_next = along + lengths.max()
    paths = np.full(along_next + lengths.max() + LANES, FAR, np.uint16)
    floors = np.zeros(width, np.uint16)
    claims = np.empty(right.shape[1], np.uint16), np.empty(right.shape[1], np.int16)
    nothing = np.zeros_like(bands[0])
    for sweep in range(2):
        before = nothing
        for step in range(end - start if sweep == 0 else stop - first):
            y = start + step if sweep == 0 else stop - 1 - step
            band = bands[y // TILE - tile_row]
            inside = first <= y < end
            row_place = row_places[y - first] if inside else -1
            _follow(
                sweep,
                left[y],
                right[y],
                origin,
                band,
                before,
                along,
                along_next,
                row_place,
                paths,
                floors,
                cost,
                total,
                jump[0, y + sweep],
                jump[1, y],
                P1,
            )
            along, along_next, before = along_next, along, band
            if sweep == 1 and inside:
                _decide(total, row_place, band, origin, P2, claims, disparity[y], rival[y], back[y])


@_compiled
def _layout(lowest: NDArray[np.int32], count: NDArray[np.int32], tile_row: int, tiles: int, width: int) -> Any:
    """(tiles, 3, W): each pixel's lowest disparity, count, and place in a row of costs (a guard cell between); row lengths."""
    bands, lengths = np.empty((tiles, 3, width), np.int64), np.empty(tiles, np.int64)
    for tile in range(tiles):
        place = 1
        for x in range(width):
            bands[tile, 0, x] = lowest[tile_row + tile, x // TILE]
            bands[tile, 1, x] = count[tile_row + tile, x // TILE]
            bands[tile, 2, x] = place
            place += bands[tile, 1, x] + 1
        lengths[tile] = place
    return bands, lengths


@_compiled
def _scratch(most: int) -> int:
    """Cells of ``paths`` before the vertical ones: two pixels of the horizontal path and a shifted one, with their guards.

    The shifted one is written LANES at a time, and so past its end.
    """
    return 3 * (most + 2) + LANES


@_compiled
def _follow(
    sweep: int, bits: Any, others: Any, origin: int, band: Any, band_before: Any, along: int, along_next: int, row_place: int,
    paths: Any, floors: Any, cost: Any, total: Any, jump_along: Any, jump_across: Any, P1: int,
) -> None:  # fmt: skip
    """Take the vertical path from the row before to this one and, for a row inside the strip, the horizontal one along it.

    sweep 0 goes right and down and sets total, sweep 1 goes left and up and adds to it. Arrays are not swapped but places in
    one array are: numba would count references for each pixel.
    """
    width = bits.size
    across, across_next = SHIFTED + cost.size + 2 + LANES, SHIFTED + 2 * (cost.size + 2) + LANES
    p1 = np.uint16(P1)
    floor, low_before, count_before = np.uint16(0), 0, 0
    for column in range(width):
        x = column if sweep == 0 else width - 1 - column
        low, count, place = band[0, x], band[1, x], band[2, x]
        met = origin - x + low
        hamming(bits[x], others, met, cost, 0)
        for k in range(LANES, count, LANES):
            hamming(bits[x], others, met + k, cost, k)
        before, now = along + band_before[2, x], along_next + place
        if low != band_before[0, x] or count != band_before[1, x]:
            before = _shift(paths, before, band_before[0, x], band_before[1, x], low, count)
        floors[x] = _advance(paths, before, cost, now, count, floors[x], p1, jump_along[x])
        if row_place < 0:
            continue
        before = across
        if low != low_before or count != count_before:
            before = _shift(paths, across, low_before, count_before, low, count)
        floor = _advance(paths, before, cost, across_next, count, floor, p1, jump_across[x + sweep])
        low_before, count_before = low, count
        at = row_place + place
        if sweep == 0:
            add(paths, across_next, paths, now, total, at)
            for k in range(LANES, count, LANES):
                add(paths, across_next + k, paths, now + k, total, at + k)
        else:
            add3(paths, across_next, now, total, at)
            for k in range(LANES, count, LANES):
                add3(paths, across_next + k, now + k, total, at + k)
        across, across_next = across_next, across


@_compiled
def _shift(paths: Any, before: int, low_before: int, count_before: int, low: int, count: int) -> int:
    """Copy the costs of the pixel before, over its own band, to where the band low.. of this pixel finds them."""
    for k in range(-1, count + 1, LANES):
        i = k + low - low_before
        if -LANES < i < count_before:
            shift(paths, before, i, count_before, SHIFTED + k)
        else:
            shift(paths, SHIFTED, 0, 0, SHIFTED + k)
    return SHIFTED


@_inlined
def _advance(paths: Any, before: int, cost: Any, now: int, count: int, floor: Any, P1: Any, P2: Any) -> Any:
    """One step of a path, from paths[before:] to paths[now:]; returns the new floor."""
    if count == LANES and before != SHIFTED:
        return path_step_alone(paths, before, cost, 0, paths, now, floor, P1, P2)
    least = np.uint16(FAR)
    for k in range(0, count, LANES):
        least = min(least, path_step(paths, before + k, cost, k, paths, now + k, floor, P1, P2))
    paths[now - 1] = paths[now + count] = FAR
    return np.uint16(least)


@_compiled
def _decide(
    total: Any, row_place: int, band: Any, origin: int, P2: int, claims: Any, disparity: Any, rival: Any, back: Any
) -> None:
    """One row: the best disparity of each left pixel and, among all that look at it, of each right one."""
    width = disparity.size
    least, best = claims
    least[:] = 0xFFFF
    best[:] = NEVER
    scale = np.float32(1 / P2)
    for x in range(width):
        low, count, at = band[0, x], band[1, x], row_place + band[2, x]
        disparity[x], rival[x] = _winner(total, at, low, count, scale)
        for k in range(0, count, LANES):
            claim(total, at + k, least, best, origin - x + low + k, np.int16(low + k))
    for x in range(width):
        found = best[origin - x]
        back[x] = found if found > NEVER else np.nan


@_inlined
def _winner(total: NDArray[np.uint16], at: int, low: int, count: int, scale: Any) -> Any:
    """The disparity of least cost with its fraction, and its lead over the best beyond +-1."""
    key = int(smallest(total, at))
    least, best = key >> 4, key & 15
    for k in range(LANES, count, LANES):
        key = int(smallest(total, at + k))
        if key >> 4 < least:
            least, best = key >> 4, k + (key & 15)
    second = int(smallest_but(total, at, np.int16(best)))
    for k in range(LANES, count, LANES):
        second = min(second, int(smallest_but(total, at + k, np.int16(best - k))))
    lead = np.float32(second - least) * scale
    if best == 0 or best == count - 1:
        return np.float32(np.nan), lead
    below, above = np.int32(total[at + best - 1]), np.int32(total[at + best + 1])
    bend = np.float32(max(below, above) - least)
    fraction = np.float32(0.5) * np.float32(below - above) / bend if bend > 0 else np.float32(0)
    return np.float32(low + best) + fraction, lead


@_compiled
def compare_rows(disparity: Map, rival: Map, back: Map, least: float, most_px: float) -> None:
    """NaN in disparity where its lead over its rival is under ``least``, or back, of the right image, is not within most_px."""
    height, width = disparity.shape
    least32, most32 = np.float32(least), np.float32(most_px)
    for y in range(height):
        for x in range(width):
            here = disparity[y, x]
            met = np.float32(x) - here
            agrees = False
            if rival[y, x] >= least32 and met >= np.float32(-0.5) and met <= np.float32(width) - np.float32(0.5):
                agrees = abs(here - back[y, np.int64(np.rint(met))]) <= most32
            if not agrees:
                disparity[y, x] = np.nan
