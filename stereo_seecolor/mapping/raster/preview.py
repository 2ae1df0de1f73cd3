"""A picture of the map, drawn in software: no screen and no graphics card is needed."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.grid import bounds
from stereo_seecolor.mapping.raster.rasterize import rasterize
from stereo_seecolor.mapping.surface.surface import Surface

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
    low, high = bounds(surface.points_m @ R[:2].T for surface in surfaces())
    if not np.isfinite(low).all():
        return np.full((64, 64, 3), BACKGROUND, np.uint8)
    pixel_m = float((high - low).max()) / LONGER_SIDE_PX
    shape = tuple(int(n) + 3 for n in ((high - low) / pixel_m)[::-1])
    depth = np.full(shape, np.nan, np.float32)
    image = np.full((*shape, 3), float(BACKGROUND), np.float32)
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
    """Rows: right, up, towards the viewer, who looks down from the south by the elevation."""
    a, e = np.radians(AZIMUTH_DEG), np.radians(ELEVATION_DEG)
    right = np.array([np.cos(a), np.sin(a), 0])
    viewer = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    return np.stack([right, np.cross(viewer, right), viewer])
