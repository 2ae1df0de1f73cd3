"""A picture of the map, drawn in software: no screen and no graphics card is needed."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.surface.surface import Surface

# Rasterization of triangles, the highest one winning: terrain from above, and previews from any
# side, without a screen.

EDGE = 1e-3
"""How far outside a triangle, as a fraction of it, a cell may lie: the map's vertices lie on cells'
centers, up to float32.
"""


@compiled
def rasterize(points: Any, attributes: Any, triangles: Any, height: Any, values: Any) -> None:
    """Draw triangles into ``height`` (H, W) and ``values`` (H, W, C), both changed in place.

    points: (V, 3) float64 column, row, height in pixels (center of the first at 0) and any unit; a
    cell takes the highest
    triangle over its center, NaN counts as lowest. attributes: (V, C), interpolated along.
    """
    rows, columns = height.shape
    for t in range(len(triangles)):
        a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        first_row = max(int(np.ceil(min(a[1], b[1], c[1]) - EDGE)), 0)
        last_row = min(int(np.floor(max(a[1], b[1], c[1]) + EDGE)), rows - 1)
        first_column = max(int(np.ceil(min(a[0], b[0], c[0]) - EDGE)), 0)
        last_column = min(int(np.floor(max(a[0], b[0], c[0]) + EDGE)), columns - 1)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                u = ((c[0] - b[0]) * (row - b[1]) - (c[1] - b[1]) * (column - b[0])) / area
                v = ((a[0] - c[0]) * (row - c[1]) - (a[1] - c[1]) * (column - c[0])) / area
                w = 1.0 - u - v
                if u < -EDGE or v < -EDGE or w < -EDGE:
                    continue
                z = u * a[2] + v * b[2] + w * c[2]
                if height[row, column] >= z:
                    continue
                height[row, column] = z
                for k in range(values.shape[2]):
                    values[row, column, k] = (
                        u * attributes[triangles[t, 0], k]
                        + v * attributes[triangles[t, 1], k]
                        + w * attributes[triangles[t, 2], k]
                    )


LONGER_SIDE_PX = 1600  # fills a screen
ELEVATION_DEG = 50.0  # of the view: relief shows, and little hides behind it
AZIMUTH_DEG = 25.0  # of the view, off the axes of most surveys
LIGHT = np.array([-0.4, 0.3, 0.866])
BACKGROUND = 255  # white


def render_preview(surfaces: Callable[[], Iterable[Surface]]) -> NDArray[np.uint8]:
    """Draw the map from a slant, in parallel projection, lightly shaded: (H, W, 3) RGB. surfaces:
    gives the tiles again on each call.
    """
    R = _view()
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for surface in surfaces():
        if len(surface.points_m):
            seen = surface.points_m @ R[:2].T
            low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
    if not np.isfinite(low).all():
        return np.full((64, 64, 3), BACKGROUND, np.uint8)
    pixel_m = float((high - low).max()) / LONGER_SIDE_PX
    shape = tuple(int(n) + 3 for n in ((high - low) / pixel_m)[::-1])
    depth, image = np.full(shape, np.nan), np.full((*shape, 3), float(BACKGROUND), np.float32)
    for surface in surfaces():
        seen = surface.points_m.astype(np.float64) @ R.T
        points = np.stack(
            [(seen[:, 0] - low[0]) / pixel_m + 1, (high[1] - seen[:, 1]) / pixel_m + 1, seen[:, 2]],
            axis=-1,
        )
        light = 0.65 + 0.35 * np.clip(surface.normals @ LIGHT, 0, 1)[:, None]
        rasterize(
            points, (surface.colors * light).astype(np.float32), surface.triangles, depth, image
        )
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _view() -> NDArray[np.float64]:
    """Rows: right, up and towards the viewer, who looks down from the south by the elevation,
    turned by the azimuth.
    """
    a, e = np.radians(AZIMUTH_DEG), np.radians(ELEVATION_DEG)
    right = np.array([np.cos(a), np.sin(a), 0])
    viewer = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    return np.stack([right, np.cross(viewer, right), viewer])
