"""The levels of detail of a map's mesh, made tile by tile: memory does not grow with the map.

Each level is a mesh of its own, cut into square tiles that lie on disk. A tile is made from the
level before around it, wide enough that its neighbor makes the same of what they share.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.free_memory import at_once
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.ply import let_go, read_triangles, read_vertices
from stereo_seecolor.files.raw_arrays import read_arrays, write_arrays
from stereo_seecolor.mapping.surface.kernels import packed
from stereo_seecolor.mapping.surface.small_holes import closed
from stereo_seecolor.records import Array
from stereo_seecolor.report.map_mesh import SIZES, Piece, middles, rim_of

Place = tuple[int, int]
"""Column and row of a tile, from the south-west."""
PART = 100_000
"""Triangles of a file that are looked at at once: those of a part of the map, as it was fused."""
SPREAD = 20
"""Numbers of points that lie in a range of no more than so many for each triangle are marked in
it.
"""
AROUND_CELLS = 8
"""A tile is made with so many cells around it: what is done to a mesh reaches over three."""
TILE_BYTES = 70e6
"""Memory of a tile while it is made, as measured."""


@dataclass(frozen=True, eq=False)
class Numbered(Piece):
    """A piece of which each point has a number in the whole mesh: number (N,), rising."""

    number: NDArray[np.int64]

    def of(self, chosen: NDArray[np.bool_]) -> "Numbered":
        """Those of the triangles (T,), with their points."""
        used, triangles = _used(self.triangles[chosen])
        return Numbered(
            self.points_m[used], self.colors[used], triangles, self.rim[used], self.number[used]
        )

    @classmethod
    def joined(cls, parts: "Sequence[Numbered]") -> "Numbered":
        """One of several parts of the same mesh, which share points and no triangles."""
        if not parts:
            points, colors = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
            triangles, number = np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
            return cls(points, colors, triangles, np.zeros(0, np.bool_), number)
        counts = np.cumsum([0, *(len(part.number) for part in parts)])
        number = np.concatenate([part.number for part in parts])
        unique, first, place = np.unique(number, return_index=True, return_inverse=True)
        corners = [part.triangles + start for part, start in zip(parts, counts, strict=False)]
        return cls(
            np.concatenate([part.points_m for part in parts])[first],
            np.concatenate([part.colors for part in parts])[first],
            place[np.concatenate(corners)],
            np.concatenate([part.rim for part in parts])[first],
            unique,
        )


@dataclass(frozen=True, eq=False)
class MeshSource:
    """A mesh whose triangles lie in parts of the map, one after the other, as in a map's mesh.ply:
    read from disk where they are used.

    points_m, colors (V, 3), triangles (T, 3). boxes (P, 4): of each PART of the triangles, the
    least and the largest x and y of their middles. low_z_m: of all points.
    """

    points_m: NDArray[np.float32]
    colors: NDArray[np.uint8]
    triangles: NDArray[np.integer[Any]]
    boxes: Array
    low_z_m: float

    @classmethod
    def of(
        cls,
        points_m: NDArray[np.float32],
        colors: NDArray[np.uint8],
        triangles: NDArray[np.integer[Any]],
    ) -> "MeshSource":
        """Look over a mesh once."""
        boxes, low_z_m = [], np.inf
        for start in range(0, len(triangles), PART):
            part = np.asarray(triangles[start : start + PART], np.int64)
            boxes.append(_box(middles(points_m, part)))
            low_z_m = min(low_z_m, float(points_m[part[:, 0], 2].min()))
            let_go(points_m, triangles)
        return cls(points_m, colors, triangles, np.array(boxes).reshape(-1, 4), low_z_m)

    @classmethod
    def open(cls, path: Path) -> "MeshSource":
        """Open a map's mesh.ply. Raises InputError."""
        vertices, faces = read_vertices(path), read_triangles(path)
        return cls.of(vertices["position"], vertices["color"], faces["indices"])

    @property
    def corner_m(self) -> NDArray[np.float32]:
        """Where tiles begin: the least x and y of the middles, (2,)."""
        return np.asarray(self.boxes[:, :2].min(axis=0), np.float32)

    def places(self, edge_m: float) -> set[Place]:
        """The tiles of that edge that hold the middle of a triangle."""
        found: set[Place] = set()
        for start in range(0, len(self.triangles), PART):
            part = np.asarray(self.triangles[start : start + PART], np.int64)
            found |= _places(middles(self.points_m, part), self.corner_m, edge_m)
            let_go(self.points_m, self.triangles)
        return found

    def within(self, low_m: Array, high_m: Array) -> Numbered:
        """The triangles whose middle lies from low_m to before high_m, x and y."""
        parts = []
        for k in np.flatnonzero(_meet(self.boxes, low_m, high_m)).tolist():
            part = np.asarray(self.triangles[k * PART : (k + 1) * PART], np.int64)
            inside = _inside(middles(self.points_m, part), low_m, high_m)
            parts.append(part[inside])
        chosen = np.concatenate(parts) if parts else np.zeros((0, 3), np.int64)
        number, triangles = _used(chosen)
        points = np.asarray(self.points_m[number], np.float32)
        colors = np.asarray(self.colors[number], np.uint8)
        let_go(self.points_m, self.triangles)
        return Numbered(points, colors, triangles, np.zeros(len(number), np.bool_), number)


