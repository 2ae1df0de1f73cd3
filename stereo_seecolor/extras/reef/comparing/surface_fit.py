"""Alignment of two surfaces where they did not change: iterated point-to-plane least squares with
Tukey's weights.

Chen and Medioni 1991; the scale of Tukey's weights is the spread of the distances themselves, so
changed ground weighs nothing.
Its covariance is a jackknife over blocks of ground: errors of neighboring points are alike, and
those of blocks hardly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration.robust_statistics import TUKEY, biweight, deviation
from calibration.transforms import rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.extras.reef.site_surface import SiteMesh
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class SurfaceFitSettings:
    """How surfaces are aligned."""

    points: int = 40_000  # of b, evenly: with these the standard error of the mean is micrometers
    rounds: int = 30  # at the most
    settled_m: float = 1e-5  # a smaller step, at the far end of the site, is none
    # cosine to the vertical below which a triangle is not ground: seen from above it is an edge
    steepest: float = 0.3
    blocks: int = 6  # a side


SETTINGS = SurfaceFitSettings()


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """T: (4, 4) from b to a. covariance: (6, 6) of (turn in rad, shift in m) about ``center_m``.
    spread_m: of the distances.

    stable: fraction of the points that weigh anything. points: how many lie over both.
    """

    T: Array
    covariance: Array
    center_m: Array
    spread_m: float
    stable: float
    points: int


def surface_fit(a: SiteMesh, b: SiteMesh, T: Array, reach_m: float) -> SurfaceFit | None:
    """Align b to a from a first guess T (b to a). reach_m: how far points are searched. None where
    the surfaces do not overlap.
    """
    moving, first_reach_m = _ground(b), reach_m
    tree = cKDTree(a.points_m)
    for _ in range(SETTINGS.rounds):
        found = _Distances.of(a, tree, transform_points(T, moving), reach_m)
        if found is None:
            return None
        step = np.asarray(
            np.linalg.lstsq(*found.normal_equations(np.ones(len(found.off), bool)), rcond=None)[0],
            np.float64,
        )
        T = found.moved(T, step)
        # vertices lie a voxel apart
        reach_m = max(min(reach_m, 6 * found.spread_m), first_reach_m / 2)
        if np.abs(step[:3]).max() * found.size_m + np.abs(step[3:]).max() < SETTINGS.settled_m:
            break
    found = _Distances.of(a, tree, transform_points(T, moving), reach_m)
    if found is None:
        return None
    over_both = int(
        np.isfinite(
            tree.query(transform_points(T, moving), distance_upper_bound=first_reach_m)[0]
        ).sum()
    )
    stable = float((found.weight > 0).sum()) / over_both
    return SurfaceFit(T, found.covariance(), found.center_m, found.spread_m, stable, over_both)


def _ground(mesh: SiteMesh) -> Array:
    points = mesh.points_m[mesh.normals[:, 2] > SETTINGS.steepest]
    return points[:: -(-len(points) // SETTINGS.points) or 1]


@dataclass(frozen=True, eq=False)
class _Distances:
    """Points (n, 3), how far each lies below the other surface along its normal, weights."""

    points: Array
    normals: Array
    off: Array
    weight: Array
    spread_m: float
    center_m: Array

    @classmethod
    def of(cls, a: SiteMesh, tree: cKDTree, points: Array, reach_m: float) -> "_Distances | None":
        distance, found = tree.query(points, distance_upper_bound=reach_m)
        near, nearest = np.isfinite(distance), np.asarray(found)
        if near.sum() < 100:
            return None
        points, nearest = points[near], nearest[near]
        normals = a.normals[nearest]
        off = ((a.points_m[nearest] - points) * normals).sum(axis=1)
        spread = max(deviation(off), 1e-6)
        weight = biweight((off - float(np.median(off))) / (TUKEY * spread))
        return cls(points, normals, off, weight, spread, points.mean(axis=0))

    @property
    def size_m(self) -> float:
        return float(np.ptp(self.points, axis=0).max())

    def normal_equations(self, chosen: NDArray[np.bool_]) -> tuple[Array, Array]:
        """(6, 6) and (6,) of the turn about the center and the shift that undo the distances."""
        arm = self.points[chosen] - self.center_m
        J = np.concatenate([np.cross(arm, self.normals[chosen]), self.normals[chosen]], axis=1)
        weighted = J * self.weight[chosen, None]
        return weighted.T @ J, weighted.T @ self.off[chosen]

    def moved(self, T: Array, step: Array) -> Array:
        """T followed by a step about the center."""
        R = rotation_from_vector(step[:3])
        return np.asarray(rigid_transform(R, self.center_m - R @ self.center_m + step[3:]) @ T)

    def covariance(self) -> Array:
        """(6, 6) by leaving out one block of ground at a time."""
        span = np.ptp(self.points[:, :2], axis=0)
        place: Array = (
            (self.points[:, :2] - self.points[:, :2].min(axis=0))
            / np.maximum(span, 1e-9)
            * SETTINGS.blocks
        )
        cells = np.minimum(np.floor(place), SETTINGS.blocks - 1)
        block = cells[:, 0] * SETTINGS.blocks + cells[:, 1]
        parts = [self.normal_equations(np.asarray(block == number)) for number in np.unique(block)]
        total_H, total_g = sum(H for H, _ in parts), sum(g for _, g in parts)
        steps = np.array(
            [np.linalg.lstsq(total_H - H, total_g - g, rcond=None)[0] for H, g in parts]
        )
        off = steps - steps.mean(axis=0)
        return np.asarray((len(parts) - 1) / len(parts) * off.T @ off)
