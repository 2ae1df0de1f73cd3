"""M3C2 distances between two surfaces, along the ground's normal, at overhangs, too.

M3C2 (Lague, Brodu and Leroux 2013, ISPRS J. 82): around each core point the mean place of both
surfaces in a cylinder along the normal. Its level of detection carries the standard errors of the
points and of the registration (Winiwarter, Anders and Hoefle 2021, ISPRS J. 178), the same for all
three axes of a point.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereo_seecolor.extras.reef.comparing.difference import NORMAL_95, spread_by
from stereo_seecolor.extras.reef.site_surface import SiteMesh
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class M3c2Settings:
    """The cylinder."""

    radius_cells: float = 2.5
    # of each surface that are tried: a disk of this radius holds about 20 vertices
    neighbors: int = 24
    # vertices within a cylinder whose errors are one: those of ranges reach over a few voxels
    correlated: float = 9.0
    fewest: int = 4  # in the cylinder


SETTINGS = M3c2Settings()


@dataclass(frozen=True, eq=False)
class SurfaceDistances:
    """distance_m, lod_m: (N,) at core points, positive where b lies outside of a; or NaN."""

    distance_m: Array
    lod_m: Array


def distances(
    a: SiteMesh, b: SiteMesh, core_m: Array, stds_m: tuple[Array, Array, Array], cell_m: float
) -> SurfaceDistances:
    """Compute the distances. core_m: (N, 3) places on a. stds_m: (N,) standard errors there of a's
    points, of b's, and of the registration.
    """
    tree_a, tree_b = cKDTree(a.points_m), cKDTree(b.points_m)
    near_a = tree_a.query(core_m, SETTINGS.neighbors)[1]
    normals = a.normals[near_a].mean(axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    mean_a, count_a = _along(a.points_m[near_a], core_m, normals, cell_m)
    mean_b, count_b = _along(
        b.points_m[tree_b.query(core_m, SETTINGS.neighbors)[1]], core_m, normals, cell_m
    )
    usable = (count_a >= SETTINGS.fewest) & (count_b >= SETTINGS.fewest)
    std_a, std_b, shared = stds_m
    variance = std_a**2 / _independent(count_a) + std_b**2 / _independent(count_b) + shared**2
    distance = np.where(usable, mean_b - mean_a, np.nan)
    return SurfaceDistances(distance, np.where(usable, NORMAL_95 * np.sqrt(variance), np.nan))


def relearned(distances: SurfaceDistances, stable: NDArray[np.bool_]) -> SurfaceDistances:
    """Levels of detection (H, W) within which 95 % of stable ground lie, from earlier ones."""
    std_m = distances.lod_m / NORMAL_95
    return SurfaceDistances(
        distances.distance_m,
        distances.lod_m * spread_by(np.abs(distances.distance_m) / std_m, std_m, stable),
    )


def _along(points: Array, core: Array, normals: Array, cell_m: float) -> tuple[Array, Array]:
    """Mean along the normal of the neighbors (N, k, 3) in the cylinder, and their number."""
    offset = points - core[:, None]
    along = np.einsum("nki,ni->nk", offset, normals)
    across = np.linalg.norm(offset - along[..., None] * normals[:, None], axis=-1)
    inside = across < SETTINGS.radius_cells * cell_m
    count = inside.sum(axis=1)
    return (along * inside).sum(axis=1) / np.maximum(count, 1), count


def _independent(count: Array) -> Array:
    """Effective number of independent errors of ``count`` points."""
    return np.maximum(count / SETTINGS.correlated, 1.0)