@dataclass(frozen=True, eq=False)
class Level:
    """A level of detail, in tiles on disk. cell_m: the edge of its cells. corner_m (2,): where
    its tiles begin. boxes: of each tile, the least and the largest x and y of the middles of
    its triangles (4,). triangles: how many.
    """

    cell_m: float
    corner_m: NDArray[np.float32]
    folder: Path
    boxes: dict[Place, Array]
    triangles: int

    def tiles(self) -> Iterator[tuple[Place, Numbered]]:
        """Read all tiles, one in memory at a time."""
        return ((place, self._read(place)) for place in self.boxes)

    def places(self, edge_m: float) -> set[Place]:
        """The tiles of another edge that hold the middle of a triangle."""
        found: set[Place] = set()
        for _, piece in self.tiles():
            found |= _places(piece.middles_m, self.corner_m, edge_m)
        return found

    def square(self, place: Place, edge_m: float) -> Numbered:
        """The triangles of a tile of another edge."""
        return self.within(*_bounds(self.corner_m, place, edge_m))

    def within(self, low_m: Array, high_m: Array) -> Numbered:
        """The triangles whose middle lies from low_m to before high_m, x and y."""
        places = list(self.boxes)
        meet = _meet(np.array([self.boxes[place] for place in places]), low_m, high_m)
        read = (self._read(places[k]) for k in np.flatnonzero(meet).tolist())
        parts = [part.of(_inside(part.middles_m, low_m, high_m)) for part in read]
        return Numbered.joined(parts)

    def _read(self, place: Place) -> Numbered:
        found = read_arrays(_path(self.folder, place), len(fields(Numbered)))
        if found is None:
            raise OutputError(f"{self.folder}: no room for the page's map")
        return Numbered(*found)


def tile_edge_m(boxes: Array, count: float, more_m: float) -> float:
    """The edge of square tiles of which a mesh fills about ``count``; that of a single one is
    ``more_m`` more than the mesh. boxes: (P, 4) of its parts, which a long track leaves mostly
    empty around them.
    """
    extent_m = boxes[:, 2:].max(axis=0) - boxes[:, :2].min(axis=0)
    if count <= 1:
        return float(extent_m.max()) + more_m
    filled_m2 = min(np.prod(extent_m), np.prod(boxes[:, 2:] - boxes[:, :2], axis=1).sum())
    return float(np.sqrt(filled_m2 / count))


