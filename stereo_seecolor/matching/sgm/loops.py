"""The steps of ``vectors.py`` as plain loops: the same results, for versions of numba that
``vectors.py`` was not tested with.

Arguments are those of the functions of the same name there.
"""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.sgm.band import BLOCK, FAR, LANES, P1_SHIFT, PIXELS, TILE


@compiled(inline=True)
def hamming(bits: Any, others: Any, i: int, cost: Any, c: int) -> None:
    """Costs of one pixel against LANES others."""
    for lane in range(LANES):
        different = bits ^ others[i + lane]
        different -= (different >> np.uint32(1)) & np.uint32(0x55555555)
        different = (different & np.uint32(0x33333333)) + (
            (different >> np.uint32(2)) & np.uint32(0x33333333)
        )
        different = (different + (different >> np.uint32(4))) & np.uint32(0x0F0F0F0F)
        cost[c + lane] = np.uint32(different * np.uint32(0x01010101)) >> np.uint32(24)


@compiled(inline=True)
def step(
    paths: Any,
    before: int,
    now: int,
    cost: Any,
    c: int,
    cost_stride: int,
    p2: Any,
    j: int,
    p2_stride: int,
) -> None:
    """One step of four pixels with LANES disparities each."""
    step_of_many(paths, 0, before, 0, before, now, cost, c, cost_stride, p2, j, p2_stride)


@compiled(inline=True)
def steps(
    paths: Any, at: int, cost: Any, c: int, along: Any, onward: int, stride: int,
    p2: Any, j: int, j_onward: int, p2_stride: int,
) -> None:  # fmt: skip
    """TILE steps of TILE rows."""
    for turn in range(TILE):
        row, p2_row = c + turn * onward, j + turn * j_onward
        for half in range(0, TILE, PIXELS):
            block = at + half * LANES
            step(
                paths,
                block,
                block,
                cost,
                row + half * stride,
                stride,
                p2,
                p2_row + half * p2_stride,
                p2_stride,
            )
            scatter(paths, block, along, row + half * stride, stride)


@compiled
def step_of_many(
    paths: Any, below: int, before: int, above: int, floor: int, now: int,
    cost: Any, c: int, cost_stride: int, p2: Any, j: int, p2_stride: int,
) -> None:  # fmt: skip
    """One step of one block of several."""
    p2_flat = p2.reshape(p2.size)
    far = np.uint16(FAR)
    line = np.empty(LANES + 2, np.uint16)
    for pixel in range(PIXELS):
        piece = pixel * LANES
        least = far
        for lane in range(LANES):
            least = min(least, np.uint16(paths[floor + piece + lane]))
            line[lane + 1] = paths[before + piece + lane]
        line[0], line[LANES + 1] = paths[below + piece + LANES - 1], paths[above + piece]
        p2_here = np.uint16(p2_flat[j + pixel * p2_stride])
        p1, highest = np.uint16(p2_here >> np.uint16(P1_SHIFT)), np.uint16(least + p2_here)
        for lane in range(LANES):
            slope = np.uint16(min(line[lane], line[lane + 2]) + p1)
            best = min(min(line[lane + 1], slope), highest)
            paths[now + piece + lane] = np.uint8(
                best - least + cost[c + pixel * cost_stride + lane]
            )


@compiled(inline=True)
def fold(paths: Any, i: int, j: int, least: int) -> None:
    """The least of two blocks."""
    for lane in range(BLOCK):
        paths[least + lane] = min(paths[i + lane], paths[j + lane])


@compiled(inline=True)
def scatter(paths: Any, i: int, rows: Any, r: int, stride: int) -> None:
    """The pieces of a block to rows."""
    for pixel in range(PIXELS):
        for lane in range(LANES):
            rows[r + pixel * stride + lane] = paths[i + pixel * LANES + lane]


@compiled(inline=True)
def add(a: Any, i: int, b: Any, j: int, total: Any, t: int) -> None:
    """The sum of two blocks."""
    for lane in range(BLOCK):
        total[t + lane] = np.uint8(a[i + lane] + b[j + lane])


@compiled(inline=True)
def add_wide(a: Any, i: int, b: Any, j: int, c: Any, k: int, total: Any, t: int) -> None:
    """The sum of three blocks, 16 bits wide."""
    for lane in range(BLOCK):
        total[t + lane] = np.uint16(a[i + lane] + b[j + lane] + c[k + lane])


@compiled
def slide(a: Any, low: int, high: int, by: int, t: int) -> None:
    """A piece from two."""
    for lane in range(LANES):
        source = lane + by
        a[t + lane] = a[low + source] if source < LANES else a[high + source - LANES]


@compiled
def winners(sums: Any, i: int, low: Any, facts: Any, x: int, stride: int) -> None:
    """The best disparity of each pixel of a tile, and the sums around it."""
    rows = facts.reshape(facts.size)
    for pixel in range(TILE):
        piece = i + pixel * LANES
        key = int(smallest(sums, piece))
        best = key & (LANES - 1)
        place = x + pixel
        rows[place] = low + best
        rows[place + stride] = key >> 4
        rows[place + 2 * stride] = smallest_but(sums, piece, best)
        rows[place + 3 * stride] = sums[piece + best - 1] if best > 0 else -1
        rows[place + 4 * stride] = sums[piece + best + 1] if best < LANES - 1 else -1


@compiled(inline=True)
def smallest(a: Any, i: int) -> Any:
    """The least of LANES and its lane."""
    least = np.uint32(0xFFFFFFFF)
    for lane in range(LANES):
        least = min(least, np.uint32(np.uint32(a[i + lane]) << np.uint32(4) | np.uint32(lane)))
    return least


@compiled(inline=True)
def smallest_but(a: Any, i: int, center: int) -> Any:
    """The least of LANES without those around the center."""
    least = np.uint16(0xFFFF)
    for lane in range(LANES):
        least = min(least, np.uint16(0xFFFF) if abs(lane - center) <= 1 else a[i + lane])
    return least


@compiled
def claim(sums: Any, i: int, first: Any, best: Any, j: int) -> None:
    """Each pixel of the right image keeps the least sum that looks at it, and its disparity."""
    for pixel in range(TILE):
        for lane in range(LANES):
            total = np.uint32(sums[i + pixel * LANES + lane])
            key = np.uint32(total << np.uint32(16) | np.uint32(first + lane + 0x8000))
            best[j - pixel + lane] = min(best[j - pixel + lane], key)
