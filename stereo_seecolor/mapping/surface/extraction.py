"""Extraction of the surface from a tile's voxels by marching cubes, on all cores."""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.mapping.surface.kernels import BLOCK, packed
from stereo_seecolor.mapping.surface.surface import Surface

# Marching cubes over blocks of voxels, a range of blocks at a time: the cubes' cases, then the
# points, then the triangles.
#
# Arrays: keys (B, 3) int32 coordinates of the blocks, sorted. around (B, 27) int32: the numbers
# of a block's neighbors and its own, x fastest, -1 where there is none. tsdf, weight: as in
# kernels.py. cases (B, 8, 8, 8) uint8: which corners of the cube above each voxel lie inside the
# surface; 0 as well where one is not known. numbers (B, 8, 8, 8, 3) int32: of the point on the
# edge from a voxel along x, y and z, -1 where there is none. Indices are z, y, x everywhere.

WIDE = BLOCK + 3
"""A block with one voxel before it and two behind it along each axis."""


def neighbors(keys: Any, around: Any, first: int, last: int) -> None:
    """Write ``around`` of the blocks from first to last - 1."""
    x, y, z = keys.astype(np.int64).T
    sorted_keys, part = packed(x, y, z), slice(first, last)
    for n in range(27):
        key = packed(x[part] + n % 3 - 1, y[part] + n // 3 % 3 - 1, z[part] + n // 9 - 1)
        found = np.searchsorted(sorted_keys, key)
        there = sorted_keys[np.minimum(found, len(sorted_keys) - 1)] == key
        around[part, n] = np.where(there, found, -1)


@compiled
def _place(b: Any, k: Any, j: Any, i: Any, around: Any) -> Any:
    """The block, and the place in it, of the voxel (k, j, i) of block b, where these may be -1 to
    two past the block's edge.
    """
    n = (i + BLOCK) // BLOCK + 3 * ((j + BLOCK) // BLOCK) + 9 * ((k + BLOCK) // BLOCK)
    return around[b, n], k % BLOCK, j % BLOCK, i % BLOCK


@compiled
def _gather(b: Any, around: Any, tsdf: Any, weight: Any, least: Any, low: int, wide: Any) -> None:
    """Signed distances of a block and of the voxels around it from ``low`` on into wide (w, w, w);
    NaN where weights are low.
    """
    size = len(wide)
    for k in range(size):
        for j in range(size):
            for i in range(size):
                block, z, y, x = _place(b, k + low, j + low, i + low, around)
                known = block >= 0 and weight[block, z, y, x] > least
                wide[k, j, i] = tsdf[block, z, y, x] if known else np.float32(np.nan)


@compiled
def find_cases(
    own: Any,
    around: Any,
    tsdf: Any,
    weight: Any,
    least: float,
    tables: Any,
    found: Any,
    first: int,
    last: int,
) -> None:
    """Write the cases of all cubes of the blocks own[first:last], mark the edges that have points,
    and count the triangles.

    least: weight that a voxel must exceed. tables: counts (256,), edges (256, 5, 3) of
    ``cube_cases`` and the EDGES (12, 4).
    found: cases, numbers and triangles (B,), changed in place; numbers become 0 where there is a
    point. Other parts may write the same zeros into blocks between theirs and this one's.
    """
    counts, edges, ends = tables
    cases, numbers, triangles = found
    wide = np.empty((BLOCK + 1, BLOCK + 1, BLOCK + 1), np.float32)
    for b in own[first:last]:
        _gather(b, around, tsdf, weight, least, 0, wide)
        for k in range(BLOCK):
            for j in range(BLOCK):
                for i in range(BLOCK):
                    case = _case(wide, k, j, i)
                    cases[b, k, j, i] = case
                    triangles[b] += counts[case]
                    for t in range(counts[case]):
                        for c in range(3):
                            e = ends[edges[case, t, c]]
                            block, z, y, x = _place(b, k + e[2], j + e[1], i + e[0], around)
                            numbers[block, z, y, x, e[3]] = 0


@compiled
def _case(wide: Any, k: Any, j: Any, i: Any) -> Any:
    case = 0
    for corner in range(8):
        value = wide[k + (corner >> 2), j + (corner >> 1 & 1), i + (corner & 1)]
        if np.isnan(value):
            return 0
        case |= (value < 0) << corner
    return case if case < 255 else 0


def count_points(numbers: Any, counts: Any, first: int, last: int) -> None:
    """Add the number of points of the blocks from first to last - 1 to counts (B,)."""
    counts[first:last] += np.count_nonzero(numbers[first:last] >= 0, axis=(1, 2, 3, 4))


@compiled
def place_points(
    keys: Any,
    around: Any,
    volume: Any,
    least: float,
    voxel_m: float,
    numbers: Any,
    starts: Any,
    points: Any,
    first: int,
    last: int,
) -> None:
    """Number the points of the blocks from first to last - 1, and write their positions, normals
    and colors.

    volume: tsdf, weight, color (B, 8, 8, 8, 3) and color_weight. starts: (B,) the number of each
    block's first point. points: positions (V, 3) float32, meters; unit normals (V, 3) float32,
    towards free space; colors (V, 3) uint8.
    """
    tsdf, weight, color, color_weight = volume
    positions, normals, colors = points
    wide = np.empty((WIDE, WIDE, WIDE), np.float32)
    for b in range(first, last):
        n = starts[b]
        gathered = False
        for k, j, i, axis in np.ndindex((BLOCK, BLOCK, BLOCK, 3)):
            if numbers[b, k, j, i, axis] < 0:
                continue
            if not gathered:
                _gather(b, around, tsdf, weight, least, -1, wide)
                gathered = True
            z, y, x = k + (axis == 2), j + (axis == 1), i + (axis == 0)
            low, high = wide[k + 1, j + 1, i + 1], wide[z + 1, y + 1, x + 1]
            t = np.float64(low) / (np.float64(low) - np.float64(high))
            numbers[b, k, j, i, axis] = n
            positions[n, 0] = (keys[b, 0] * BLOCK + i + t * (axis == 0)) * voxel_m
            positions[n, 1] = (keys[b, 1] * BLOCK + j + t * (axis == 1)) * voxel_m
            positions[n, 2] = (keys[b, 2] * BLOCK + k + t * (axis == 2)) * voxel_m
            _normal(wide, (k + 1, j + 1, i + 1), (z + 1, y + 1, x + 1), t, normals[n])
            block, z, y, x = _place(b, z, y, x, around)
            share = (1 - t) * (color_weight[b, k, j, i] > 0), t * (color_weight[block, z, y, x] > 0)
            _mix(color[b, k, j, i], color[block, z, y, x], share, colors[n])
            n += 1


@compiled
def _normal(wide: Any, a: Any, b: Any, t: float, normal: Any) -> None:
    """The direction of the gradient of the signed distance between two voxels, of those voxels
    around that are known.
    """
    squares = 0.0
    for axis in range(3):
        normal[axis] = (1 - t) * _slope(wide, a, axis) + t * _slope(wide, b, axis)
        squares += normal[axis] ** 2
    for axis in range(3):
        normal[axis] /= max(np.sqrt(squares), 1e-12)


@compiled
def _slope(wide: Any, at: Any, axis: int) -> Any:
    """By central differences; by one-sided ones where one neighbor is not known."""
    k, j, i = at
    z, y, x = axis == 2, axis == 1, axis == 0
    here, before, behind = wide[k, j, i], wide[k - z, j - y, i - x], wide[k + z, j + y, i + x]
    if np.isnan(before):
        return np.float32(0) if np.isnan(behind) else behind - here
    return here - before if np.isnan(behind) else (behind - before) / np.float32(2)


@compiled
def _mix(a: Any, b: Any, share: Any, color: Any) -> None:
    """Colors of two voxels; one that was only seen through has none, and must not darken the
    other's.
    """
    total = max(share[0] + share[1], 1e-12)
    for c in range(3):
        color[c] = np.uint8(min(max((share[0] * a[c] + share[1] * b[c]) / total + 0.5, 0.0), 255.0))


@compiled
def list_triangles(
    own: Any, around: Any, tables: Any, found: Any, starts: Any, indices: Any, first: int, last: int
) -> None:
    """Write the triangles of the blocks own[first:last] to indices (T, 3) int32. starts: (B,) the
    first one of each block.
    """
    counts, edges, ends = tables
    cases, numbers = found
    for b in own[first:last]:
        n = starts[b]
        for k, j, i in np.ndindex((BLOCK, BLOCK, BLOCK)):
            case = cases[b, k, j, i]
            for t in range(counts[case]):
                for c in range(3):
                    e = ends[edges[case, t, c]]
                    block, z, y, x = _place(b, k + e[2], j + e[1], i + e[0], around)
                    indices[n, c] = numbers[block, z, y, x, e[3]]
                n += 1


# Table of marching cubes: the triangles of a cube of eight voxels, for each way in which its
# corners lie inside and outside.
#
# Marching cubes (Lorensen and Cline 1987). The table is worked out, not listed: on each face of
# the cube, every run of corners inside is cut off by a segment of its own, so that two cubes
# agree on the face between them and the surface has no holes; the segments join to loops, which
# are filled with triangles.
#
# Corner x + 2 y + 4 z of a cube lies at (x, y, z); bit c of a case is set where corner c is
# inside.

MOST_TRIANGLES = 5
"""Of one cube."""

EDGES: NDArray[np.int64] = np.array(
    [
        [x, y, z, axis]
        for axis in range(3)
        for z, y, x in product(range(2), repeat=3)
        if (x, y, z)[axis] == 0
    ]
)
"""(12, 4) x, y, z of an edge's lower corner in the cube, and its axis."""

_EDGE_BETWEEN = {
    frozenset((low := x + 2 * y + 4 * z, low + (1 << axis))): edge
    for edge, (x, y, z, axis) in enumerate(EDGES.tolist())
}


def _faces() -> list[list[int]]:
    """The corners of the six faces, counterclockwise as seen from outside."""
    faces = []
    for axis in range(3):
        u, v, side = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3, 1 << axis
        faces += [[side, side + u, side + u + v, side + v], [0, v, u + v, u]]
    return faces


_FACES = _faces()
_FACES_OF = [
    {f for f, face in enumerate(_FACES) if set(corners) <= set(face)} for corners in _EDGE_BETWEEN
]


def _loops(case: int) -> list[list[int]]:
    """The edges of the cube that each piece of the surface passes through, counterclockwise as seen
    from outside of it.
    """
    following: dict[int, int] = {}
    for face in _FACES:
        inside = [bool(case >> corner & 1) for corner in face]
        crossed = [_EDGE_BETWEEN[frozenset((face[i - 1], face[i]))] for i in range(4)]
        for i in range(4):
            # a run of corners inside begins: it ends before the next one outside
            if inside[i] and not inside[i - 1]:
                end = next(j % 4 for j in range(i + 1, i + 4) if not inside[j % 4])
                following[crossed[i]] = crossed[end]
    loops = []
    while following:
        loop = [min(following)]
        while (edge := following.pop(loop[-1])) != loop[0]:
            loop.append(edge)
        loops.append(loop)
    return loops


def _fan(loop: list[int]) -> list[list[int]]:
    """Triangles that fill a loop, none of whose inner sides lies in a face of the cube where that
    can be: two cubes might both have it there.
    """
    turned = [loop[i:] + loop[:i] for i in range(len(loop))]
    inner = [[(t[0], t[k]) for k in range(2, len(t) - 1)] for t in turned]
    hidden = [all(not _FACES_OF[a] & _FACES_OF[b] for a, b in sides) for sides in inner]
    chosen = turned[hidden.index(True) if True in hidden else 0]
    return [[chosen[0], chosen[k], chosen[k + 1]] for k in range(1, len(chosen) - 1)]


@cache
def cube_cases() -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Compute the number of triangles of each case (256,), and the edges that their corners lie on
    (256, MOST_TRIANGLES, 3).
    """
    counts, edges = np.zeros(256, np.int8), np.zeros((256, MOST_TRIANGLES, 3), np.int8)
    for case in range(256):
        triangles = [triangle for loop in _loops(case) for triangle in _fan(loop)]
        counts[case] = len(triangles)
        edges[case, : len(triangles)] = triangles if triangles else np.zeros((0, 3))
    return counts, edges


# The voxels of a tile.

MIN_WEIGHT = 0.05
"""A surface is kept where the weights add up to this: a standard error of some four voxels, seen
once.
"""


@dataclass(frozen=True, eq=False)
class Volume:
    """A tile's voxels. blocks: (B, 3) int32 coordinates, sorted. tsdf: signed distance in units of
    the truncation; weight: its weight, both (B, 8, 8, 8) float32, index z, y, x. color: (B, 8, 8,
    8, 3) float32, 0..255; color_weight: (B, 8, 8, 8) float32.
    """

    blocks: NDArray[np.int32]
    voxel_m: float
    tsdf: NDArray[np.float32]
    weight: NDArray[np.float32]
    color: NDArray[np.float32]
    color_weight: NDArray[np.float32]

    @classmethod
    def empty(cls, blocks: NDArray[np.int32], voxel_m: float) -> "Volume":
        """Make the voxels of these blocks, with nothing measured in any."""
        shape = (len(blocks), BLOCK, BLOCK, BLOCK)
        tsdf, weight, color_weight = (np.zeros(shape, np.float32) for _ in range(3))
        return cls(blocks, voxel_m, tsdf, weight, np.zeros((*shape, 3), np.float32), color_weight)


PART_BLOCKS = 64
"""Blocks that a core works on at once: some milliseconds."""


def extract(volume: Volume, own: NDArray[np.int64]) -> Surface:
    """Extract the surface: where the signed distance is zero and all eight voxels around have
    weight.

    own: (b,) numbers of the blocks whose cubes are searched. The cubes of a block reach to the
    first voxels of the next block: each belongs to one block. So tiles that share no own block
    share no triangle, and their points on the plane between them are equal to the bit. Points and
    triangles come in the order of the blocks, whatever the number of cores.
    """
    blocks = len(volume.blocks)
    around = np.empty((blocks, 27), np.int32)
    in_parts(lambda first, last: neighbors(volume.blocks, around, first, last), blocks, PART_BLOCKS)
    cubes = _Cubes.of(volume, own, around)
    counts = np.zeros(blocks, np.int64)
    in_parts(
        lambda first, last: count_points(cubes.numbers, counts, first, last), blocks, PART_BLOCKS
    )
    starts, points = _starts(counts), int(counts.sum())
    positions, normals = np.empty((points, 3), np.float32), np.empty((points, 3), np.float32)
    colors = np.empty((points, 3), np.uint8)

    def place_part(first: int, last: int) -> None:
        voxels = volume.tsdf, volume.weight, volume.color, volume.color_weight
        placed = positions, normals, colors
        place_points(
            volume.blocks,
            around,
            voxels,
            MIN_WEIGHT,
            volume.voxel_m,
            cubes.numbers,
            starts,
            placed,
            first,
            last,
        )

    in_parts(place_part, blocks, PART_BLOCKS)  # it numbers the points, which the triangles refer to
    return Surface(positions, normals, colors, cubes.triangles(own, around))


@dataclass(frozen=True, eq=False)
class _Cubes:
    """The cubes of a tile. cases, numbers: as in extraction.py. counts: (B,) int64, triangles of
    each block.
    """

    cases: NDArray[np.uint8]
    numbers: NDArray[np.int32]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, volume: Volume, own: NDArray[np.int64], around: NDArray[np.int32]) -> "_Cubes":
        """Find the case of each cube; ``numbers`` is 0 on each edge that has a point, -1 on the
        others.
        """
        cases = np.empty(volume.tsdf.shape, np.uint8)
        numbers = np.full((*volume.tsdf.shape, 3), -1, np.int32)
        counts = np.zeros(len(volume.blocks), np.int64)
        tables, found = (*cube_cases(), EDGES), (cases, numbers, counts)

        def find_part(first: int, last: int) -> None:
            find_cases(
                own, around, volume.tsdf, volume.weight, MIN_WEIGHT, tables, found, first, last
            )

        in_parts(find_part, len(own), PART_BLOCKS)
        return cls(cases, numbers, counts)

    def triangles(self, own: NDArray[np.int64], around: NDArray[np.int32]) -> NDArray[np.int32]:
        """List the points of each triangle, (T, 3); to be called once ``numbers`` holds the numbers
        of the points.
        """
        starts = _starts(self.counts)
        tables, found = (*cube_cases(), EDGES), (self.cases, self.numbers)
        indices = np.empty((self.counts.sum(), 3), np.int32)

        def list_part(first: int, last: int) -> None:
            list_triangles(own, around, tables, found, starts, indices, first, last)

        in_parts(list_part, len(own), PART_BLOCKS)
        return indices


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(B,) the number of each block's first item, where the blocks hold so many each."""
    starts = np.zeros(len(counts), np.int64)
    starts[1:] = np.cumsum(counts)[:-1]
    return starts
