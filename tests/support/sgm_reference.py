"""The semi-global search as its papers say it, one pixel at a time: slow, and what the compiled
search must equal to the bit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FAR = 10_000
TILE = 8
NEIGHBORS = [
    (dy, dx)
    for dy in (-3, -1, 0, 1, 3)
    for dx in range(-3, 4)
    if (dy + dx) % 2 == 0 and (dy, dx) != (0, 0)
]
NEIGHBORS += [(0, 1), (0, -1), (1, 0), (-1, 0)]


@dataclass(frozen=True)
class Settings:
    p2: int
    p2_least: int
    texture_levels: float
    edge_levels: float
    ambiguous: float
    strip: int
    halo: int
    band_edge_pixels: float
    band_edge_tiles: float
    widening: int


def census(image: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """(H, W, 22) which neighbors are darker (Zabih and Woodfill 1994)."""
    height, width = image.shape
    padded = np.pad(image, 3, mode="edge")
    shifted = [padded[3 + dy : 3 + dy + height, 3 + dx : 3 + dx + width] for dy, dx in NEIGHBORS]
    return np.stack([other < image for other in shifted], axis=-1)


def penalty(
    image: NDArray[np.uint16], a: tuple[int, int], b: tuple[int, int], settings: Settings
) -> int:
    """P2 between two neighboring pixels."""
    change = max(
        np.float32(abs(int(image[a]) - int(image[b]))) - np.float32(256 * settings.texture_levels),
        np.float32(0),
    )
    p2 = np.float32(settings.p2) / (
        np.float32(1) + change * np.float32(1 / (256 * settings.edge_levels))
    )
    return int(max(p2, np.float32(settings.p2_least)))


def step(before: dict[int, int], costs: dict[int, int], p2: int) -> dict[int, int]:
    """One step of a path (Hirschmueller 2008, eq. 13), P1 a quarter of P2.

    Disparities that the pixel before did not search are far.
    """
    p1 = p2 // 4
    known = {d: before.get(d, FAR) for d in costs}
    floor = min(known.values())
    if floor == FAR:
        return dict(costs)
    return {
        d: costs[d]
        + min(known[d], known.get(d - 1, FAR) + p1, known.get(d + 1, FAR) + p1, floor + p2)
        - floor
        for d in costs
    }


def search(
    left: NDArray[np.uint16],
    right: NDArray[np.uint16],
    lowest: NDArray[np.int32],
    count: NDArray[np.int32],
    settings: Settings,
) -> NDArray[np.float32]:
    """(3, H, W) disparity where the checks pass, best disparity, and uniqueness, of two gray
    images.

    Each tile's disparities are lowest..lowest + count - 1.
    """
    found = np.empty((3, *left.shape), np.float32)
    bits = census(left), census(right)
    for first in range(0, len(left), settings.strip):
        end = min(first + settings.strip, len(left))
        rows = slice(first, end)
        tiles = slice(first // TILE, -(-end // TILE))
        found[:, rows], on_edge = _strip(left, bits, (lowest, count), (first, end), settings)
        narrow = on_edge > settings.band_edge_pixels * TILE**2
        if narrow[tiles].mean() > settings.band_edge_tiles:
            wider = lowest - settings.widening * narrow, count + 2 * settings.widening * narrow
            found[:, rows], _ = _strip(left, bits, wider, (first, end), settings)
    return found


def _strip(left, bits, band, rows, settings):
    height, width = left.shape
    first, end = rows
    top, bottom = max(0, first - settings.halo), min(height, end + settings.halo)
    costs = {(y, x): _costs(bits, band, y, x) for y in range(top, bottom) for x in range(width)}
    sums = {(y, x): dict.fromkeys(costs[y, x], 0) for y in range(first, end) for x in range(width)}
    for (dy, dx), (begin, stop) in {
        (0, 1): rows,
        (0, -1): rows,
        (1, 0): (top, end),
        (-1, 0): (first, bottom),
    }.items():
        paths: dict[tuple[int, int], dict[int, int]] = {}
        for y in range(begin, stop)[:: dy or 1]:
            for x in range(width)[:: dx or 1]:
                past = (y - dy, x - dx)
                known = past in paths
                paths[y, x] = (
                    step(paths[past], costs[y, x], penalty(left, past, (y, x), settings))
                    if known
                    else costs[y, x]
                )
                if (y, x) in sums:
                    sums[y, x] = {d: total + paths[y, x][d] for d, total in sums[y, x].items()}
    found = [
        _row({x: sums[y, x] for x in range(width)}, width, settings) for y in range(first, end)
    ]
    on_edge = np.zeros(band[0].shape, int)
    for y, (_, edges) in zip(range(first, end), found, strict=True):
        for x in edges:
            on_edge[y // TILE, x // TILE] += 1
    return np.stack([row for row, _ in found], axis=1), on_edge


def _costs(bits, band, y, x):
    lowest, count = (int(each[y // TILE, x // TILE]) for each in band)
    left, right = bits
    nothing = np.zeros(left.shape[2], bool)  # beyond the right image
    inside = range(left.shape[1])
    return {
        d: int((left[y, x] != (right[y, x - d] if x - d in inside else nothing)).sum())
        for d in range(lowest, lowest + count)
    }


def _row(sums, width, settings):
    """A row's disparities, checked and all, and uniqueness; and its pixels whose best disparity
    ends its band.
    """
    claims: dict[int, tuple[int, int]] = {}
    for x, of_pixel in sums.items():
        for d, total in of_pixel.items():
            claims[x - d] = min(claims.get(x - d, (total, d)), (total, d))
    disparity, best_found, uniqueness = row = np.full((3, width), np.nan, np.float32)
    edges = []
    for x, of_pixel in sums.items():
        least, best = min((total, d) for d, total in of_pixel.items())
        uniqueness[x] = np.float32(
            min(total for d, total in of_pixel.items() if abs(d - best) > 1) - least
        ) * np.float32(1 / settings.p2)
        if best - 1 not in of_pixel or best + 1 not in of_pixel:
            edges.append(x)
            continue
        below, above = of_pixel[best - 1], of_pixel[best + 1]
        found = np.float32(best) + np.float32(0.5) * np.float32(below - above) / np.float32(
            max(max(below, above) - least, 1)
        )
        mutual = abs(found - np.float32(claims[x - best][1])) <= 1
        if 0 <= x - best < width:
            best_found[x] = found
            if mutual and uniqueness[x] >= np.float32(settings.ambiguous):
                disparity[x] = found
    return row, edges
