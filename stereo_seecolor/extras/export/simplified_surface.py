"""The mesh that is textured: the map's, with as few triangles as a bound allows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.export.simplify import simplify
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.mapping.surface.small_holes import closed
from stereo_seecolor.run_folder.layout import MESH
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.texture.surface import PaintedSurface

BOUND_VOXELS = 0.5
"""Of the bound, in voxels of the map: finer than its surface was sampled."""
LONGEST = 0.1
"""Of an edge, as a fraction of the images' lower side on the bottom: a triangle is to lie in one
image as a whole.
"""


@dataclass(frozen=True, eq=False)
class SimplifiedSurface(PaintedSurface):
    """normal (V, 3) float32. largest_m, rms_m: how far the vertices of the map's own surface are
    from it. original: how many triangles that one has.
    """

    normal: NDArray[np.float32]
    largest_m: float
    rms_m: float
    original: int

    def simplify(self, bound_m: float, longest_m: float) -> "SimplifiedSurface":
        """Simplify further: at most ``bound_m`` away, no new edge longer than ``longest_m``."""
        found = simplify(self.position, self.triangles, bound_m, longest_m)
        return SimplifiedSurface(
            self.position[found.kept],
            self.color[found.kept],
            found.triangles,
            self.bound_m + bound_m,
            self.normal[found.kept],
            self.largest_m + found.largest_m,
            self.rms_m + found.rms_m,
            self.original,
        )


def read_surface(posed: PosedRun) -> SimplifiedSurface:
    """The run's mesh, its holes of single voxels closed, simplified within half a voxel."""
    longest_m = longest_edge_m(posed)
    path = posed.map_folder / MESH
    vertices, faces = read_vertices(path), read_triangles(path)["indices"]
    triangles = closed(vertices["position"], faces, posed.voxel_m).astype(np.int32)
    whole = SimplifiedSurface(
        np.array(vertices["position"], np.float64),
        np.array(vertices["color"]),
        triangles,
        0.0,
        np.array(vertices["normal"]),
        0.0,
        0.0,
        len(faces),
    )
    return whole.simplify(BOUND_VOXELS * posed.voxel_m, longest_m)


def longest_edge_m(posed: PosedRun) -> float:
    """The longest edge of a triangle that one image can hold."""
    return LONGEST * min(posed.geometry.image_size) * posed.pixel_m
