"""Triangles around a vertex, their distances, normals and quadrics: compiled, for mesh
simplification.
"""

import numpy as np

from stereo_seecolor.compute.compiled import compiled

# Distances, normals and quadrics of triangles, compiled, for mesh simplification.

BOUNDARY_WEIGHT = 10.0
"""Of a boundary edge's own plane in the quadrics: the outline of the map is to stay."""


@compiled
def point_triangle_distance2(p, a, b, c):  # type: ignore[no-untyped-def]
    """Compute the squared distance of a point to a triangle (Ericson, Real-Time Collision
    Detection, 5.1.5).
    """
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    bpx, bpy, bpz = apx - abx, apy - aby, apz - abz
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    cpx, cpy, cpz = apx - acx, apy - acy, apz - acz
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        v, w = 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v, w = d1 / (d1 - d3), 0.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1 - w
    else:
        whole = va + vb + vc
        v, w = vb / whole, vc / whole
    x, y, z = apx - v * abx - w * acx, apy - v * aby - w * acy, apz - v * abz - w * acz
    return x * x + y * y + z * z


@compiled
def segment_distance2(p, a, b):  # type: ignore[no-untyped-def]
    """Compute the squared distance of a point to the segment from a to b."""
    along2, t = 0.0, 0.0
    for k in range(3):
        along2 += (b[k] - a[k]) ** 2
        t += (p[k] - a[k]) * (b[k] - a[k])
    t = min(1.0, max(0.0, t / along2)) if along2 > 0 else 0.0
    total = 0.0
    for k in range(3):
        total += (p[k] - a[k] - t * (b[k] - a[k])) ** 2
    return total


