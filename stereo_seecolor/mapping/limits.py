"""Limits on what a map may cost: settings that exceed them are refused with better ones."""

import os
from dataclasses import dataclass

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.tiles import Tiling
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced


@dataclass(frozen=True)
class MapLimits:
    """The largest map that is begun."""

    # edge of a voxel in pixels on the bottom: finer ones hold nothing that the images show
    pixels_a_voxel: float = 1 / 8
    # truncation: a voxel larger than a quarter of the range reaches into the cameras
    voxels_a_range: float = 4.0
    # of a block of 8^3 voxels: 24 a voxel for fusion, 13 for the extraction, the rest for triangles
    block_bytes: int = 20_000
    square_cell_bytes: int = 120  # of a terrain cell while its square is measured: 15 float64
    # of a terrain cell while a tile is drawn: its height, twice, and coordinates
    tile_cell_bytes: int = 32
    cells: float = 4e9  # of a mosaic or terrain: 16 GB on disk, a day's work
    # fewer show nothing, and cells at the rim count as seen: a size in millimeters
    least_cells: float = 100.0
    square_cells: int = 3  # along an edge: slopes and curvatures need as many
    memory_fraction: float = 0.5  # of the machine's memory that one map may take
    # voxels from the origin: an eighth of a voxel is float32's resolution there
    float32_reach: float = 2.0**20


LIMITS = MapLimits()


def check_voxel(frames: Frames, geometry: RectifiedPair, voxel_m: float) -> None:
    """Raise MappingError for voxels that fit neither the images' resolution nor the scene; the
    first frame with ranges decides.
    """
    typical_m = _first_median_range_m(frames)
    if typical_m is None:
        return
    finest_m = LIMITS.pixels_a_voxel * typical_m / geometry.focal_px
    if voxel_m < finest_m:
        raise MappingError(
            f"mapping.voxel_m={voxel_m:g}: a pixel of these images covers "
            f"{1000 * typical_m / geometry.focal_px:.2g} mm at {typical_m:.2g} m; voxels "
            f"finer than an eighth of that stay empty: set it to at least {finest_m:.2g}"
        )
    if voxel_m > typical_m / LIMITS.voxels_a_range:
        raise MappingError(
            f"mapping.voxel_m={voxel_m:g}: the scene is {typical_m:.2g} m away: set it to at most "
            f"{typical_m / LIMITS.voxels_a_range:.2g}"
        )


def _first_median_range_m(frames: Frames) -> float | None:
    """The median range of the first frame that has any; None where none has."""
    for number in range(len(frames)):
        frame = frames[number]
        if not isinstance(frame, Unplaced):
            range_m = frame.range_m[np.isfinite(frame.range_m)]
            if range_m.size:
                return float(np.median(range_m))
    return None


def check_extent(component: Component, voxel_m: float) -> None:
    """Raise MappingError for a survey too long for its voxels."""
    if component.reach_m > LIMITS.float32_reach * voxel_m:
        raise MappingError(
            f"a part of the survey reaches {component.reach_m / 1000:.3g} km from its center, "
            f"more than {LIMITS.float32_reach:.0f} voxels: set mapping.voxel_m to at least "
            f"{component.reach_m / LIMITS.float32_reach:.2g}"
        )


def check_tiling(tiling: Tiling, config: MappingConfig) -> None:
    """Raise MappingError where memory or disk would not hold tiles, rasters or squares."""
    available_bytes = LIMITS.memory_fraction * memory_bytes()
    _check_tiles(tiling, config.terrain_cell_m, available_bytes)
    _check_cells(tiling, "dem_m", config.terrain_cell_m)
    _check_cells(tiling, "mosaic_m", config.mosaic_cell_m)
    _check_squares(config.square_m, config.terrain_cell_m, available_bytes)


def _check_tiles(tiling: Tiling, cell_m: float, available: float) -> None:
    """Raise MappingError where the largest tile, with its part of the terrain, does not fit into
    ``available`` bytes of memory.
    """
    block_m = BLOCK * tiling.voxel_m
    needed = LIMITS.block_bytes * max((len(tile.blocks) for tile in tiling.tiles), default=0)
    needed += (
        LIMITS.tile_cell_bytes
        * min(tiling.tile_m / cell_m, block_m / cell_m * np.sqrt(tiling.columns) * 4) ** 2
    )
    if needed > available:
        fit_m = max(tiling.tile_m * np.sqrt(available / needed), 2 * block_m)
        raise MappingError(
            f"a tile of {tiling.tile_m:.3g} m with voxels of {tiling.voxel_m:g} m and terrain "
            f"cells of {cell_m:g} m needs about {needed / 1e9:.3g} GB of memory, a map may take "
            f"{available / 1e9:.3g}: set mapping.tile_m to {fit_m:.2g}, or larger mapping.voxel_m "
            "and mapping.dem_m"
        )


def _check_cells(tiling: Tiling, setting: str, cell_m: float) -> None:
    """Raise MappingError where a raster of cells of ``cell_m``, set by mapping.``setting``, would
    have too few or too many of them.
    """
    cells = tiling.columns * (BLOCK * tiling.voxel_m / cell_m) ** 2
    if cells < LIMITS.least_cells:
        raise MappingError(
            f"mapping.{setting}={cell_m:g}: cells of so many meters are too large for this map: "
            f"set it to at most {cell_m * np.sqrt(cells / LIMITS.least_cells):.2g}"
        )
    if cells > LIMITS.cells:
        raise MappingError(
            f"mapping.{setting}={cell_m:g}: the map would have {cells:.2g} cells, at most "
            f"{LIMITS.cells:.0e} are made: set it to "
            f"at least {cell_m * np.sqrt(cells / LIMITS.cells):.2g}"
        )


def _check_squares(square_m: float, cell_m: float, available: float) -> None:
    """Raise MappingError for squares of too few cells, or beyond ``available`` bytes."""
    if round(square_m / cell_m) < LIMITS.square_cells:
        raise MappingError(
            f"mapping.metrics_m={square_m:g}: a square holds {LIMITS.square_cells} terrain cells "
            f"of {cell_m:g} m along its edge, at least: set it to at least "
            f"{LIMITS.square_cells * cell_m:g}"
        )
    needed = (square_m / cell_m) ** 2 * LIMITS.square_cell_bytes
    if needed > available:
        raise MappingError(
            f"mapping.metrics_m={square_m:g}: a square of terrain cells of {cell_m:g} m needs "
            f"about {needed / 1e9:.3g} GB of memory, a map may take {available / 1e9:.3g}: set it "
            f"to at most {square_m * np.sqrt(available / needed):.2g}"
        )


def memory_bytes() -> float:
    """The machine's memory; 8 GB where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 8e9
