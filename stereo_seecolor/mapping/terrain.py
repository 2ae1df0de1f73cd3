"""The terrain model: the highest of the fused surface over each cell."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.files import scratch_array
from stereo_seecolor.mapping.fusion import Surface
from stereo_seecolor.mapping.grid import Grid
from stereo_seecolor.mapping.raster import rasterize


def render_terrain(surfaces: Iterable[Surface], grid: Grid, scratch: Path) -> NDArray[np.float32]:
    """Heights (H, W) float32 metres, NaN where nothing was seen; kept in a file under ``scratch``, so that memory is bounded."""
    terrain = scratch_array(scratch / "terrain.npy", np.float32, grid.shape)
    terrain[:] = np.nan
    for surface in surfaces:
        if not len(surface.triangles):
            continue
        pixels = grid.pixels(surface.points_m)
        low = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
        high = np.ceil(pixels.max(axis=0)).astype(int) + 1
        window = terrain[low[1] : high[1], low[0] : high[0]]
        part = np.array(window)
        points = np.concatenate([pixels - low, surface.points_m[:, 2:]], axis=1).astype(np.float64)
        nothing = np.zeros((len(points), 0), np.float32)
        rasterize(points, nothing, surface.triangles, part, np.zeros((*part.shape, 0), np.float32))
        window[:] = part
    return terrain
