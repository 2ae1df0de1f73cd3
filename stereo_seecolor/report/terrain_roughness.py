"""The roughness of a map's terrain without the noise of its heights, for the page: of each square,
and of the site.

The terrain stays on disk. Frames are read one after the other, and what they say of each cell is
summed there; then parts of the terrain are measured, with as much around as that reaches over.
Memory does not grow with the map, but for some numbers a square.
"""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.grid import Grid, widened
from stereo_seecolor.mapping.raster.height_errors import REACH_CELLS
from stereo_seecolor.mapping.raster.noise import averaged, blur_reach, observed
from stereo_seecolor.mapping.raster.structure import (
    SitePart,
    StructureAtScale,
    resolved_cells,
    structure_of,
    windows_of,
)
from stereo_seecolor.mapping.raster.terrain import Terrain
from stereo_seecolor.records import Array
from stereo_seecolor.report.map_images import TerrainImages
from stereo_seecolor.report.squares import Place, Window, roughness_without_noise, squared_roughness
from stereo_seecolor.report.terrain_views import correlation_of, noise_of, views_of
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

PART_CELLS = 768
"""Edge of the parts, cells: with squares of a hundred cells, 180 MB are in memory at once."""
DRAWS = 8
"""Of errors: standard errors are known to a quarter."""


@dataclass(frozen=True, eq=False)
class TerrainRoughness:
    """The roughness of a terrain.

    scale_m: edge of the cells that are measured. squares: of each square of which enough is known,
    its ROUGHNESS (4,) and the standard errors (4,); empty where no frame saw it. structure:
    of the squares of the largest edge that the site holds; None without any.
    """

    scale_m: float
    squares: dict[Place, tuple[Array, Array]]
    structure: StructureAtScale | None


def terrain_roughness(
    posed: PosedRun,
    frames: SurveyFrames,
    images: TerrainImages,
    square_m: float,
    edges_m: Sequence[float],
) -> TerrainRoughness:
    """Measure the terrain of a map. frames: of the map. square_m: edge of the squares. edges_m:
    those of which the structure's is chosen. Raises InputError where the terrain or a frame of the
    map is damaged, OutputError.
    """
    with tempfile.TemporaryDirectory() as folder:
        terrain = _TerrainOnDisk.of(posed, frames, images, Path(folder))
        cell_m = terrain.grid.cell_m
        cells = resolved_cells(terrain.correlation_m, cell_m)
        held = [edge_m for edge_m in sorted(edges_m) if terrain.holds(edge_m, cells)][-1:]
        return _measured(terrain, max(3, round(square_m / cell_m)), held, cells)