def levels(source: MeshSource, voxel_m: float, folder: Path) -> Iterator[Level]:
    """Make the levels of detail, the finest first: each has half as fine cells as the one before.

    A tile of a level covers four of the level before, and holds about as many triangles as each of
    those. Holes of two cells of a level are closed in it. folder: for the tiles, on disk as long as
    they are used. Raises OutputError where it has no room for them.
    """
    count = len(source.triangles)
    edge_m = tile_edge_m(source.boxes, count / SIZES.tile_triangles, voxel_m)
    corner_m = np.append(source.corner_m, source.low_z_m)
    finer: MeshSource | Level = source
    places, cell_m, number = source.places(edge_m), voxel_m, 0
    while True:
        level = _level(finer, places, cell_m, corner_m, edge_m, folder / str(number))
        if number and not 0 < level.triangles < count:
            return
        yield level
        count = level.triangles
        if len(level.boxes) <= 1 and count <= SIZES.first_triangles:
            return
        places = {(column // 2, row // 2) for column, row in level.boxes}
        finer, cell_m, edge_m, number = level, 2 * cell_m, 2 * edge_m, number + 1


def _level(
    finer: MeshSource | Level,
    places: set[Place],
    cell_m: float,
    corner_m: Array,
    edge_m: float,
    folder: Path,
) -> Level:
    """A level of cells of that edge from the one before, its tiles written to a folder. corner_m
    (3,): of cubes of all levels, so that those of a coarser one contain whole ones of a finer one.
    """
    folder.mkdir(parents=True)
    south_west, around_m = corner_m[:2].astype(np.float32), AROUND_CELLS * cell_m

    def tile(place: Place) -> tuple[Place, Array, int] | None:
        low_m, high_m = _bounds(south_west, place, edge_m)
        part = finer.within(low_m - around_m, high_m + around_m)
        if isinstance(finer, Level):
            part = cluster_vertices(part, cell_m, corner_m)
        triangles = closed(part.points_m, part.triangles, cell_m)
        rim = rim_of(triangles, len(part.points_m))
        part = replace(part, triangles=triangles, rim=rim)
        inside = _inside(part.middles_m, low_m, high_m)
        if not inside.any():
            return None
        own = part.of(inside)
        write_arrays(_path(folder, place), [getattr(own, one.name) for one in fields(own)])
        return place, _box(part.middles_m[inside]), len(own.triangles)

    threads = Threads(at_once(cores(), TILE_BYTES))
    made = [each for each in threads.each(tile, sorted(places)) if each]
    boxes = {place: box for place, box, _ in made}
    count = sum(triangles for *_, triangles in made)
    return Level(cell_m, south_west, folder, boxes, count)


def cluster_vertices(part: Numbered, cell_m: float, corner_m: Array) -> Numbered:
    """A coarser part: the points in each cube of that edge are replaced by their mean (Rossignac
    and Borrel 1993). corner_m: (3,) a corner of cubes.
    """
    cells = np.floor((part.points_m - corner_m) / cell_m).astype(np.int64)
    number, member, count = np.unique(packed(*cells.T), return_inverse=True, return_counts=True)
    values = np.concatenate([part.points_m, part.colors], axis=1).astype(np.float64)
    means = np.stack([np.bincount(member, column) / count for column in values.T], axis=1)
    triangles = member[part.triangles]
    a, b, c = triangles.T
    return Numbered(
        means[:, :3].astype(np.float32),
        np.rint(means[:, 3:]).astype(np.uint8),
        triangles[(a != b) & (b != c) & (c != a)],
        np.zeros(len(number), np.bool_),
        number,
    )


def below(place: Place) -> list[Place]:
    """The tiles of the next finer level that cover the same area."""
    return [(2 * place[0] + i, 2 * place[1] + k) for i in (0, 1) for k in (0, 1)]


def _used(triangles: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The points that triangles (T, 3) use, rising, and the triangles by their places there."""
    if not len(triangles):
        return np.zeros(0, np.int64), triangles
    first, last = int(triangles.min()), int(triangles.max())
    if last - first > SPREAD * len(triangles):
        used, places = np.unique(triangles, return_inverse=True)
        return used, places.reshape(-1, 3)
    is_used = np.zeros(last - first + 1, np.bool_)  # a tenth of the time of sorting
    is_used[triangles - first] = True
    places = np.cumsum(is_used) - 1
    return np.flatnonzero(is_used) + first, places[triangles - first]


def _path(folder: Path, place: Place) -> Path:
    return folder / f"{place[0]}_{place[1]}.raw"


def _box(middles_m: NDArray[np.float32]) -> NDArray[Any]:
    """(4,) the least and the largest x and y."""
    return np.concatenate([middles_m.min(axis=0), middles_m.max(axis=0)])


def _places(
    middles: NDArray[np.float32], corner_m: NDArray[np.float32], edge_m: float
) -> set[Place]:
    found = np.maximum(np.floor((middles - corner_m) / edge_m).astype(np.int64), 0)
    keys = np.unique(found[:, 1] << 32 | found[:, 0]).tolist()
    return {(key & 0xFFFFFFFF, key >> 32) for key in keys}


def _bounds(corner_m: NDArray[np.float32], place: Place, edge_m: float) -> tuple[Array, Array]:
    """The lowest and the highest x and y of a tile; the first ones reach as far as there is
    anything, since middles of coarser levels may lie before the corner.
    """
    at = np.array(place, np.float64)
    low_m = np.where(at > 0, corner_m + at * edge_m, -np.inf)
    return low_m, np.asarray(corner_m + (at + 1) * edge_m, np.float64)


def _meet(boxes: Array, low_m: Array, high_m: Array) -> NDArray[np.bool_]:
    boxes = boxes.reshape(-1, 4)
    return np.asarray(((boxes[:, 2:] >= low_m) & (boxes[:, :2] < high_m)).all(axis=1))


def _inside(middles: NDArray[np.float32], low_m: Array, high_m: Array) -> NDArray[np.bool_]:
    x, y = middles.T
    in_x = (x >= low_m[0]) & (x < high_m[0])
    return np.asarray(in_x & (y >= low_m[1]) & (y < high_m[1]))
