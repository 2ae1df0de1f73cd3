"""The surface of a site as a fused run has it: its mesh, and its terrain, seen from above."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import scale_of, transform_points
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.sides import area_over
from stereo_seecolor.records import Array
from stereo_seecolor.run_folder.layout import MAP, MESH
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run


@dataclass(frozen=True, eq=False)
class SiteMesh:
    """points_m, normals: (V, 3) float64, z up, the map's own coordinates. color: (V, 3) uint8.
    triangles: (T, 3) vertex numbers.
    """

    points_m: Array
    normals: Array
    color: NDArray[np.uint8]
    triangles: NDArray[np.int32]

    def moved(self, T: Array) -> "SiteMesh":
        """The mesh through a similarity (4, 4)."""
        R = T[:3, :3] / scale_of(T)
        return SiteMesh(
            transform_points(T, self.points_m), self.normals @ R.T, self.color, self.triangles
        )

    def area_over(self, grid: Grid) -> Array:
        """(H, W) square meters of mesh over, and below, each cell."""
        return area_over(self.points_m, self.triangles, grid)


def read_mesh(out: Path) -> SiteMesh:
    """The mesh of the map's main component in OUT/map."""
    path = out / MAP / MESH
    vertices = read_vertices(path)
    points, normals = (np.asarray(vertices[name], np.float64) for name in ("position", "normal"))
    return SiteMesh(
        points, normals, np.array(vertices["color"]), np.array(read_triangles(path)["indices"])
    )


@dataclass(frozen=True, eq=False)
class Site:
    """A fused run and its mesh, in the map's own coordinates."""

    posed: PosedRun
    mesh: SiteMesh


def open_site(out: Path) -> Site:
    """A fused run. Raises InputError for one without a map, or with an empty one."""
    posed, mesh = open_posed_run(out), read_mesh(out)
    if not len(mesh.triangles):
        raise InputError(
            f"{out}: its map is empty: fuse it again with more frames or a larger mapping.voxel_m"
        )
    return Site(posed, mesh)
