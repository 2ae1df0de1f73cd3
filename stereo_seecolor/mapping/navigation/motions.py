"""Residuals of given poses against the relative poses that the images show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration.transforms import inverse, rotation_vector, transform_points
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array

SAME_PIXEL = 0.02
"""Two points lie in the same direction if their normalized image coordinates differ by less: about
a coarse point's spacing.
"""
LEAST_EDGES = 5
"""Fewer fit anything."""
TURN_AS_STEP_RAD = 0.2
"""A turn off by this counts as much as a shift off by a whole step."""


@dataclass(frozen=True, eq=False)
class Motions:
    """Relative poses of E edges as given, and as measured, both (E, 4, 4), p_i = T_i_j p_j."""

    given: Array
    measured: Array
    edges: Sequence[Edge] = ()

    @classmethod
    def of(cls, T_world_camera: Array, edges: Sequence[Edge]) -> "Motions":
        """The edges whose frames both have a pose."""
        known = np.asarray(np.isfinite(T_world_camera).all(axis=(1, 2))).tolist()
        posed = [e for e in edges if known[e.i] and known[e.j]]
        i, j = [e.i for e in posed], [e.j for e in posed]
        measured = np.array([e.T_i_j for e in posed]).reshape(-1, 4, 4)
        return cls(inverse(T_world_camera[i]) @ T_world_camera[j], measured, posed)

    @property
    def frames(self) -> int:
        """How many frames the edges join."""
        return len({frame for e in self.edges for frame in (e.i, e.j)})

    def shifts_in_world(self, T_world_camera: Array) -> tuple[Array, Array]:
        """The given and the measured shifts, (E, 3) meters along the world's axes, both by the
        given attitudes of the first frames.
        """
        R = T_world_camera[[e.i for e in self.edges], :3, :3]
        given, measured = (
            np.einsum("nij,nj->ni", R, T[:, :3, 3]) for T in (self.given, self.measured)
        )
        return given, measured

    @property
    def position_m(self) -> Array:
        """The distance between the given and the measured shift: (E,) meters."""
        return np.asarray(np.linalg.norm(self.given[:, :3, 3] - self.measured[:, :3, 3], axis=1))

    @property
    def attitude_rad(self) -> Array:
        """The angle between the given and the measured rotation: (E,)."""
        if not len(self.given):
            return np.zeros(0)
        turns = np.swapaxes(self.measured[:, :3, :3], 1, 2) @ self.given[:, :3, :3]
        return np.asarray(np.linalg.norm(rotation_vector(turns), axis=1))

    @property
    def step_m(self) -> float:
        """Median measured shift."""
        return (
            float(np.median(np.linalg.norm(self.measured[:, :3, 3], axis=1)))
            if len(self.measured)
            else float("nan")
        )


def by_frame(values: Array, edges: Sequence[Edge], count: int) -> Array:
    """The median of values (E,) over each frame's edges: (count,), NaN without edges."""
    ends = np.array([[e.i, e.j] for e in edges], np.int64).reshape(-1, 2)
    result = np.full(count, np.nan)
    for frame in np.unique(ends):
        result[frame] = np.median(values[(ends == frame).any(axis=1)])
    return result


def depth_difference_m(
    points_i: NDArray[np.floating], points_j: NDArray[np.floating], T_i_j: Array
) -> float:
    """Median distance along the rays of frame i between what it and frame j saw there.

    points_i, points_j: (n, 3) in each camera. NaN where the two do not overlap by this pose.
    """
    seen = transform_points(T_i_j, points_j)
    seen = seen[seen[:, 2] > 0]
    if not len(points_i) or not len(seen):
        return float("nan")
    # a tree that is asked once is not worth the time to balance it
    tree = cKDTree(points_i[:, :2] / points_i[:, 2:], balanced_tree=False, compact_nodes=False)
    apart, nearest = tree.query(seen[:, :2] / seen[:, 2:], distance_upper_bound=SAME_PIXEL)
    both = np.isfinite(apart)
    off_m = points_i[np.asarray(nearest)[both], 2] - seen[both, 2]
    return float(np.median(np.abs(off_m))) if both.any() else float("nan")


def misfits(T_world_camera: Array, edges: Sequence[Edge]) -> Array:
    """How badly poses fit each edge between them: shifts, and turns in TURN_AS_STEP_RAD."""
    motions = Motions.of(T_world_camera, edges)
    return np.hypot(motions.position_m / motions.step_m, motions.attitude_rad / TURN_AS_STEP_RAD)


def misfit(T_world_camera: Array, edges: Sequence[Edge]) -> float:
    """Compute how badly poses fit the edges: the median; infinite for too few."""
    off = misfits(T_world_camera, edges)
    return float(np.median(off)) if len(off) >= LEAST_EDGES else float("inf")