@compiled
def cross(a, b, c, out):  # type: ignore[no-untyped-def]
    """Write the normal of a triangle, as long as twice its area, to ``out``; return that length."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    out[0], out[1], out[2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)


@compiled
def _add_plane(quadric, n, d, weight):  # type: ignore[no-untyped-def]
    """The squared distance to the plane n x + d = 0, as the ten numbers of a symmetric form."""
    k = 0
    for i in range(3):
        for j in range(i, 3):
            quadric[k] += weight * n[i] * n[j]
            k += 1
        quadric[k] += weight * n[i] * d
        k += 1
    quadric[9] += weight * d * d


@compiled
def form(q, p):  # type: ignore[no-untyped-def]
    """Compute the weighted sum of the squared distances of a place to the planes of a quadric."""
    x, y, z = p[0], p[1], p[2]
    return (
        q[0] * x * x + 2 * q[1] * x * y + 2 * q[2] * x * z + 2 * q[3] * x + q[4] * y * y + 2 * q[5] * y * z + 2 * q[6] * y  # noqa: E501
        + q[7] * z * z + 2 * q[8] * z + q[9]
    )  # fmt: skip


@compiled
def quadrics(position, triangle, edge_boundary):  # type: ignore[no-untyped-def]
    """Sum the quadrics of the triangles at each vertex, weighted by area: (V, 10). edge_boundary:
    (F, 3), edge k from corner k to k + 1.
    """
    quadric = np.zeros((len(position), 10))
    n, along, side = np.empty(3), np.empty(3), np.empty(3)
    for f in range(len(triangle)):
        a = position[triangle[f, 0]]
        length = cross(a, position[triangle[f, 1]], position[triangle[f, 2]], n)
        if length == 0:
            continue
        n /= length
        for k in range(3):
            _add_plane(quadric[triangle[f, k]], n, -(n * a).sum(), length)
        for k in range(3):
            if edge_boundary[f, k]:
                u, v = triangle[f, k], triangle[f, (k + 1) % 3]
                along[:] = position[v] - position[u]
                side[0] = along[1] * n[2] - along[2] * n[1]
                side[1] = along[2] * n[0] - along[0] * n[2]
                side[2] = along[0] * n[1] - along[1] * n[0]
                size = np.sqrt((side * side).sum())
                if size > 0:
                    side /= size
                    for w in (u, v):
                        _add_plane(
                            quadric[w],
                            side,
                            -(side * position[w]).sum(),
                            BOUNDARY_WEIGHT * size * size,
                        )
    return quadric


# The triangles around a vertex (its star), compiled: which they are, and whether the vertex can
# be moved onto a neighbor.
#
# Arrays as in simplify.py.

LEAST_TURN_COS = 0.2
"""A triangle may not turn by more than 78 degrees in one collapse: it would fold over its
neighbor.
"""
LEAST_HEIGHT = 0.02
"""Of a triangle, as a fraction of its longest edge."""


@compiled
def has(triangle, f, v):  # type: ignore[no-untyped-def]
    """Tell whether vertex v is a corner of triangle f."""
    return triangle[f, 0] == v or triangle[f, 1] == v or triangle[f, 2] == v


@compiled
def moved_corners(triangle, f, u, v):  # type: ignore[no-untyped-def]
    """Give the corners of triangle f once u has been moved onto v."""
    a, b, c = triangle[f, 0], triangle[f, 1], triangle[f, 2]
    return v if a == u else a, v if b == u else b, v if c == u else c


@compiled
def star_of(u, head, link, triangle, star):  # type: ignore[no-untyped-def]
    """Write the triangles at vertex u to ``star``; return how many, or -1 for more than fit.
    Corners of triangles that are gone leave the list.
    """
    count, corner, before = 0, head[u], -1
    while corner >= 0:
        f = corner // 3
        if triangle[f, 0] < 0:
            if before < 0:
                head[u] = link[corner]
            else:
                link[before] = link[corner]
        else:
            if count == len(star):
                return -1
            star[count] = f
            count += 1
            before = corner
        corner = link[corner]
    return count


@compiled
def stays_surface(u, v, star, count, star_v, count_v, triangle):  # type: ignore[no-untyped-def]
    """Tell whether the collapse of the edge u, v leaves a surface: its ends share no neighbors but
    those across it.
    """
    shared, across = 0, 0
    for i in range(count):
        f = star[i]
        if has(triangle, f, v):
            across += 1
    for i in range(count):
        for k in range(3):
            w = triangle[star[i], k]
            if w in (u, v):
                continue
            seen = False  # a neighbor lies in two triangles of the star: count it once
            for j in range(i):
                seen = seen or has(triangle, star[j], w)
            if not seen:
                for j in range(count_v):
                    if has(triangle, star_v[j], w):
                        shared += 1
                        break
    return 0 < across <= 2 and shared == across


@compiled
def _across(u, star, count, triangle):  # type: ignore[no-untyped-def]
    """The two neighbors of a vertex along the boundary, -1 where it has none; -2 in the first where
    it has more.
    """
    found0, found1 = -1, -1
    for i in range(count):
        for k in range(3):
            w = triangle[star[i], k]
            if w == u:
                continue
            uses = 0
            for j in range(count):
                uses += has(triangle, star[j], w)
            if uses == 1:
                if found0 < 0:
                    found0 = w
                elif found1 < 0:
                    found1 = w
                else:
                    return -2, -2
    return found0, found1


@compiled
def other_end(u, v, star, count, triangle):  # type: ignore[no-untyped-def]
    """Find the other neighbor of u along the boundary: -1 where u lies inside, -2 where v is no
    neighbor along the boundary.
    """
    w0, w1 = _across(u, star, count, triangle)
    if w0 == -1:
        return -1
    if v not in (w0, w1) or w1 < 0:
        return -2
    return w1 if v == w0 else w0


@compiled
def turns(u, v, star, count, position, triangle, longest2, room):  # type: ignore[no-untyped-def]
    """Tell whether a triangle would fold over, shrink to a line, or get an edge longer than the
    root of longest2. room: (2+, 3).
    """
    n0, n1 = room[0], room[1]
    for i in range(count):
        f = star[i]
        if has(triangle, f, v):
            continue
        a, b, c = triangle[f, 0], triangle[f, 1], triangle[f, 2]
        before = cross(position[a], position[b], position[c], n0)
        a, b, c = moved_corners(triangle, f, u, v)
        after = cross(position[a], position[b], position[c], n1)
        longest = max(
            ((position[a] - position[b]) ** 2).sum(),
            ((position[b] - position[c]) ** 2).sum(),
            ((position[c] - position[a]) ** 2).sum(),
        )
        if (
            longest > longest2
            or after < LEAST_HEIGHT * longest
            or (n0 * n1).sum() < LEAST_TURN_COS * before * after
        ):
            return True
    return False
