"""Removal of small connected surfaces that touch nothing else: they are fish, or mismatches."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tile_store import TileStore
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling

MIN_ISLAND_M2 = 0.05
"""Area, m^2, below which a lone surface is not taken for the bottom: a sheet of paper."""
BORDER_VOXELS = 0.5
"""Two tiles share points on the plane between them alone, which passes through corners of voxels;
float32 moves them by less.
"""


def near_border(points_m: NDArray[np.float32], tiling: Tiling) -> NDArray[np.bool_]:
    """Mark the points that a neighboring tile may hold as well: (V,) bool of points (V, 3)."""
    tiles = points_m[:, :2] / tiling.tile_m
    return np.asarray(
        (np.abs(tiles - np.rint(tiles)) * tiling.tile_m < BORDER_VOXELS * tiling.voxel_m).any(
            axis=1
        )
    )


def drop(store: TileStore, tiling: Tiling) -> None:
    """Remove the islands from the tiles of a store. Raises OutputError."""
    on_cores = Threads(cores())
    parts = on_cores.each(lambda tile: _parts(store.load(tile), tiling), tiling.tiles)

    def remove(found: tuple[Tile, NDArray[np.bool_]]) -> None:
        tile, kept = found
        if not kept.all():
            surface = store.load(tile)
            store.save(tile, surface.only(kept[surface.parts]))

    for _ in on_cores.each(remove, zip(tiling.tiles, _kept(parts), strict=True)):
        pass


_TileParts = tuple[NDArray[np.float64], list[tuple[bytes, int]]]
"""The areas (P,) of the connected parts of a tile, square meters; points that a neighboring tile
may hold, and the part of each.
"""


def _parts(surface: Surface, tiling: Tiling) -> _TileParts:
    part = surface.parts
    count = int(part.max(initial=-1)) + 1
    areas_m2 = np.bincount(part[surface.triangles[:, 0]], surface.areas_m2, minlength=count)
    on_border = np.flatnonzero(near_border(surface.points_m, tiling))
    border = [(surface.points_m[i].tobytes(), int(part[i])) for i in on_border]
    return areas_m2.astype(np.float64), border


def _kept(tiles: Iterable[_TileParts]) -> list[NDArray[np.bool_]]:
    """For each tile, which of its connected parts, with those of other tiles, are large."""
    areas: list[NDArray[np.float64]] = []
    joined: list[tuple[int, int]] = []
    part_at_border: dict[bytes, int] = {}
    count = 0  # of parts so far; each tile's are numbered on from there
    for areas_m2, border in tiles:
        for point, part in border:
            number = count + part
            joined.append((number, part_at_border.setdefault(point, number)))
        areas.append(areas_m2)
        count += len(areas_m2)
    if not count:
        return [np.zeros(0, np.bool_) for _ in areas]
    ends = np.array(joined, np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), (count, count))
    surface_of_part = connected_components(graph, directed=False)[1]
    kept = np.bincount(surface_of_part, np.concatenate(areas))[surface_of_part] >= MIN_ISLAND_M2
    if not kept.any():  # a map of scraps is better than none
        kept[:] = True
    return list(np.split(kept, np.cumsum([len(a) for a in areas])[:-1]))
