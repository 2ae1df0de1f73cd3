"""Seams leveled: a smooth correction of each chart, so that both sides of a seam have the same
colors (Lempitsky, Ivanov 2007).

Least squares over nodes: along each seam the corrections differ as much as the views do, mean over
the edge; within a chart neighbors have nearly the same correction; and the colors as a whole are
those of the map's vertices, which all frames made.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.texture.charts import Charts
from stereo_seecolor.texture.surface import PaintedSurface
from stereo_seecolor.texture.views import Views

SMOOTH = 0.5
"""Weight of equal corrections of neighbors, against 1 of a seam: what differs from seam to seam is
noise and parallax.
"""
MAP = 0.1
"""Weight of the map's color at a vertex."""
RIM = 0.3
"""The same where a triangle has no neighbor or one that no view shows: what lies beyond, of another
tile or of the map's colors, is to fit.
"""
ROUNDS = 8
"""Of averages with the neighbors: over some three vertices."""
SWEEPS = 20
"""Of the relaxation: the averages of differences from the map are a good guess of all but seams."""
ALONG = np.linspace(0, 1, 7)
"""Places on an edge where its color is taken."""
LIGHT_STD = 20.0
"""Of 255: larger differences between views come from different content (edges of objects) rather
than from light.
"""


def level(
    views: Views, surface: PaintedSurface, charts: Charts, across: NDArray[np.int64]
) -> Charts:
    """The charts with their corrections. across: (F, 3) neighbors or -1."""
    if not len(charts.vertex):
        return charts
    one, other = _seams(charts, across)
    count, nodes = len(one), len(charts.vertex)
    every = np.repeat(np.arange(nodes), 2).reshape(-1, 2)
    found = _colors(views, charts, np.concatenate([other, one, every]))
    difference = found[:count] - found[count : 2 * count]
    to_map = surface.color[charts.vertex] - found[2 * count :]
    row = np.repeat(np.arange(count), 4)
    column = np.concatenate([one, other], axis=1).ravel()
    inner = _inner_edges(charts)
    to_map = _smoothed(to_map, inner)
    sure, sure_of_map = _sureness(difference), _sureness(to_map)
    rim = np.zeros(nodes, np.bool_)
    rim[_rim(charts, across)] = True
    sure_of_map *= np.where(rim, RIM, MAP)
    signs = (sure[:, None] * (0.5, 0.5, -0.5, -0.5)).ravel()
    seam = coo_array((signs, (row, column)), shape=(count, nodes)).tocsr()
    signs = np.tile([1.0, -1.0], len(inner))
    smooth = coo_array(
        (signs, (np.repeat(np.arange(len(inner)), 2), inner.ravel())), shape=(len(inner), nodes)
    ).tocsr()
    normal = seam.T @ seam + SMOOTH**2 * (smooth.T @ smooth) + diags_array(sure_of_map**2)
    normal = normal.tocsr()
    right = seam.T @ (sure[:, None] * difference) + sure_of_map[:, None] ** 2 * to_map
    relax(normal.indptr, normal.indices, normal.data, np.asarray(right), to_map, SWEEPS)
    return replace(charts, correction=to_map.astype(np.float32))


@compiled
def relax(starts, columns, weights, right, values, sweeps):  # type: ignore[no-untyped-def]
    """Solve equations of a symmetric matrix by rows (Gauss and Seidel), forth and back in turns.
    values (N, 3): a guess, which becomes the solution.
    """
    rows = len(values)
    for sweep in range(sweeps):
        for i in range(rows):
            row = i if sweep % 2 == 0 else rows - 1 - i
            for c in range(3):
                total, own = right[row, c], 1.0
                for k in range(starts[row], starts[row + 1]):
                    if columns[k] == row:
                        own = weights[k]
                    else:
                        total -= weights[k] * values[columns[k], c]
                values[row, c] = total / own


def _smoothed(values: NDArray[np.float64], edges: NDArray[np.int64]) -> NDArray[np.float64]:
    """Values of nodes (N, 3), each the mean of some neighbors, as the map's cells blend them."""
    ends = np.concatenate(
        [edges, edges[:, ::-1], np.repeat(np.arange(len(values)), 2).reshape(-1, 2)]
    )
    around = coo_array((np.ones(len(ends)), ends.T), shape=(len(values),) * 2).tocsr()
    mean = diags_array(1 / np.asarray(around.sum(axis=1)).ravel()) @ around
    for _ in range(ROUNDS):
        values = mean @ values
    return values


def _rim(charts: Charts, across: NDArray[np.int64]) -> NDArray[np.int64]:
    """Nodes of edges beyond which no view shows anything."""
    beyond = (across < 0) | (charts.of_face[across] < 0)
    face, corner = np.nonzero(beyond & (charts.of_face >= 0)[:, None])
    return np.concatenate([charts.node[face, corner], charts.node[face, (corner + 1) % 3]])


def _sureness(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) weights of differences (n, 3), those of a Cauchy distribution."""
    return np.asarray(1 / np.sqrt(1 + (np.abs(difference).max(axis=1, initial=0) / LIGHT_STD) ** 2))


def _seams(
    charts: Charts, across: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(S, 2) nodes of edges between two charts, as one sees them and as the other."""
    face, corner = np.nonzero(across >= 0)
    beyond = across[face, corner]
    apart = (
        (face < beyond)
        & (charts.of_face[face] != charts.of_face[beyond])
        & (charts.of_face[[face, beyond]] >= 0).all(axis=0)
    )
    face, corner, beyond = face[apart], corner[apart], beyond[apart]
    one = np.stack([charts.node[face, corner], charts.node[face, (corner + 1) % 3]], axis=1)
    candidates = charts.node[beyond]
    place = (charts.vertex[candidates][:, None, :] == charts.vertex[one][:, :, None]).argmax(axis=2)
    return one, np.take_along_axis(candidates, place, axis=1)


def _inner_edges(charts: Charts) -> NDArray[np.int64]:
    node = charts.node[charts.of_face >= 0]
    ends = np.stack([node, np.roll(node, -1, axis=1)])
    key = np.unique(ends.min(axis=0) << 32 | ends.max(axis=0))
    return np.stack([key >> 32, key & 0xFFFFFFFF], axis=1)


def _colors(views: Views, charts: Charts, edges: NDArray[np.int64]) -> NDArray[np.float64]:
    """(S, 3) mean color of edges (S, 2) in the view of their charts."""
    view = charts.view[charts.chart[edges[:, 0]]]
    result = np.zeros((len(edges), 3))
    order = np.argsort(view, kind="stable")
    numbers, first = np.unique(view[order], return_index=True)
    for number, of_view in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        soft = views.picture(number).soft
        start, end = charts.pixel[edges[of_view, 0]], charts.pixel[edges[of_view, 1]]
        at = start[:, None] + ALONG[:, None] * (end - start)[:, None]
        places = ((at + 0.5) / 2 - 0.5).astype(np.float32)  # soft has half the pixels
        # remap takes at most 32767 rows
        sampled = [
            cv2.remap(
                soft, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            ).mean(axis=1)
            for part in np.array_split(places, 1 + len(places) // 30000)
        ]
        result[of_view] = np.concatenate(sampled)
    return result
