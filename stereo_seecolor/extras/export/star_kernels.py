"""Triangles around a vertex, distances, normals and quadrics: compiled, for simplification."""

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.extras.export.triangle_kernels import cross

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
