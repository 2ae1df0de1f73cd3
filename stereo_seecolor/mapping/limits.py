"""What the settings would cost, before it is spent: absurd ones are refused with the number and what to set instead."""

import os
from dataclasses import dataclass

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.recovered_frames import Frames, Unplaced
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.tiles import Tiling


@dataclass(frozen=True)
class Limits:
    """What is too much."""

    pixels_a_voxel: float = 1 / 8  # edge of a voxel in pixels on the bottom: finer ones hold nothing that the images show
    voxels_a_range: float = 4.0  # truncation: a voxel larger than a quarter of the range reaches into the cameras
    block_bytes: int = 20_000  # of a block of 8^3 voxels: 24 a voxel for fusion, 13 for the extraction, the rest for triangles
    square_cell_bytes: int = 120  # of a terrain cell while its square is measured: 15 float64
    tile_cell_bytes: int = 32  # of a terrain cell while a tile is drawn: its height, twice, and coordinates
    cells: float = 4e9  # of a mosaic or terrain: 16 GB on disk, a day's work
    memory_fraction: float = 0.5  # of the machine's memory that one map may take
    float32_reach: float = 2.0**20  # voxels from the origin: an eighth of a voxel is float32's resolution there


LIMITS = Limits()


def check_voxel(frames: Frames, geometry: RectifiedPair, voxel_m: float) -> None:
    """Raise MappingError for voxels that fit neither the images' resolution nor the scene; the first frame with ranges decides."""
    for number in range(len(frames)):
        frame = frames[number]
        range_m = np.zeros(0) if isinstance(frame, Unplaced) else frame.range_m[np.isfinite(frame.range_m)]
        if range_m.size:
            break
    else:
        return
    typical_m = float(np.median(range_m))
    finest_m = LIMITS.pixels_a_voxel * typical_m / geometry.focal_px
    if voxel_m < finest_m:
        raise MappingError(
            f"mapping.voxel_m={voxel_m:g}: a pixel of these images covers {1000 * typical_m / geometry.focal_px:.2g} mm at "
            f"{typical_m:.2g} m; finer voxels than an eighth of that hold nothing: set it to at least {finest_m:.2g}"
        )
    if voxel_m > typical_m / LIMITS.voxels_a_range:
        raise MappingError(
            f"mapping.voxel_m={voxel_m:g}: the scene is {typical_m:.2g} m away: set it to at most "
            f"{typical_m / LIMITS.voxels_a_range:.2g}"
        )


def check_extent(component: Component, voxel_m: float) -> None:
    """Raise MappingError for a survey too long for its voxels."""
    if component.reach_m > LIMITS.float32_reach * voxel_m:
        raise MappingError(
            f"a part of the survey reaches {component.reach_m / 1000:.3g} km from its middle, more than {LIMITS.float32_reach:.0f} "
            f"voxels: set mapping.voxel_m to at least {component.reach_m / LIMITS.float32_reach:.2g}"
        )


def check_tiling(tiling: Tiling, config: MappingConfig) -> None:
    """Raise MappingError where memory or disk would not hold the tiles, the rasters or the squares of the metrics."""
    block_m, cell_m, available = BLOCK * tiling.voxel_m, config.terrain_cell_m, LIMITS.memory_fraction * memory_bytes()
    needed = LIMITS.block_bytes * max((len(tile.blocks) for tile in tiling.tiles), default=0)
    needed += LIMITS.tile_cell_bytes * min(tiling.tile_m / cell_m, block_m / cell_m * np.sqrt(tiling.columns) * 4) ** 2
    if needed > available:
        fit_m = max(tiling.tile_m * np.sqrt(available / needed), 2 * block_m)
        raise MappingError(
            f"a tile of {tiling.tile_m:.3g} m with voxels of {tiling.voxel_m:g} m and terrain cells of {cell_m:g} m needs about "
            f"{needed / 1e9:.3g} GB of memory, a map may take {available / 1e9:.3g}: set mapping.tile_m to {fit_m:.2g}, or larger "
            "mapping.voxel_m and mapping.dem_m"
        )
    for name, size_m in (("dem_m", cell_m), ("mosaic_m", config.mosaic_cell_m)):
        cells = tiling.columns * (block_m / size_m) ** 2
        if cells > LIMITS.cells:
            raise MappingError(
                f"mapping.{name}={size_m:g}: the map would have {cells:.2g} cells, at most {LIMITS.cells:.0e} are made: set it to "
                f"at least {size_m * np.sqrt(cells / LIMITS.cells):.2g}"
            )
    square = (config.square_m / cell_m) ** 2 * LIMITS.square_cell_bytes
    if square > available:
        raise MappingError(
            f"mapping.metrics_m={config.square_m:g}: a square of terrain cells of {cell_m:g} m needs about {square / 1e9:.3g} GB "
            f"of memory, a map may take {available / 1e9:.3g}: set it to at most "
            f"{config.square_m * np.sqrt(available / square):.2g}"
        )


def memory_bytes() -> float:
    """The machine's memory; 8 GB where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 8e9
