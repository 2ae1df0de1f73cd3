"""Tiles joined without seams: points on a border between tiles are written once."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.files.ply import FACE, VERTEX, header
from stereo_seecolor.mapping.surface.small_parts import near_border
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import Tiling


def write_map(
    surfaces: Iterable[Surface], tiling: Tiling, folder: Path, comment: str
) -> tuple[Path, Path, int]:
    """Write all tiles as folder/cloud.ply and folder/mesh.ply, one tile in memory at a time; return
    both paths, and the number of points.

    comment: put into both headers. Raises OutputError.
    """
    cloud, mesh = folder / "cloud.ply", folder / "mesh.ply"
    with atomic_path(cloud) as cloud_path, atomic_path(mesh) as mesh_path:
        body, faces = cloud_path.with_suffix(".vertices"), mesh_path.with_suffix(".faces")
        try:
            with body.open("wb") as vertex_file, faces.open("wb") as face_file:
                counts = _write_bodies(surfaces, tiling, vertex_file, face_file)
            _assemble(cloud_path, header(comment, VERTEX, counts[0]), body)
            _assemble(mesh_path, header(comment, VERTEX, *counts), body, faces)
        finally:
            body.unlink(missing_ok=True)
            faces.unlink(missing_ok=True)
    return cloud, mesh, counts[0]


def _write_bodies(
    surfaces: Iterable[Surface], tiling: Tiling, vertex_file: BinaryIO, face_file: BinaryIO
) -> tuple[int, int]:
    border: dict[bytes, int] = {}
    points = triangles = 0
    for surface in surfaces:
        numbers = np.full(len(surface.points_m), -1, np.int64)
        on_border = np.flatnonzero(near_border(surface.points_m, tiling))
        keys = [point.tobytes() for point in surface.points_m[on_border]]
        numbers[on_border] = [border.get(key, -1) for key in keys]
        new = np.flatnonzero(numbers < 0)
        numbers[new] = points + np.arange(len(new))
        border.update(zip(keys, numbers[on_border].tolist(), strict=True))
        vertices = np.empty(len(new), VERTEX)
        vertices["position"], vertices["normal"] = surface.points_m[new], surface.normals[new]
        vertices["color"] = surface.colors[new]
        vertex_file.write(vertices.tobytes())
        faces = np.empty(len(surface.triangles), FACE)
        faces["count"], faces["indices"] = 3, numbers[surface.triangles]
        face_file.write(faces.tobytes())
        points, triangles = points + len(new), triangles + len(faces)
    return points, triangles


def _assemble(path: Path, head: bytes, *bodies: Path) -> None:
    with path.open("wb") as target:
        target.write(head)
        for body in bodies:
            with body.open("rb") as source:
                shutil.copyfileobj(source, target)
