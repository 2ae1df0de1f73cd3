"""Seams leveled: a smooth correction of each chart, so that both sides of a seam have the same colors (Lempitsky, Ivanov 2007).

Least squares over nodes: along each seam the corrections differ as much as the views do, mean over the edge; within a chart
neighbors have nearly the same correction; and the colors as a whole are those of the map's vertices, which all frames made.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from stereo_seecolor.extras.export.texture.charts import Charts
from stereo_seecolor.extras.export.texture.surface import Surface
from stereo_seecolor.extras.export.texture.views import Views

SMOOTH = 0.5
"""Weight of equal corrections of neighbors, against 1 of a seam: what differs from seam to seam is noise and parallax."""
MAP = 0.1
"""Weight of the map's color at a vertex."""
ALONG = np.linspace(0, 1, 7)
"""Places on an edge where its color is taken."""
BLUR_PX = 2.0
"""Before colors are compared: a seam may be off by a pixel or two."""

LIGHT_STD = 20.0
"""Of 255: larger differences between views come from different content (edges of objects) rather than from light."""


def level(views: Views, surface: Surface, charts: Charts, across: NDArray[np.int64]) -> Charts:
    """The charts with their corrections. across: (F, 3) neighbors or -1."""
    if not len(charts.vertex):
        return charts
    one, other = _seams(charts, across)
    difference = _colors(views, charts, other) - _colors(views, charts, one)
    every = np.arange(len(charts.vertex))
    to_map = surface.color[charts.vertex] - _colors(views, charts, np.stack([every, every], axis=1))
    count, nodes = len(one), len(charts.vertex)
    row = np.repeat(np.arange(count), 4)
    column = np.concatenate([one, other], axis=1).ravel()
    sure, sure_of_map = _sureness(difference), _sureness(to_map)
    signs = (sure[:, None] * (0.5, 0.5, -0.5, -0.5)).ravel()
    seam = coo_array((signs, (row, column)), shape=(count, nodes)).tocsr()
    inner = _inner_edges(charts)
    signs = np.tile([1.0, -1.0], len(inner))
    smooth = coo_array((signs, (np.repeat(np.arange(len(inner)), 2), inner.ravel())), shape=(len(inner), nodes)).tocsr()
    normal = seam.T @ seam + SMOOTH**2 * (smooth.T @ smooth) + diags_array((MAP * sure_of_map) ** 2)
    right = seam.T @ (sure[:, None] * difference) + (MAP * sure_of_map[:, None]) ** 2 * to_map
    solved = splu(normal.tocsc(), permc_spec="MMD_AT_PLUS_A").solve(np.asarray(right))
    return charts.leveled(solved.astype(np.float32))


def _sureness(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) weights of differences (n, 3), those of a Cauchy distribution."""
    return np.asarray(1 / np.sqrt(1 + (np.abs(difference).max(axis=1, initial=0) / LIGHT_STD) ** 2))


def _seams(charts: Charts, across: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(S, 2) nodes of edges between two charts, as one sees them and as the other."""
    face, corner = np.nonzero(across >= 0)
    beyond = across[face, corner]
    apart = (face < beyond) & (charts.of_face[face] != charts.of_face[beyond]) & (charts.of_face[[face, beyond]] >= 0).all(axis=0)
    face, corner, beyond = face[apart], corner[apart], beyond[apart]
    one = np.stack([charts.node[face, corner], charts.node[face, (corner + 1) % 3]], axis=1)
    candidates = charts.node[beyond]
    place = (charts.vertex[candidates][:, None, :] == charts.vertex[one][:, :, None]).argmax(axis=2)
    return one, np.take_along_axis(candidates, place, axis=1)


def _inner_edges(charts: Charts) -> NDArray[np.int64]:
    node = charts.node[charts.of_face >= 0]
    ends = np.sort(np.stack([node, np.roll(node, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return np.asarray(np.unique(ends, axis=0))


def _colors(views: Views, charts: Charts, edges: NDArray[np.int64]) -> NDArray[np.float64]:
    """(S, 3) mean color of edges (S, 2) in the view of their charts."""
    view = charts.view[charts.chart[edges[:, 0]]]
    result = np.zeros((len(edges), 3))
    for number in np.unique(view):
        of_view = np.flatnonzero(view == number)
        image = cv2.GaussianBlur(views.image(int(number)), (0, 0), BLUR_PX).astype(np.float32)
        start, end = charts.pixel[edges[of_view, 0]], charts.pixel[edges[of_view, 1]]
        places = (start[:, None] + ALONG[:, None] * (end - start)[:, None]).astype(np.float32)
        sampled = [
            cv2.remap(image, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for part in np.array_split(places, 1 + len(places) // 30000)  # remap takes at most 32767 rows
        ]
        result[of_view] = np.concatenate(sampled).mean(axis=1)
    return result
