"""Mesh simplification by edge collapse, cheapest edge first, with a bound on the distance of the
original's vertices to the result.

Each vertex that is taken out stays with the nearest triangle of the result, and a collapse that
would leave one of them too far is refused (Klein, Liebich and Strasser, Mesh Reduction with Error
Control, 1996). The order is by quadrics (Garland and Heckbert 1997). A vertex is moved onto its
neighbor, so that all that stay are vertices of the original.

Arrays: position (V, 3) float64. triangle (F, 3) int32; -1 in the first corner of one that is gone.
head (V,), link (3 F,): the corners at each vertex as a linked list, -1 at its end; corners of
triangles that are gone stay in it. first (F,), after (V,): the vertices that were taken out and lie
by each triangle. star: the triangles at a vertex, of which ``count`` are meant.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.extras.export.star_kernels import (
    has,
    moved_corners,
    other_end,
    star_of,
    stays_surface,
    turns,
)
from stereo_seecolor.extras.export.triangle_kernels import (
    cross,
    form,
    point_triangle_distance2,
    quadrics,
    segment_distance2,
)
from stereo_seecolor.mapping.surface.surface import only_used
from stereo_seecolor.texture.surface import edge_keys

MOST_AT_VERTEX = 64
"""Triangles; a vertex that has more stays."""
SAMPLES = (
    np.array([[2, 2, 2], [3, 3, 0], [0, 3, 3], [3, 0, 3], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
)
"""Places in a triangle of the result, as weights of corners, compared with the original."""


@compiled
def _nearest(p, u, v, star, count, position, triangle):  # type: ignore[no-untyped-def]
    """The triangle of the collapsed star nearest to a point, and the squared distance."""
    best, best2 = -1, np.inf
    for i in range(count):
        f = star[i]
        if has(triangle, f, v):
            continue
        a, b, c = moved_corners(triangle, f, u, v)
        found2 = point_triangle_distance2(p, position[a], position[b], position[c])
        if found2 < best2:
            best, best2 = f, found2
    return best, best2


@compiled
def _within(u, v, w, star, count, position, triangle, first, after, on_boundary, bound2):  # type: ignore[no-untyped-def]
    """Whether every vertex by the star of u, and u itself, stays within the bound when u goes to v.
    w: the other neighbor of u on the boundary, whose new edge is from v to w; -1 inside.
    """
    for i in range(-1, count):
        p = u if i < 0 else first[star[i]]
        while p >= 0:
            if (
                w >= 0
                and on_boundary[p]
                and segment_distance2(position[p], position[v], position[w]) > bound2
            ):
                return False
            if _nearest(position[p], u, v, star, count, position, triangle)[1] > bound2:
                return False
            if i < 0:
                break
            p = after[p]
    return True


@compiled
def _nearer(s, p, best, best2, position):  # type: ignore[no-untyped-def]
    """Of a vertex p and the best so far the one nearer to a place, and its squared distance."""
    x, y, z = position[p, 0] - s[0], position[p, 1] - s[1], position[p, 2] - s[2]
    found2 = x * x + y * y + z * z
    return p if found2 < best2 else best, min(found2, best2)


@compiled
def _nearest_vertex(s, u, star, count, position, triangle, first, after):  # type: ignore[no-untyped-def]
    """The vertex of the original nearest to a place, of those by the star of u."""
    best, best2 = u, np.inf
    for i in range(count):
        for k in range(3):
            best, best2 = _nearer(s, triangle[star[i], k], best, best2, position)
        p = first[star[i]]
        while p >= 0:
            best, best2 = _nearer(s, p, best, best2, position)
            p = after[p]
    return best


@compiled
def _covers(u, v, star, count, position, triangle, first, after, original, bound2, room):  # type: ignore[no-untyped-def]
    """Whether the triangles of the collapsed star stay within the bound of the original's, at their
    SAMPLES, and face as they do.

    room: (3, 3), to work in.
    """
    triangle0, head0, link0 = original
    s, n, n0 = room
    for i in range(count):
        f = star[i]
        if has(triangle, f, v):
            continue
        a, b, c = moved_corners(triangle, f, u, v)
        cross(position[a], position[b], position[c], n)
        for sample in range(len(SAMPLES)):
            for k in range(3):
                s[k] = (
                    SAMPLES[sample, 0] * position[a, k]
                    + SAMPLES[sample, 1] * position[b, k]
                    + SAMPLES[sample, 2] * position[c, k]
                )
            corner = head0[_nearest_vertex(s, u, star, count, position, triangle, first, after)]
            near = False
            while corner >= 0 and not near:
                t = triangle0[corner // 3]
                if (
                    point_triangle_distance2(s, position[t[0]], position[t[1]], position[t[2]])
                    <= bound2
                ):
                    cross(position[t[0]], position[t[1]], position[t[2]], n0)
                    near = n[0] * n0[0] + n[1] * n0[1] + n[2] * n0[2] > 0
                corner = link0[corner]
            if not near:
                return False
    return True


@compiled
def _collapse(u, v, star, count, position, triangle, head, link, first, after):  # type: ignore[no-untyped-def]
    """Move u onto v: the triangles of the edge go, those of u become v's, their points go to the
    nearest of the star.
    """
    points = u
    after[u] = -1
    for i in range(count):
        p = first[star[i]]
        while p >= 0:
            following = after[p]
            after[p] = points
            points, p = p, following
        first[star[i]] = -1
    while points >= 0:
        following = after[points]
        f, _ = _nearest(position[points], u, v, star, count, position, triangle)
        after[points] = first[f]
        first[f] = points
        points = following
    for i in range(count):
        f = star[i]
        if has(triangle, f, v):
            triangle[f, 0] = -1
            continue
        for k in range(3):
            if triangle[f, k] == u:
                triangle[f, k] = v
                link[3 * f + k] = head[v]
                head[v] = 3 * f + k
    head[u] = -1


@compiled
def _push(heap, u, v, position, quadric, stamp):  # type: ignore[no-untyped-def]
    """An edge with the cheaper of its two directions first."""
    forth = form(quadric[u], position[v]) + form(quadric[v], position[v])
    back = form(quadric[u], position[u]) + form(quadric[v], position[u])
    if back < forth:
        u, v, forth = v, u, back
    heapq.heappush(heap, (forth, np.int64(u), np.int64(v), stamp[u] + stamp[v]))


@compiled
def _heap_of(position, triangle, edge_boundary, quadric, stamp, on_boundary):  # type: ignore[no-untyped-def]
    """Every edge; and which vertices lie on the boundary, into ``on_boundary``."""
    heap = [(0.0, np.int64(0), np.int64(0), np.int64(-1))]
    for f in range(len(triangle)):
        for k in range(3):
            u, v = triangle[f, k], triangle[f, (k + 1) % 3]
            if edge_boundary[f, k]:
                on_boundary[u] = on_boundary[v] = True
            if edge_boundary[f, k] or u < v:
                _push(heap, u, v, position, quadric, stamp)
    return heap


@compiled
def collapse_edges(position, triangle, edge_boundary, head, link, bound_m, longest_m):  # type: ignore[no-untyped-def]
    """Collapse edges in place, as many as the bound allows; (V,) squared distances of the vertices
    to the result, 0 for those that stay.
    """
    bound2, longest2 = bound_m * bound_m, longest_m * longest_m
    original = triangle.copy(), head.copy(), link.copy()
    quadric = quadrics(position, triangle, edge_boundary)
    on_boundary, stamp = np.zeros(len(position), np.bool_), np.zeros(len(position), np.int64)
    first, after = np.full(len(triangle), -1, np.int32), np.full(len(position), -1, np.int32)
    heap = _heap_of(position, triangle, edge_boundary, quadric, stamp, on_boundary)
    star, star_v, room = (
        np.empty(MOST_AT_VERTEX, np.int32),
        np.empty(MOST_AT_VERTEX, np.int32),
        np.empty((3, 3)),
    )
    while len(heap):
        _, a, b, at = heapq.heappop(heap)
        if at != stamp[a] + stamp[b] or head[a] < 0 or head[b] < 0:
            continue
        for turn in range(2):
            u, v = (a, b) if turn == 0 else (b, a)
            count, count_v = (
                star_of(u, head, link, triangle, star),
                star_of(v, head, link, triangle, star_v),
            )
            if (
                count <= 0
                or count_v < 0
                or not stays_surface(u, v, star, count, star_v, count_v, triangle)
            ):
                continue
            w = other_end(u, v, star, count, triangle)
            if (
                w == -2
                or turns(u, v, star, count, position, triangle, longest2, room)
                or not _within(
                    u, v, w, star, count, position, triangle, first, after, on_boundary, bound2
                )
                or not _covers(
                    u, v, star, count, position, triangle, first, after, original, bound2, room
                )
            ):
                continue
            _collapse(u, v, star, count, position, triangle, head, link, first, after)
            quadric[v] += quadric[u]
            stamp[v] += 1
            count = star_of(v, head, link, triangle, star)
            for i in range(count):
                for k in range(3):
                    if triangle[star[i], k] != v:
                        _push(heap, v, triangle[star[i], k], position, quadric, stamp)
            break
    return _distances2(position, triangle, first, after)


@compiled
def _distances2(position, triangle, first, after):  # type: ignore[no-untyped-def]
    result = np.zeros(len(position))
    for f in range(len(triangle)):
        p = first[f] if triangle[f, 0] >= 0 else -1
        while p >= 0:
            t = triangle[f]
            result[p] = point_triangle_distance2(
                position[p], position[t[0]], position[t[1]], position[t[2]]
            )
            p = after[p]
    return result


@dataclass(frozen=True, eq=False)
class Simplified:
    """A simplified mesh. kept: (V,) numbers of the original's vertices that are left. triangles:
    (F, 3) int32, into ``kept``.

    largest_m, rms_m: distance of the original's vertices to the new surface.
    """

    kept: NDArray[np.int64]
    triangles: NDArray[np.int32]
    largest_m: float
    rms_m: float


def simplify(
    position_m: NDArray[np.floating],
    triangles: NDArray[np.integer],
    bound_m: float,
    longest_m: float = np.inf,
) -> Simplified:
    """Remove vertices of a mesh, as many as the bound allows.

    position_m: (V, 3). triangles: (F, 3), a surface of any topology. bound_m: largest distance of
    the original's vertices to the new surface, and of those of its boundary to the new boundary.
    longest_m: no new edge is longer.
    """
    position = np.ascontiguousarray(position_m, np.float64)
    # quadrics lose digits far from the origin
    position = position - (position.mean(axis=0) if len(position) else 0)
    left = np.array(triangles, np.int32, order="C")
    head, link = _corners(left, len(position))
    distance2 = collapse_edges(position, left, boundary_edges(left), head, link, bound_m, longest_m)
    left = left[left[:, 0] >= 0]
    kept, indices = only_used(left, len(position))
    in_original = np.zeros(len(position), np.bool_)
    in_original[np.asarray(triangles).ravel()] = True
    distance2 = distance2[in_original]
    largest_m = float(np.sqrt(distance2.max(initial=0)))
    rms_m = float(np.sqrt(distance2.mean())) if len(distance2) else 0.0
    return Simplified(kept, indices, largest_m, rms_m)


def boundary_edges(triangles: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mark the edges that not exactly two triangles share: (F, 3) bool of triangles (F, 3); edge k
    runs from corner k to k + 1.
    """
    _, inverse, count = np.unique(edge_keys(triangles), return_inverse=True, return_counts=True)
    return np.asarray(count[inverse] != 2).reshape(-1, 3)


def _corners(
    triangles: NDArray[np.int32], vertices: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The corners at each vertex as linked lists: the first (V,), and the next (3 F,)."""
    head, link = np.full(vertices, -1, np.int32), np.full(triangles.size, -1, np.int32)
    flat = triangles.ravel()
    order = np.argsort(flat, kind="stable").astype(np.int32)
    same = flat[order][1:] == flat[order][:-1]
    link[order[:-1][same]] = order[1:][same]
    starts = np.concatenate([[True], ~same]) if len(order) else np.zeros(0, np.bool_)
    head[flat[order[starts]]] = order[starts]
    return head, link