@dataclass(frozen=True, eq=False)
class _TerrainOnDisk:
    """Heights in dem.tif, in the map's own coordinates, and the summed weights of the views, of
    which there may be none.
    """

    grid: Grid
    images: TerrainImages
    up_m: float
    weights: BlockRaster
    is_seen: bool
    correlation_m: float

    @classmethod
    def of(
        cls, posed: PosedRun, frames: SurveyFrames, images: TerrainImages, folder: Path
    ) -> "_TerrainOnDisk":
        grid, up_m = images.grid.moved(-posed.offset_m), posed.offset_m[2]
        weights = BlockRaster(folder, grid, 1, np.float32, 0)
        empty = cls(grid, images, up_m, weights, False, 0.0)
        footprints_m = []
        for view in views_of(posed, frames, grid, empty.heights_m, np.eye(4)):
            if view.seen.any():
                sums = weights.read(*view.window)
                weights.write(*view.window, sums + view.weight.astype(np.float32))
                footprints_m.append(view.footprint_m)
        correlation_m = correlation_of(footprints_m, grid)
        return cls(grid, images, up_m, weights, bool(footprints_m), correlation_m)

    def heights_m(self, window: Window) -> Array:
        """(h, w) of a window, NaN where unknown."""
        rows, columns = window
        box = columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start
        return self.images.heights_m(box).astype(np.float64) - self.up_m

    def terrain(self, window: Window) -> Terrain:
        """A window of the terrain, without colors."""
        height_m = self.heights_m(window)
        no_color = np.broadcast_to(np.float32(np.nan), (*height_m.shape, 3))
        return Terrain(self.grid.window(*window), height_m, no_color)

    def noise_m(self, window: Window, known: NDArray[np.bool_]) -> Array:
        """(h, w) standard errors of the heights of a window, by those of the ranges."""
        return noise_of(self.weights.read(*window)[0].astype(np.float64), known)

    def parts(self, cells: int, before: int, after: int) -> Iterator[tuple[Window, Window]]:
        """Windows of all parts: each with as many cells around as are asked for, in whole blocks of
        ``cells``; and the part itself, counted therein.
        """
        edge, before = -(-PART_CELLS // cells) * cells, -(-before // cells) * cells
        rows, columns = (
            [slice(first, min(first + edge, length)) for first in range(0, length, edge)]
            for length in self.grid.shape
        )
        return (widened(part, before, after, self.grid.shape) for part in product(rows, columns))

    def holds(self, edge_m: float, cells: int) -> bool:
        """Whether the terrain holds a square of that edge that was seen well enough."""
        scale_m = cells * self.grid.cell_m
        edge = round(edge_m / scale_m) * cells
        for around, own in self.parts(cells, 0, edge):
            known = np.isfinite(averaged(self.heights_m(around), cells))
            first = around[0].start // cells, around[1].start // cells
            if known.size and windows_of(known, scale_m, edge_m, first, _coarse(own, cells)):
                return True
        return False


def _measured(
    terrain: _TerrainOnDisk, size: int, edges_m: Sequence[float], cells: int
) -> TerrainRoughness:
    """size: edge of the squares, cells. edges_m: of the structure's squares, at most one."""
    cell_m = terrain.grid.cell_m
    scale_m, alike_cells = cells * cell_m, terrain.correlation_m / cell_m
    reach = max(blur_reach(alike_cells, cells), REACH_CELLS)
    largest = max([size, *(round(edge_m / scale_m) * cells for edge_m in edges_m)])
    squares, mapped = dict[Place, tuple[Array, Array]](), list[Array]()
    sums, extremes_m2 = list[Array](), list[Array]()
    for seed, (around, own) in enumerate(terrain.parts(cells, reach, largest + reach)):
        part = terrain.terrain(around)
        if not part.known.any():
            continue
        noise_m = terrain.noise_m(around, part.known)
        first = around[0].start // cells, around[1].start // cells
        coarse = part.averaged(cells)
        within = _coarse(own, cells)
        site = SitePart(
            part,
            coarse,
            cells,
            {
                edge_m: windows_of(coarse.known, scale_m, edge_m, first, within)
                for edge_m in edges_m
            },
        )
        places = list(_squares_of(around, own, size)) if terrain.is_seen else []
        windows = [window for _, window in places]

        def both(heights: Array, site: SitePart = site, windows: list[Window] = windows) -> Array:
            own_squares = squared_roughness(heights, windows, cells, cell_m)
            return np.concatenate([own_squares, site.measured(heights)]) if edges_m else own_squares

        found = observed(both, part.height_m, noise_m, alike_cells, cells, DRAWS, seed)
        of_squares, of_site = np.split(found, [4 * len(windows)], axis=-1)
        if windows:
            values = zip(*roughness_without_noise(of_squares, alike_cells, cells), strict=True)
            squares |= dict(zip((place for place, _ in places), values, strict=True))
        if any(site.squares.values()):
            sums.append(of_site)
            extremes_m2.append(site.extreme_variances())
            mapped += site.mapped(np.full(coarse.grid.shape, np.nan))
    if not sums:
        return TerrainRoughness(scale_m, squares, None)
    found_of_site = structure_of(
        edges_m,
        scale_m,
        np.sum(sums, axis=0),
        [np.concatenate(mapped)],
        np.sum(extremes_m2, axis=0),
        alike_cells,
        cells,
    )
    return TerrainRoughness(scale_m, squares, found_of_site[0])


def _squares_of(around: Window, own: Window, size: int) -> Iterator[tuple[Place, Window]]:
    """The squares of so many cells, counted from the terrain's corner, whose first cell lies in a
    part, and their windows in it and what is around.
    """
    rows, columns = (
        range(-(-(a.start + o.start) // size), -(-(a.start + o.stop) // size))
        for a, o in zip(around, own, strict=True)
    )
    for row in rows:
        for column in columns:
            top, left = row * size - around[0].start, column * size - around[1].start
            yield (row, column), (slice(top, top + size), slice(left, left + size))


def _coarse(window: Window, cells: int) -> Window:
    """A window in cells that are so many times as large, of which it begins with a whole one."""
    rows, columns = (slice(each.start // cells, -(-each.stop // cells)) for each in window)
    return rows, columns
