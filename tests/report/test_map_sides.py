"""Sides of steps that the mesh of a map holds, tile by tile for the page."""

import zlib
from types import SimpleNamespace

import numpy as np
import pytest

from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.sides import area_over, sides_seen, step_m
from stereo_seecolor.report.map_sides import packed_sides
from stereo_seecolor.report.mesh_levels import MeshSource

CELL_M = 0.01


@pytest.mark.parametrize("sides", [True, False])
def test_tiles_hold_the_sides_of_the_whole(sides: bool) -> None:
    """Of boulders that stand across the border of two tiles, in a world off the map's own
    coordinates.
    """
    n, offset_m = 60, (100.0, 200.0, -5.0)
    x, y = np.meshgrid(*(np.arange(n) * CELL_M,) * 2)
    z = np.where(np.hypot(x - 0.3, y - 0.3) < 0.12, 0.1, 0.0)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate([corner[:, None] + [0, 1, n], corner[:, None] + [1, n + 1, n]])
    if not sides:
        triangles = triangles[np.ptp(points[:, 2][triangles], axis=1) < 0.05]
    mesh = MeshSource.of(points, np.zeros((n * n, 3), np.uint8), triangles)
    heights = z[::-1].astype(np.float32)
    grid = Grid(-CELL_M / 2, (n - 0.5) * CELL_M, CELL_M, (n, n))
    terrain = SimpleNamespace(
        grid=grid.moved(offset_m),
        heights_m=lambda box: heights[box[1] : box[1] + box[3], box[0] : box[0] + box[2]],
    )
    whole = sides_seen(
        heights.astype(np.float64), area_over(points, triangles, grid), CELL_M, step_m(CELL_M, 0.0)
    )
    assert whole.any() == sides
    for left, width in ((0, 32), (32, 28)):
        box = left, 0, width, n
        found = packed_sides(terrain, box, mesh, offset_m, 0.0)  # type: ignore[arg-type]
        expected = whole[:, left : left + width]
        assert bool(found) == expected.any()
        if found:
            bits = np.frombuffer(zlib.decompress(found["sides"]), np.uint8)
            np.testing.assert_array_equal(
                np.unpackbits(bits)[: n * width].reshape(n, width), expected
            )
