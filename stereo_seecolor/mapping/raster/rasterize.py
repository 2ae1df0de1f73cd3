"""Rasterization of triangles, the highest one winning: terrain from above, and previews from any
side, without a screen.
"""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled

EDGE = 1e-3
"""How far outside a triangle, as a fraction of it, a cell may lie: the map's vertices lie on cells'
centers, up to float32.
"""


@compiled
def rasterize(points: Any, attributes: Any, triangles: Any, height: Any, values: Any) -> None:
    """Draw triangles into ``height`` (H, W) and ``values`` (H, W, C), both changed in place.

    points: (V, 3) float64 column, row, height in pixels (center of the first at 0) and any unit; a
    cell takes the highest triangle over its center, NaN counts as lowest. attributes: (V, C),
    interpolated along.
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
