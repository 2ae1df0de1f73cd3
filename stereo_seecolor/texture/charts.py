"""Patches of the surface that share a view: each lies in the texture as it lies in that image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from stereo_seecolor.texture.surface import PaintedSurface
from stereo_seecolor.texture.views import Views


@dataclass(frozen=True, eq=False)
class Charts:
    """of_face (F,): the chart of each triangle, -1 where no view shows it. on_edge (F,): whether it
    has a neighbor that is in none or another. view, group (C,): of each chart.

    A node is a vertex in a chart. node (F, 3): of each corner, -1 without a chart. vertex, chart
    (N,): of each node. pixel (N, 2): where the chart's view shows it, (0, 0) in the center of the
    top left one. correction (N, 3): what is added there to its colors.
    """

    of_face: NDArray[np.int64]
    on_edge: NDArray[np.bool_]
    view: NDArray[np.int32]
    group: NDArray[np.int64]
    node: NDArray[np.int64]
    vertex: NDArray[np.int64]
    chart: NDArray[np.int64]
    pixel: NDArray[np.float64]
    correction: NDArray[np.float32]


def build_charts(
    views: Views,
    surface: PaintedSurface,
    label: NDArray[np.int32],
    across: NDArray[np.int64],
    group: NDArray[np.int64],
) -> Charts:
    """Charts: connected triangles of one view (F,) and one group (F,)."""
    of_face = _components(label, across, group)
    seen = np.flatnonzero(of_face >= 0)
    charts = int(of_face.max(initial=-1)) + 1
    view, of_group = np.full(charts, -1, np.int32), np.zeros(charts, np.int64)
    view[of_face[seen]], of_group[of_face[seen]] = label[seen], group[seen]
    key = of_face[seen, None] * len(surface.position) + surface.triangles[seen]
    unique, inverse = np.unique(key, return_inverse=True)
    node = np.full(surface.triangles.shape, -1, np.int64)
    node[seen] = inverse.reshape(-1, 3)
    chart, vertex = np.divmod(unique, max(len(surface.position), 1))
    pixel = np.zeros((len(unique), 2))
    for number in np.unique(view):
        of_view = np.flatnonzero(view[chart] == number)
        pixel[of_view] = views.project(int(number), surface.position[vertex[of_view]])
    on_edge = (of_face[across] != of_face[:, None]).any(axis=1) | (across < 0).any(axis=1)
    none = np.zeros((len(unique), 3), np.float32)
    return Charts(of_face, on_edge, view, of_group, node, vertex, chart, pixel, none)


def _components(
    label: NDArray[np.int32], across: NDArray[np.int64], group: NDArray[np.int64]
) -> NDArray[np.int64]:
    one = np.repeat(np.arange(len(label)), 3)
    other = across.ravel()
    joined = other >= 0
    one, other = one[joined], other[joined]
    same = (label[one] == label[other]) & (group[one] == group[other]) & (label[one] >= 0)
    graph = coo_array(
        (np.ones(int(same.sum()), np.int8), (one[same], other[same])),
        shape=(len(label), len(label)),
    )
    component = np.asarray(connected_components(graph, directed=False)[1])
    result = np.full(len(label), -1, np.int64)
    seen = label >= 0
    result[seen] = np.unique(component[seen], return_inverse=True)[1]
    return result
