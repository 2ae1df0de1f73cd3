"""Bundle adjustment: the poses of all frames and the positions of all points that they share, from
all observations at once.

An observation is compared with its point in image space, so measured ranges take part, each with
its own standard error. Levenberg-Marquardt; points are eliminated first (Triggs et al. 2000), and
the frames' equations are solved in a sparse order.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from calibration.geometry import RectifiedPair
from calibration.robust_statistics import deviation_about_zero
from stereo_seecolor.mapping.track.bundle_problem import BundleProblem, State
from stereo_seecolor.mapping.track.flattened_relief import flattened_relief
from stereo_seecolor.mapping.track.image_errors import disparity_errors
from stereo_seecolor.mapping.track.known_points import KnownPlace
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.records import Array
from stereo_seecolor.sharpness import EQUALLY_SHARP, LessSharpSide


@dataclass(frozen=True)
class BundleSettings:
    """How poses and points are adjusted."""

    # of the cost, when to stop, for each round: the scales of standard errors,
    tolerances: tuple[float, ...] = (1e-3, 1e-3, 1e-5)
    # which the residuals of one round give the next, are known long before a track without loops
    # has found its place
    # limits of that factor: exact synthetic images would make errors zero
    scales: tuple[float, float] = (0.1, 5.0)
    iterations: int = 20  # of Levenberg-Marquardt; it takes 5
    damping: float = 1e-5  # at the start: the pose graph's poses are near
    # by which it shrinks after a step that helped, and grows after one that did not
    damping_step: float = 10.0
    held_std: float = 1e-6  # meters and radians, of the frame that stays where it is


SETTINGS = BundleSettings()


@dataclass(frozen=True, eq=False)
class Adjusted:
    """T_world_camera: (N, 4, 4). std: (N, 2) standard errors of the position (m) and the attitude
    (rad), all axes together.

    scale: (2,) how many times larger than stated errors of directions and inverse depths are.
    """

    T_world_camera: Array
    std: Array
    scale: tuple[float, float]


def adjust(
    T_world_camera: Array,
    stated: BundleProblem,
    geometry: RectifiedPair,
    less_sharp: LessSharpSide = EQUALLY_SHARP,
) -> Adjusted:
    """Poses (N, 4, 4) adjusted, under a Cauchy kernel. All frames of the problem must be connected.

    Without known places and priors the first stays where it is, and standard errors are relative to
    it.
    stated: with the errors that a matcher states. They are right within a factor: how far to trust
    directions and depths is learned from the residuals.
    Without observations all stay where they are.
    """
    T, std = T_world_camera.copy(), np.full((len(T_world_camera), 2), np.nan)
    if not len(stated.point):
        return Adjusted(T, std, (1.0, 1.0))
    if not stated.priors and not any(isinstance(one, KnownPlace) for one in stated.known):
        held = np.full(3, SETTINGS.held_std), SETTINGS.held_std
        stated = replace(stated, priors=[Prior(0, T[stated.frames[0]], *held)])
    state, scale = State(T[stated.frames], stated.first_places(T[stated.frames])), (1.0, 1.0)
    for tolerance in SETTINGS.tolerances:
        problem, used = stated.scaled(*scale), scale
        state = _solved(problem, state, tolerance)
        scale = _scales(problem, state, used)
    shared = chain(disparity_errors(problem.seen, geometry), flattened_relief(problem, less_sharp))
    T[stated.frames], std[stated.frames] = state.T, _std(problem, state, shared)
    return Adjusted(T, std, used)


def _solved(problem: BundleProblem, state: State, tolerance: float) -> State:
    """The state of least cost near a state; tolerance: of the cost."""
    cost, damping = problem.cost(state), SETTINGS.damping
    for _ in range(SETTINGS.iterations):
        try:
            there = problem.moved(state, problem.linearize(state, damping))
            less = cost - problem.cost(there)
        except np.linalg.LinAlgError:
            less = -np.inf
        if less > 0:
            state = there
            cost -= less
            damping /= SETTINGS.damping_step
        else:
            damping *= SETTINGS.damping_step
        if abs(less) <= tolerance * cost:
            break
    return state


def _scales(problem: BundleProblem, state: State, used: tuple[float, float]) -> tuple[float, float]:
    """Robust deviations of the errors of directions and of inverse depths, in stated ones."""
    errors, (low, high) = problem.errors(state), SETTINGS.scales
    directions, depths = (
        float(np.clip(deviation_about_zero(part) * by, low, high))
        for part, by in zip((errors[:, :2], errors[:, 2]), used, strict=True)
    )
    return directions, depths


def _std(problem: BundleProblem, state: State, shared: Iterable[Array]) -> Array:
    """(N, 2) of position and attitude: by each observation's errors, and those of views.

    All NaN where errors grow so far along an open track, some hundreds of meters, that double
    precision does not hold them.
    """
    number = len(state.T)
    try:
        step = problem.linearize(state)
        covariances = step.blocks.covariances()[:number]
        variances = np.diagonal(covariances, axis1=1, axis2=2).copy()
        for error in shared:
            variances += problem.moves_by(state, step, error) ** 2
    except np.linalg.LinAlgError:
        return np.full((number, 2), np.nan)
    return np.asarray(
        np.sqrt(np.column_stack([variances[:, 3:].sum(axis=1), variances[:, :3].sum(axis=1)]))
    )
