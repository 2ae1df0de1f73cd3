"""Tiles joined without seams: points on a border between tiles are written once."""

from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.map_files import whole
from stereo_seecolor.mapping.surface.fusion import Surface
from stereo_seecolor.mapping.surface.islands import near_border

VERTEX = np.dtype([("position", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)])
_FACE = np.dtype([("count", "u1"), ("indices", "<i4", 3)])
_PROPERTIES = "".join(
    [f"property float {axis}\n" for axis in ("x", "y", "z", "nx", "ny", "nz")]
    + [f"property uchar {c}\n" for c in ("red", "green", "blue")]
)


def write_map(surfaces: Iterable[Surface], tile_m: float, cloud: Path, mesh: Path) -> tuple[int, int]:
    """Write all tiles as one cloud and one mesh (binary PLY, float32), one tile in memory at a time; (points, triangles)."""
    with whole(cloud) as cloud_path, whole(mesh) as mesh_path:
        body, faces = cloud_path.with_suffix(".vertices"), mesh_path.with_suffix(".faces")
        try:
            with body.open("wb") as vertex_file, faces.open("wb") as face_file:
                counts = _write_bodies(surfaces, tile_m, vertex_file, face_file)
            _assemble(cloud_path, _header(counts[0], 0), body)
            _assemble(mesh_path, _header(*counts), body, faces)
        finally:
            body.unlink(missing_ok=True)
            faces.unlink(missing_ok=True)
    return counts


def _write_bodies(surfaces: Iterable[Surface], tile_m: float, vertex_file: BinaryIO, face_file: BinaryIO) -> tuple[int, int]:
    border: dict[bytes, int] = {}
    points = triangles = 0
    for surface in surfaces:
        numbers = np.full(len(surface.points_m), -1, np.int64)
        on_border = np.flatnonzero(near_border(surface.points_m, tile_m))
        keys = [point.tobytes() for point in surface.points_m[on_border]]
        numbers[on_border] = [border.get(key, -1) for key in keys]
        new = np.flatnonzero(numbers < 0)
        numbers[new] = points + np.arange(len(new))
        border.update(zip(keys, numbers[on_border].tolist(), strict=True))
        vertex_file.write(_vertices(surface, new).tobytes())
        faces = np.empty(len(surface.triangles), _FACE)
        faces["count"], faces["indices"] = 3, numbers[surface.triangles]
        face_file.write(faces.tobytes())
        points, triangles = points + len(new), triangles + len(faces)
    return points, triangles


def _vertices(surface: Surface, chosen: NDArray[np.int64]) -> NDArray[np.void]:
    vertices = np.empty(len(chosen), VERTEX)
    vertices["position"], vertices["normal"] = surface.points_m[chosen], surface.normals[chosen]
    vertices["color"] = surface.colors[chosen]
    return vertices


def _header(points: int, triangles: int) -> bytes:
    faces = f"element face {triangles}\nproperty list uchar int vertex_indices\n" if triangles else ""
    return f"ply\nformat binary_little_endian 1.0\nelement vertex {points}\n{_PROPERTIES}{faces}end_header\n".encode()


def _assemble(path: Path, header: bytes, *bodies: Path) -> None:
    with path.open("wb") as target:
        target.write(header)
        for body in bodies:
            with body.open("rb") as source:
                while chunk := source.read(1 << 22):
                    target.write(chunk)
