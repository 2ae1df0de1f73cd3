"""Bundle adjustment: the poses of all frames and the positions of all points that they share, from
all observations at once.

An observation is compared with its point in image space, so measured ranges take part, each with
its own standard error. Levenberg-Marquardt; points are eliminated first (Triggs et al. 2000), and
the frames' equations are solved in a sparse order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError, MappingError
from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.control_points import UPSIDE_DOWN, ControlFit, control_fit
from stereo_seecolor.mapping.placed_markers import ScaleCheck
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track import loops
from stereo_seecolor.mapping.track.bundle_problem import BundleProblem, Known, KnownPlace, State
from stereo_seecolor.mapping.track.fiducials import PLACES, SETTINGS, Marks
from stereo_seecolor.mapping.track.frame_blocks import TrackObservations, observations
from stereo_seecolor.mapping.track.loops import Prior
from stereo_seecolor.mapping.track.odometry import Track
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]


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


BUNDLE_SETTINGS = BundleSettings()


@dataclass(frozen=True, eq=False)
class Adjusted:
    """T_world_camera: (N, 4, 4). std: (N, 2) standard errors of the position (m) and the attitude
    (rad), all axes together.

    scale: (2,) how many times larger than stated the errors of directions and of inverse depths
    turned out.
    """

    T_world_camera: Array
    std: Array
    scale: tuple[float, float]


def adjust(
    T_world_camera: Array,
    observations: TrackObservations,
    priors: Sequence[Prior] = (),
    known: Sequence[Known] = (),
) -> Adjusted:
    """Poses (N, 4, 4) adjusted; the observations' frames, and the priors', are their numbers. All
    must be connected.

    known: lengths between points, and their places. Without known places and priors the first stays
    where it is, and standard errors are relative to it. Under a Cauchy kernel.
    How far to trust directions and depths is learned from the residuals: what a matcher states is
    right within a factor.
    Without observations all stay where they are.
    """
    T, std = T_world_camera.copy(), np.full((len(T_world_camera), 2), np.nan)
    if not len(observations.frame):
        return Adjusted(T, std, (1.0, 1.0))
    if not priors and not any(isinstance(one, KnownPlace) for one in known):
        first = int(observations.frame.min())
        priors = [
            Prior(
                first,
                T[first],
                np.full(3, BUNDLE_SETTINGS.held_std),
                BUNDLE_SETTINGS.held_std,
            )
        ]
    stated = BundleProblem.of(observations, priors, known)
    state, scale = State(T[stated.frames], stated.first_places(T[stated.frames])), (1.0, 1.0)
    for tolerance in BUNDLE_SETTINGS.tolerances:
        problem, used = stated.scaled(*scale), scale
        state = _solved(problem, state, tolerance)
        scale = _scales(problem, state, used)
    T[stated.frames], std[stated.frames] = state.T, _std(problem, state)
    return Adjusted(T, std, used)


def _solved(problem: BundleProblem, state: State, tolerance: float) -> State:
    """The state of least cost near a state; tolerance: of the cost."""
    cost, damping = problem.cost(state), BUNDLE_SETTINGS.damping
    for _ in range(BUNDLE_SETTINGS.iterations):
        try:
            there = problem.moved(state, problem.linearized(state, damping))
            less = cost - problem.cost(there)
        except np.linalg.LinAlgError:
            less = -np.inf
        if less > 0:
            state, cost, damping = (
                there,
                cost - less,
                damping / BUNDLE_SETTINGS.damping_step,
            )
        else:
            damping *= BUNDLE_SETTINGS.damping_step
        if abs(less) <= tolerance * cost:
            break
    return state


def _scales(problem: BundleProblem, state: State, used: tuple[float, float]) -> tuple[float, float]:
    """Robust standard deviations of the errors of directions and of inverse depths, in stated
    ones.
    """
    errors, (low, high) = problem.errors(state), BUNDLE_SETTINGS.scales
    directions, depths = (
        float(np.clip(deviation_about_zero(part) * by, low, high))
        for part, by in zip((errors[:, :2], errors[:, 2]), used, strict=True)
    )
    return directions, depths


def _std(problem: BundleProblem, state: State) -> Array:
    """(N, 2) of position and attitude.

    All NaN where errors grow so far along an open track, some hundreds of meters, that double
    precision does not hold them.
    """
    try:
        found = problem.linearized(state).blocks.covariances()[: len(state.T)]
    except np.linalg.LinAlgError:
        return np.full((len(state.T), 2), np.nan)
    variances = np.diagonal(found, axis1=1, axis2=2)
    return np.asarray(
        np.sqrt(np.column_stack([variances[:, 3:].sum(axis=1), variances[:, :3].sum(axis=1)]))
    )


# Refinement of a placement by bundle adjustment: all points of its relative poses at once,
# instead of pair by pair.


@dataclass(frozen=True)
class RefinementSettings:
    """How much is adjusted at once."""

    # 0.95 GiB, half a minute; with fewer than 400 a frame nothing is won
    most_observations: int = 1_000_000
    # on average: what views of more overlap have beyond that leaves no less error
    most_a_frame: int = 1200
    most_frames: int = 2500  # so many have 400 each; longer tracks are adjusted by windows
    window: int = 1000  # frames, which then keep all of their observations
    # frames that two windows share, several times the reach of an edge between neighbors
    overlap: int = 50


REFINEMENT_SETTINGS = RefinementSettings()


class _Part(NamedTuple):
    """A component of a track: its frames in the order of time, the edges between them, and what is
    known of them.
    """

    track: Track
    frames: list[int]
    edges: list[Edge]
    priors: list[Prior]
    marks: Marks | None = None


def refined(
    track: Track, placement: Placement, priors: Sequence[Prior] = (), marks: Marks | None = None
) -> Placement:
    """The placement's frames where all observations, the priors and what is known of markers agree
    best, with standard errors.

    track: it holds the relative poses that the placement was made from; loops that turned out false
    are no longer among them.
    Very long components are adjusted by windows, and these joined by a pose graph with all loops,
    without standard errors or marks. Raises DeviceError if GTSAM is missing.
    """
    rank, T = track.survey.index.rank, placement.T_world_camera
    std = np.full((len(T), 2), np.nan)
    for component in range(len(placement.sizes)):
        track.survey.progress("adjusting the track", component, len(placement.sizes))
        frames = sorted(placement.frames_of(component).tolist(), key=lambda frame: int(rank[frame]))
        part = _part(track, frames, track.edges, priors)._replace(
            marks=marks if component == 0 else None
        )
        if len(frames) > REFINEMENT_SETTINGS.most_frames:
            T = _by_windows(T, part)
        elif part.edges:
            adjusted = _adjusted(T, part)
            T, std = adjusted.T_world_camera, np.where(np.isfinite(adjusted.std), adjusted.std, std)
    return replace(
        placement,
        T_world_camera=T,
        position_std_m=std[:, 0],
        attitude_std_deg=np.degrees(std[:, 1]),
    )


def _part(
    track: Track, frames: Sequence[int], edges: Sequence[Edge], priors: Sequence[Prior]
) -> _Part:
    chosen = set(frames)
    inside = [edge for edge in edges if edge.i in chosen and edge.j in chosen]
    return _Part(track, list(frames), inside, [prior for prior in priors if prior.frame in chosen])


def _adjusted(T: Array, part: _Part) -> Adjusted:
    relations = [part.track.relation(edge) for edge in part.edges]
    most = min(
        REFINEMENT_SETTINGS.most_observations, REFINEMENT_SETTINGS.most_a_frame * len(part.frames)
    )
    found = observations(part.track.features, relations, most)
    found = replace(found, frame=part.track.survey.index.order[found.frame])
    known: list[Known] = []
    if part.marks:
        found, known = part.marks.joined(found, set(part.frames))
    return adjust(T, found, part.priors, known)


def _by_windows(T: Array, part: _Part) -> Array:
    """Poses (N, 4, 4) by a pose graph whose edges are the adjusted ones, each of the first window
    that holds both of its frames.
    """
    left, edges = part.edges, []
    for start in range(
        0, len(part.frames), REFINEMENT_SETTINGS.window - REFINEMENT_SETTINGS.overlap
    ):
        window = _part(
            part.track, part.frames[start : start + REFINEMENT_SETTINGS.window], part.edges, ()
        )
        if not window.edges:
            continue
        better, inside = _adjusted(T, window).T_world_camera, {id(edge) for edge in window.edges}
        edges += [
            replace(e, T_i_j=inverse(better[e.i]) @ better[e.j]) for e in left if id(e) in inside
        ]
        left = [edge for edge in left if id(edge) not in inside]
    return loops.solve(T, part.frames, edges + left, part.priors)[0]


# A track constrained by markers of known size, distance or place, and the outcome of each.


@dataclass(frozen=True, eq=False)
class MarkersFit:
    """How a map fits the markers that constrain it.

    scale: factor by which the rig's ranges are taken longer, with its standard error. before,
    after: what is known against the map without and with that, by name. refused: what was not used,
    since it cannot be right. control: residuals of surveyed places.
    origin: of these, where they were given as latitude and longitude.
    """

    markers: int
    scale: float
    scale_std: float
    before: dict[str, ScaleCheck]
    after: dict[str, ScaleCheck]
    refused: tuple[str, ...]
    control: ControlFit | None = None
    origin: GeoOrigin | None = None

    def __str__(self) -> str:
        if not self.before:
            return (
                f"markers: {self.markers} found in two frames or more, but their sizes and "
                "positions are unknown: no marker constrains the map"
            )
        text = (
            f"markers: {self.markers} found; ranges multiplied by {self.scale:.5f} ± "
            f"{self.scale_std:.5f}"
        )
        for name, check in self.before.items():
            text += f"; {name} {check.ratio:.5f} ± {check.std:.5f} of the given length"
            text += f", then {self.after[name].ratio:.5f}" if name in self.after else ", not used"
        if self.control:
            text += f"; surveyed positions within {1000 * self.control.rms_m:.1f} mm RMS"
        return text

    @property
    def warnings(self) -> tuple[str, ...]:
        """The disagreements, one line each."""
        warnings = [
            f"{name}: the map has {self.before[name].ratio:.3f} of the given length, a larger "
            "error than any rig has: not used; is the given length correct?"
            if self.before[name].wrong
            else f"{name}: they contradict the given poses: not used; are they in the "
            "coordinates of the poses?"
            for name in self.refused
        ]
        off, rig = abs(self.scale - 1), SETTINGS.rig_scale_std
        if off > SETTINGS.told_sigmas * rig:
            warnings.append(
                "according to the markers, the rig's ranges must be "
                f"{100 * (self.scale - 1):+.2f} % longer; calibrations rarely have a larger "
                f"error than {100 * rig:.1f} %: calibrate in water, or check the given lengths"
            )
        for name, check in self.after.items():
            std = float(np.hypot(check.std, SETTINGS.given_std))
            if abs(check.ratio - 1) > SETTINGS.told_sigmas * std:
                warnings.append(
                    f"{name}: with all markers the map still has {check.ratio:.5f} of what was "
                    f"given, {abs(check.ratio - 1) / std:.0f} standard errors off"
                )
        return (
            (*warnings, f"surveyed positions: {self.control.doubt}")
            if self.control and self.control.doubt
            else tuple(warnings)
        )


def first_fit(marks: Marks, T_world_camera: Array) -> MarkersFit:
    """The scale by all that can be right: each length by its standard error, and the rig's
    calibration by its own.
    """
    before = marks.checks(T_world_camera)
    refused = tuple(name for name, check in before.items() if check.wrong)
    right = [check for name, check in before.items() if name not in refused]
    values = np.array([1.0, *(1 / check.ratio for check in right)])
    stds = np.array(
        [
            SETTINGS.rig_scale_std,
            *(float(np.hypot(check.std, SETTINGS.given_std)) for check in right),
        ]
    )
    weights = stds**-2
    scale, std = float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)
    return MarkersFit(len(marks.placed(T_world_camera)), scale, std, before, {}, refused)


def final_fit(fit: MarkersFit, marks: Marks, placement: Placement) -> MarkersFit:
    """Compute what is left of each disagreement. marks: those that were used, scaled."""
    T = _main(placement)
    after = marks.checks(T)
    return replace(
        fit,
        after=after,
        control=_control(marks, T) if PLACES in after else None,
        origin=marks.origin,
    )


def fitted_to_fiducials(
    track: Track, placement: Placement, marks: Marks, priors: Sequence[Prior]
) -> tuple[Placement, MarkersFit]:
    """A placement, refined before, brought to what is known of markers in its main component, and
    the outcome of each.

    priors: further constraints of the placement; without them it is moved to the surveyed places as
    a whole first.
    Its lengths are those of a rig of the scale that was found. Raises DeviceError if GTSAM is
    missing.
    """
    fit = first_fit(marks, _main(placement))
    if not fit.before:
        return placement, fit
    used = marks.without(set(fit.refused)).scaled(fit.scale)
    start = _scaled(placement, fit.scale)
    if priors and _far_off(used, start, priors):
        used, fit = used.without({PLACES}), replace(fit, refused=(*fit.refused, PLACES))
    elif not priors:
        start = at_places(used, start)
    better = refined(track.scaled(fit.scale), start, priors, used)
    return better, final_fit(fit, used, better)


def _main(placement: Placement) -> Array:
    """(N, 4, 4) poses of the main component, NaN for others."""
    return np.where((placement.components == 0)[:, None, None], placement.T_world_camera, np.nan)


def _scaled(placement: Placement, scale: float) -> Placement:
    """About the middle of its main component."""
    T = placement.T_world_camera.copy()
    middle = T[placement.frames_of(0), :3, 3].mean(axis=0)
    T[:, :3, 3] = middle + scale * (T[:, :3, 3] - middle)
    return replace(placement, T_world_camera=T)


def _far_off(marks: Marks, placement: Placement, priors: Sequence[Prior]) -> bool:
    """Whether surveyed places lie elsewhere than navigation says: in other coordinates."""
    markers = [marker for marker in marks.placed(_main(placement)) if marker.number in marks.places]
    off_m = [
        float(np.linalg.norm(marker.place_m - marks.places[marker.number][0])) for marker in markers
    ]
    limit_m = SETTINGS.elsewhere_sigmas * float(np.linalg.norm(priors[0].position_std_m))
    return bool(off_m) and float(np.median(off_m)) > max(limit_m, SETTINGS.elsewhere_m)


def at_places(marks: Marks, placement: Placement) -> Placement:
    """A track brought by one rigid motion to the surveyed places of markers, if three that are not
    in line were found.

    Raises MappingError for places that turn it upside down.
    """
    T = _main(placement)
    fit = _control(marks, T)
    if fit and fit.is_upside_down(marks.placed(T), T):
        raise MappingError(UPSIDE_DOWN)
    return replace(placement, T_world_camera=fit.T @ placement.T_world_camera) if fit else placement


def _control(marks: Marks, T_world_camera: Array) -> ControlFit | None:
    try:
        points = {number: point for number, (point, _) in marks.places.items()}
        return control_fit(
            marks.placed(T_world_camera),
            points,
            {number: std_m for number, (_, std_m) in marks.places.items()},
        )
    except InputError:
        return None
