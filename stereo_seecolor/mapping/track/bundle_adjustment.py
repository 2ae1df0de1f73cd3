"""Bundle adjustment: the poses of all frames and the places of all points that they share, from every sighting at once.

A sighting in image space is what a stereo camera of focal length 1 and baseline 1 sees: x / z in its left image, x / z - 1 / z in
its right one. So measured ranges take part, each with its own standard error, and GTSAM's stereo factor does the work.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.track.known_points import Known, KnownPlace
from stereo_seecolor.mapping.track.pose_graph import CAUCHY, Prior, add_priors, gtsam_library
from stereo_seecolor.mapping.track.sightings import Sightings
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BundleSettings:
    """How poses and points are adjusted."""

    rounds: int = 3  # of solving, and then scaling the standard errors by what the residuals show
    scales: tuple[float, float] = (0.1, 5.0)  # limits of that factor: exact drawn images would make errors zero
    least_left: float = 0.05  # of a residual's variance; where the point took more, nothing is learned from it
    steps_of_std: float = 8.0  # standard errors are rounded to a factor of exp(1 / 8): one noise model serves many sightings
    relative_tolerance: float = 1e-4  # of the cost, when to stop
    iterations: int = 20  # of Levenberg-Marquardt; it takes 5


SETTINGS = BundleSettings()


@dataclass(frozen=True, eq=False)
class Adjusted:
    """T_world_camera: (N, 4, 4). std: (N, 2) standard errors of the position (m) and the attitude (rad), all axes together.

    scale: (2,) how many times larger than stated the errors of directions and of inverse depths turned out.
    """

    T_world_camera: Array
    std: Array
    scale: tuple[float, float]


def adjust(T_world_camera: Array, sightings: Sightings, priors: Sequence[Prior] = (), known: Sequence[Known] = ()) -> Adjusted:
    """Poses (N, 4, 4) adjusted; the sightings' frames, and the priors', are their numbers. All must hang together.

    known: lengths between points, and their places. Without known places and priors the first stays where it is, and standard
    errors are relative to it. Levenberg-Marquardt under a Cauchy kernel.
    How far to trust directions and depths is learned from the residuals: what a matcher states is right within a factor.
    Without sightings all stay where they are. Raises DeviceError if GTSAM is missing.
    """
    if not len(sightings.frame):
        return Adjusted(T_world_camera, np.full((len(T_world_camera), 2), np.nan), (1.0, 1.0))
    T, points, scale = T_world_camera, _first_places(T_world_camera, sightings), (1.0, 1.0)
    for _ in range(SETTINGS.rounds):
        problem = _Problem(T, points, sightings, scale)
        problem.hold(T, priors, known)
        T, points = problem.solve()
        used, scale = scale, _scales(T, points, sightings, scale)
    return Adjusted(T, problem.std(T), used)


def _first_places(T: Array, sightings: Sightings) -> Array:
    """(m, 3) means of what the sightings say."""
    seen = sightings.seen.points
    local = np.column_stack([seen[:, :2], np.ones(len(seen))]) / seen[:, 2:]
    world = np.einsum("nij,nj->ni", T[sightings.frame, :3, :3], local) + T[sightings.frame, :3, 3]
    sums = np.stack([np.bincount(sightings.point, column) for column in world.T], axis=-1)
    return np.asarray(sums / sightings.views[:, None])


def _scales(T: Array, points: Array, sightings: Sightings, scale: tuple[float, float]) -> tuple[float, float]:
    """Robust standard deviations of the residuals of directions and of inverse depths, in stated ones.

    Residuals are smaller than errors, since each point's place was fitted to them: by its leverage, at the scales that were used.
    """
    to_camera = inverse(T)[sightings.frame]
    local = np.einsum("nij,nj->ni", to_camera[:, :3, :3], points[sightings.point]) + to_camera[:, :3, 3]
    predicted = np.column_stack([local[:, :2], np.ones(len(local))]) / local[:, 2:]
    left = 1 - _leverage(to_camera[:, :3, :3], predicted, sightings, np.array([scale[0], scale[0], scale[1]]))
    off = (sightings.seen.points - predicted) / sightings.seen.std / np.sqrt(np.maximum(left, SETTINGS.least_left))
    low, high = SETTINGS.scales
    directions, depths = (float(np.clip(deviation_about_zero(part), low, high)) for part in (off[:, :2], off[:, 2]))
    return directions, depths


def _leverage(R: Array, predicted: Array, sightings: Sightings, scale: Array) -> Array:
    """(n, 3) how much of each coordinate's error its point's place takes up, 0 to 1. R: (n, 3, 3) world to camera."""
    by_local = np.zeros((len(predicted), 3, 3))
    by_local[:, 0, 0] = by_local[:, 1, 1] = predicted[:, 2]
    by_local[:, :, 2] = -predicted * predicted[:, 2:]
    J = (by_local @ R) / (scale * sightings.seen.std)[:, :, None]
    own = np.einsum("nki,nkj->nij", J, J).reshape(-1, 9)
    H = np.stack([np.bincount(sightings.point, column) for column in own.T], axis=-1).reshape(-1, 3, 3)
    return np.asarray(np.einsum("nki,nij,nkj->nk", J, np.linalg.inv(H)[sightings.point], J))


class _Problem:
    """One nonlinear least-squares problem. Poses have the keys 0 to N - 1, points those after them."""

    def __init__(self, T: Array, points: Array, sightings: Sightings, scale: tuple[float, float]) -> None:
        gtsam = self._gtsam = gtsam_library()
        self._graph, self._values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._start, self._first_point, self._points = T, len(T), len(points)
        self._frames = np.unique(sightings.frame)
        for frame in self._frames.tolist():
            self._values.insert(frame, gtsam.Pose3(T[frame]))
        for number, place in enumerate(points, self._first_point):
            self._values.insert(number, place)
        self._add_sightings(sightings, scale)

    def hold(self, T: Array, priors: Sequence[Prior], known: Sequence[Known]) -> None:
        """Add what is known of frames and points. T: (N, 4, 4) as they are now."""
        for frame in np.setdiff1d([prior.frame for prior in priors], self._frames).tolist():
            self._values.insert(frame, self._gtsam.Pose3(T[frame]))
        self._frames = np.union1d(self._frames, [prior.frame for prior in priors]).astype(np.int64)
        for one in known:
            self._graph.add(one.factor(self._first_point))
        if priors or not any(isinstance(one, KnownPlace) for one in known):
            add_priors(self._graph, int(self._frames[0]), T, priors)

    def _add_sightings(self, sightings: Sightings, scale: tuple[float, float]) -> None:
        gtsam, seen = self._gtsam, sightings.seen
        camera = gtsam.Cal3_S2Stereo(1, 1, 0, 0, 0, 1)
        left, right, down = seen.points[:, 0], seen.points[:, 0] - seen.points[:, 2], seen.points[:, 1]
        std = seen.std[:, [0, 2]] * scale
        levels, noise = np.unique(np.rint(SETTINGS.steps_of_std * np.log(std)), axis=0, return_inverse=True)
        models = [self._noise(*np.exp(level / SETTINGS.steps_of_std)) for level in levels]
        columns = (left, right, down, noise.ravel(), sightings.frame, sightings.point + self._first_point)
        for u_left, u_right, v, model, frame, point in zip(*(column.tolist() for column in columns), strict=True):
            measured = gtsam.StereoPoint2(u_left, u_right, v)
            self._graph.add(gtsam.GenericStereoFactor3D(measured, models[model], frame, point, camera))

    def _noise(self, direction: float, depth: float) -> Any:
        """Of (left, right, down); the right image is the left one less the inverse depth."""
        noise, both = self._gtsam.noiseModel, direction**2
        covariance = np.array([[both, both, 0], [both, both + depth**2, 0], [0, 0, both]])
        return noise.Robust.Create(noise.mEstimator.Cauchy.Create(CAUCHY), noise.Gaussian.Covariance(covariance))

    def solve(self) -> tuple[Array, Array]:
        """Poses (N, 4, 4), and points (m, 3)."""
        parameters = self._gtsam.LevenbergMarquardtParams()
        parameters.setRelativeErrorTol(SETTINGS.relative_tolerance)
        parameters.setMaxIterations(SETTINGS.iterations)
        self._values = self._gtsam.LevenbergMarquardtOptimizer(self._graph, self._values, parameters).optimize()
        T = self._start.copy()
        for frame in self._frames.tolist():
            T[frame] = self._values.atPose3(frame).matrix()
        numbers = range(self._first_point, self._first_point + self._points)
        return T, np.array([self._values.atPoint3(number) for number in numbers])

    def std(self, T: Array) -> Array:
        """(N, 2) of position and attitude, NaN for frames that took no part.

        All NaN where errors grow so far along an open track, some hundreds of meters, that double precision does not hold them.
        """
        found = np.full((len(T), 2), np.nan)
        try:
            marginals = self._gtsam.Marginals(self._graph, self._values)
        except RuntimeError:
            return found
        for frame in self._frames.tolist():
            variances = np.diag(marginals.marginalCovariance(frame))
            found[frame] = np.sqrt(variances[3:].sum()), np.sqrt(variances[:3].sum())
        return found
