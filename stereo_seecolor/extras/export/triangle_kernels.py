"""Distances, normals and quadrics of triangles, compiled, for mesh simplification."""

import numpy as np

from stereo_seecolor.compute.compiled import compiled

BOUNDARY_WEIGHT = 10.0
"""Of a boundary edge's own plane in the quadrics: the outline of the map is to stay."""


@compiled
def point_triangle_distance2(p, a, b, c):  # type: ignore[no-untyped-def]
    """The squared distance of a point to a triangle (Ericson, Real-Time Collision Detection)."""
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
