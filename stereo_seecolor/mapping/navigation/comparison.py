"""Comparison of navigation with the pictures: its residuals, its standard errors, and whether it
was read rightly.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.robust_statistics import ROBUST_DEVIATION, deviation_about_zero
from calibration.transforms import inverse, nearest_rotation, rigid_transform, rotation_vector
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.clocks import LEAST_POSED, of_other_clocks
from stereo_seecolor.mapping.navigation.depths import constant_depths, wrong_depths
from stereo_seecolor.mapping.navigation.deviations import deviations
from stereo_seecolor.mapping.navigation.fix_frames import fix_frames
from stereo_seecolor.mapping.navigation.interpretations import (
    CLOCK_EDGES,
    PoseReading,
    best_readings,
    interpretations,
    named,
)
from stereo_seecolor.mapping.navigation.motions import (
    LEAST_EDGES,
    Motions,
    by_frame,
    depth_difference_m,
)
from stereo_seecolor.mapping.navigation.mount import (
    North,
    Turn,
    constant_turn,
    lever_arm,
    mount_with,
    north_of,
)
from stereo_seecolor.mapping.navigation.seen_motion import WRONG, WRONG_BETWEEN, SeenMotion
from stereo_seecolor.mapping.navigation.wrong_parts import wrong_parts
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Trajectory

Array = NDArray[np.float64]

TURN_HELPS = 0.9
"""A constant turn must leave at most this fraction of the misfit."""
READ_RIGHTLY = 0.06
"""Poses that fit to so much, between neighbors and over spans together, are read rightly."""
CLOCK_FITS = 0.25
"""Of a clock that few frames do not contradict: on a drawn dive with noise of 2 cm the right one
leaves 0.10, others 0.6 and more.
"""
BETTER, BEATS_A_TURN = 0.6, 0.8
"""Of the misfit another reading must leave less; and of what a turn leaves, where that helps as
well: the turn's three angles were fitted.
"""
LESS_COST = 0.9
"""Of two that leave about the same median the one whose cost is so much less fits better."""
ALIKE_MISFIT = 1.15
"""Two explanations are alike where one leaves at most so much more."""
MAX_TURN_RAD = np.radians(20.0)
"""No compass or gyroscope is off by this much between neighbors."""
MOVES_M, STILL = 0.05, 0.01
"""Where the pictures move by so much across the vertical, positions that move by so small a
fraction are none: a degree of latitude is 111 km.
"""
ROUNDING = 1.0
"""Of the step that positions are rounded to: two rounded positions differ by up to 1.4 of it from
what they were, by half of it in the median, and no other reading is asked for.
"""
STUCK, STUCK_SCATTER = 0.25, 0.5
"""Positions that move by less than this fraction, and of that movement by more than this otherwise
than in the pictures, stay at one place.
"""
STILL_RAD = 1e-6
"""Attitudes that differ by less are one number."""
ALIKE = (
    "the given attitudes are all equal, and differ from those of the images: if you have only "
    "positions, give only these, as a table with a column map "
    "(nav.csv:time=...,lat=...,lon=...)"
)
FAR_OFF, ROUNDS = 8.0, 5
"""Standard deviations by which a position along an axis is far off: an outlier is no prior. They
are found in so many rounds.
"""
LEAST_OFF_M = 0.05
"""Standard deviation of positions, at least: less is no more than navigation's noise."""
MIN_FRAMES = 5
"""Fewer do not tell standard errors: the configuration's, or these, are taken."""
UNKNOWN_STD = (0.5, 0.05, np.radians(1.0))
"""Position east and north, depth (meters) and attitude (radians): a vehicle with USBL, a pressure
sensor and a compass.
"""
LEAST_STD = (0.005, 0.005, np.radians(0.05))
"""The same: better than this, voxels cannot tell."""
DEPTH_EDGES = 500
"""Pairs of frames whose depths are compared."""


@dataclass(frozen=True)
class Navigation:
    """The outcome of given poses. All residuals are medians over the relative poses that the
    pictures show.

    relative_poses: how many there are. position_residual_m, attitude_residual_deg: given against
    measured. depth_residual_m: between what overlapping frames saw, by the given poses;
    depth_noise_m: by the measured ones. position_std_m, depth_std_m, attitude_std_deg: how far a
    pose was trusted, NaN where it was not used or taken as it is. fits: False where the poses
    contradict the images. advice: how they would fit, or what is off in them, "" where
    nothing is.
    """

    relative_poses: int
    position_residual_m: float
    attitude_residual_deg: float
    depth_residual_m: float
    depth_noise_m: float
    position_std_m: float = float("nan")
    depth_std_m: float = float("nan")
    attitude_std_deg: float = float("nan")
    fits: bool = True
    advice: str = ""

    def __str__(self) -> str:
        if not self.relative_poses:
            return (
                "the given poses could not be compared with the images: no two frames with poses "
                "show the same scene"
            )
        text = (
            f"given poses relative to the images: {self.position_residual_m:.3f} m and "
            f"{self.attitude_residual_deg:.2f} degrees a relative pose, medians of "
            f"{self.relative_poses}; depths of overlapping frames differ by "
            f"{self.depth_residual_m:.3f} m, by the poses from the images "
            f"{self.depth_noise_m:.3f} m"
        )
        if np.isfinite(self.position_std_m):
            text += (
                f"; standard errors {self.position_std_m:.3f} m, in depth "
                f"{self.depth_std_m:.3f} m, "
            )
            text += f"{self.attitude_std_deg:.2f} degrees"
        return text


@dataclass(frozen=True, eq=False)
class ComparedNavigation:
    """Navigation, the placement to go on with (turned by a mount that was forgotten), and the
    residuals of each frame (N,).
    """

    navigation: Navigation
    placement: Placement
    position_residual_m: Array
    attitude_residual_deg: Array


CONTRADICTED = "the given poses contradict the images"


def examine(
    given: Placement,
    survey: Survey,
    edges: Sequence[Edge],
    trajectory: Trajectory,
    config: MappingConfig,
    own: Placement | None = None,
) -> ComparedNavigation:
    """Hold given poses against measured edges, and against the track by the pictures alone
    (``own``) where it is known; find the reading, or the mount's angle, that would fit where they
    do not.

    What is named was tested against all other readings; of those that fit as well all are named.
    """
    given, fixed = fix_frames(given, own, survey.index, trajectory)
    T = given.T_world_camera
    seen = SeenMotion.of(T, edges, own, survey.index.order, fixed)
    are_few = fixed is not None and len(seen.edges) < LEAST_EDGES
    if are_few:  # what is interpolated between them still shows a sign or a unit
        seen = SeenMotion.of(T, edges, own, survey.index.order)
    motions = Motions.of(T, seen.edges)
    navigation = _residuals(motions, seen.edges, survey)
    position_m, attitude_deg = (
        by_frame(values, seen.edges, len(T))
        for values in (motions.position_m, np.degrees(motions.attitude_rad))
    )
    verdict = ComparedNavigation(navigation, given, position_m, attitude_deg)
    plain = seen.misfit(T)
    clock = _other_clock(T, survey, edges, own, trajectory, config, plain)
    if not np.isfinite(plain) and not clock:
        return verdict
    step_m = trajectory.position_step_m
    if wrong := clock or _still(T, seen, step_m):
        return _unfit(verdict, wrong)
    correction = _correction(T, seen, plain, config)
    is_rounded = navigation.position_residual_m < ROUNDING * step_m
    readings = []
    if plain > READ_RIGHTLY and not is_rounded:
        others = interpretations(T, seen, survey.index, trajectory, config)
        readings = best_readings(seen, others)
    # a part is wrong where neither a correction nor a reading of the whole explains it
    parts = wrong_parts(correction.T, seen, survey.index)
    is_read_otherwise = bool(readings) and readings[0].misfit < BETTER * plain
    if parts and (not is_read_otherwise or wrong_parts(readings[0].T, seen, survey.index)):
        return _unfit(verdict, "; ".join(parts))
    straight = correction.T
    if wrong := _misread(T, seen, readings, correction, plain):
        return _unfit(verdict, f"{CONTRADICTED}{wrong}")
    if contradiction := seen.contradiction(straight, step_m, WRONG_BETWEEN if are_few else WRONG):
        return _unfit(verdict, f"{CONTRADICTED}: {contradiction}: do they belong to this dive?")
    advice_lines = list(correction.advice)
    if advice_lines and readings and _are_alike(readings[0], correction, plain, seen):
        advice_lines[-1] += f"; or, as likely, {named(readings)}"
    if not are_few:
        advice_lines += _deviations(straight, seen, survey.index, step_m if is_rounded else 0.0)
    return replace(
        verdict,
        navigation=replace(navigation, advice="; ".join(advice_lines)),
        placement=replace(given, T_world_camera=straight),
    )


def _other_clock(
    T: Array,
    survey: Survey,
    edges: Sequence[Edge],
    own: Placement | None,
    trajectory: Trajectory,
    config: MappingConfig,
    plain: float,
) -> str:
    """What to say of a clock by which far more frames have a pose, where few have one as given and
    these do not fit; "" where there is none.
    """
    posed, index = np.isfinite(T).all(axis=(1, 2)), survey.index
    has_clock = not any(trajectory.names) and np.isfinite(trajectory.timestamps_s).all()
    if plain < READ_RIGHTLY or not (own and has_clock) or posed.mean() >= LEAST_POSED:
        return ""

    def misfit(other: Array) -> float:
        return SeenMotion.of(other, edges, own, index.order).thinned(CLOCK_EDGES).misfit(other)

    most = min(CLOCK_FITS, BETTER * plain)
    for name, other in of_other_clocks(index, trajectory, config, misfit):
        more = np.isfinite(other).all(axis=(1, 2))
        if misfit(other) < most and more.sum() > 2 * posed.sum():
            return (
                f"only {posed.sum()} of {len(T)} frames have a pose by the times as given, which "
                f"do not fit the images; {more.sum()} have one with {name}, and these fit: the "
                "clock of the poses is another one (local time, GPS time)"
            )
    return ""


def _misread(
    T: Array,
    seen: SeenMotion,
    readings: Sequence[PoseReading],
    correction: "_Correction",
    plain: float,
) -> str:
    """What to say of poses that are another reading's, or have wrong heights, or are no reading's;
    "" of others. T: as read.
    """
    best, left = readings[0].misfit if readings else np.inf, correction.misfit
    is_better = best < (BEATS_A_TURN if correction.advice else BETTER) * left
    if correction.advice and best < ALIKE_MISFIT * left:  # whose numbers were fitted
        is_better |= seen.cost(readings[0].T) < LESS_COST * seen.cost(correction.T)
    if is_better and best < BETTER * plain:
        return f"; they would fit with {named(readings)}"
    attitude_rad = float(np.median(Motions.of(correction.T, seen.edges).attitude_rad))
    if attitude_rad > MAX_TURN_RAD:
        off_deg = np.degrees(attitude_rad)
        return (
            f", under every interpretation (by {off_deg:.0f} degrees between neighbors): do they "
            "belong to this dive?"
        )
    depths = wrong_depths(T, seen) or wrong_depths(correction.T, seen)
    return f": {depths}" if depths else ""


def _are_alike(
    reading: PoseReading, correction: "_Correction", plain: float, seen: SeenMotion
) -> bool:
    """Tell whether a reading explains as much as a correction, by the median and by all."""
    return (
        reading.misfit < BETTER * plain
        and reading.misfit <= ALIKE_MISFIT * correction.misfit
        and LESS_COST * seen.cost(reading.T) <= seen.cost(correction.T)
    )


def _deviations(T: Array, seen: SeenMotion, index: FrameIndex, step_m: float) -> list[str]:
    """Lines for what is off in poses that are read rightly. step_m: that positions are rounded to,
    where this is more than they are off.
    """
    level = constant_depths(T, seen)
    lines = [level] if level else []
    if not step_m:
        return lines + deviations(T, seen.edges, index)
    if step_m > LEAST_STD[0]:
        lines.append(
            f"the given positions are rounded to {step_m:.2g} m, and their weight is limited by "
            "that: write more digits"
        )
    return lines


@dataclass(frozen=True, eq=False)
class _Correction:
    """Given poses with the errors taken out that the pictures show. T: (N, 4, 4). advice: a line
    for each error; none where nothing was corrected.
    """

    T: Array
    misfit: float
    advice: tuple[str, ...] = ()


def _correction(T: Array, seen: SeenMotion, plain: float, config: MappingConfig) -> _Correction:
    """The camera turned on its vehicle, headings turned against positions, a lever arm: the fewest
    that explain the most. Turns of both kinds are named where both fit.
    """
    edges = [*seen.edges, *seen.spans]
    turn, north = constant_turn(Motions.of(T, edges)), north_of(T, seen.spans or seen.edges)
    turned = T.copy()
    turned[:, :3, :3] = T[:, :3, :3] @ turn.R
    is_compass = abs(north.angle_rad) < MAX_TURN_RAD
    both = [
        (believed, _Correction(corrected, seen.misfit(corrected), (advice,)))
        for believed, corrected, advice in (
            (turn.believed, turned, _turn_advice(turn, config)),
            (north.believed and is_compass, north.undone(T), _north_advice(north)),
        )
    ]
    both = [one for one in both if one[1].misfit < TURN_HELPS * plain]
    found = min((one for is_sure, one in both if is_sure), key=lambda one: one.misfit, default=None)
    if found is not None:  # the other may be as likely where it alone is not sure
        most = ALIKE_MISFIT * found.misfit
        rivals = [one.advice[0] for _, one in both if one is not found and one.misfit < most]
        found = replace(found, advice=("; or, as likely, ".join([*found.advice, *rivals]),))
    chains = [
        _with_lever_arm(one, seen) for one in (_Correction(T, plain), found) if one is not None
    ]
    return min(chains, key=lambda one: one.misfit * ALIKE_MISFIT ** len(one.advice))


def _with_lever_arm(before: _Correction, seen: SeenMotion) -> _Correction:
    """The poses of the camera where they are of another point of the vehicle."""
    arm = lever_arm(Motions.of(before.T, seen.spans or seen.edges))
    if arm is None:
        return before
    T = before.T @ rigid_transform(np.eye(3), -arm[0])
    after = _Correction(T, seen.misfit(T), (*before.advice, _lever_advice(*arm)))
    return after if after.misfit < before.misfit else before


def _unfit(verdict: ComparedNavigation, advice: str) -> ComparedNavigation:
    return replace(verdict, navigation=replace(verdict.navigation, fits=False, advice=advice))


def priors(own: Placement, given: Placement, config: MappingConfig) -> list[Prior]:
    """The given poses as priors, with the configuration's standard errors, or those that the dive
    itself shows; without positions that are far off by these.

    own: placed by the pictures alone. Each of its components is brought to the given poses by one
    rigid motion; what is left is their error, the own track's drift included.
    """
    offsets, turns = [], []
    used = given.components >= 0
    for frames, offsets_m, turns_rad, kept in _left_by_components(own, given):
        used[frames[~kept]] = False
        scale = np.sqrt(kept.sum() / (kept.sum() - 2))  # six of the numbers are fitted
        offsets.append(scale * offsets_m[kept])
        turns.append(scale * turns_rad[kept])
    estimated = np.array(UNKNOWN_STD)
    if offsets:
        off, turn = np.concatenate(offsets), np.concatenate(turns)
        estimated = np.array(
            [
                deviation_about_zero(off[:, :2]),
                deviation_about_zero(off[:, 2:]),
                deviation_about_zero(turn),
            ]
        )
    position, depth, attitude = np.maximum(estimated, LEAST_STD)
    position = config.prior_position_std_m or position
    return [
        Prior(
            int(i), given.T_world_camera[i], np.array([position, position, depth]), float(attitude)
        )
        for i in np.flatnonzero(used)
    ]


def turned_frames(own: Placement, given: Placement) -> NDArray[np.int64]:
    """Frames whose given attitude is off by more than a compass is, once the track of the images is
    brought to the given poses of most.
    """
    turned = [np.zeros(0, np.int64)]
    for frames, _, turns_rad, _ in _left_by_components(own, given):
        turned.append(frames[np.linalg.norm(turns_rad, axis=1) > MAX_TURN_RAD])
    return np.concatenate(turned)


def _left_by_components(
    own: Placement, given: Placement
) -> Iterator[tuple[NDArray[np.int64], Array, Array, NDArray[np.bool_]]]:
    """For each component the frames (n,) with a given pose, what is left of their positions (n, 3)
    and attitudes (n, 3), meters and radians, once it is brought to them; and which of them it was
    brought to.
    """
    for component in range(len(own.sizes)):
        frames = own.frames_of(component)
        frames = frames[given.components[frames] >= 0]
        if len(frames) < MIN_FRAMES:
            continue
        moved, kept = moved_to_given(own.T_world_camera, given.T_world_camera, frames)
        there, here = given.T_world_camera[frames], moved[frames]
        turns = np.swapaxes(here[:, :3, :3], 1, 2) @ there[:, :3, :3]
        yield frames, there[:, :3, 3] - here[:, :3, 3], rotation_vector(turns), kept


def moved_to_given(
    T: Array, given: Array, frames: NDArray[np.int64]
) -> tuple[Array, NDArray[np.bool_]]:
    """T (N, 4, 4) as a whole brought to the given poses of some frames: mean turn, then mean
    position; and which of the frames have positions that are not far off by that.
    """
    kept = np.ones(len(frames), np.bool_)
    for _ in range(ROUNDS):
        chosen = frames[kept]
        R = nearest_rotation((given[chosen] @ inverse(T[chosen]))[:, :3, :3].mean(axis=0))
        shifts = given[frames, :3, 3] - T[frames, :3, 3] @ R.T
        off = shifts - np.median(shifts[kept], axis=0)
        std_m = np.maximum(ROBUST_DEVIATION * np.median(np.abs(off[kept]), axis=0), LEAST_OFF_M)
        now = np.asarray((np.abs(off) < FAR_OFF * std_m).all(axis=1))
        if now.sum() < MIN_FRAMES or (now == kept).all():
            break
        kept = now
    return np.asarray(rigid_transform(R, shifts[kept].mean(axis=0)) @ T), kept


def _residuals(motions: Motions, edges: Sequence[Edge], survey: Survey) -> Navigation:
    points = survey.index.points_m
    step = max(1, len(edges) // DEPTH_EDGES)
    depths = np.array(
        [
            [depth_difference_m(points[e.i], points[e.j], T) for T in (given, e.T_i_j)]
            for e, given in zip(edges[::step], motions.given[::step], strict=True)
        ]
    ).reshape(-1, 2)
    given_m, measured_m = (_median(column[np.isfinite(column)]) for column in depths.T)
    return Navigation(
        len(edges),
        _median(motions.position_m),
        float(np.degrees(_median(motions.attitude_rad))),
        given_m,
        measured_m,
    )


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _still(T_world_camera: Array, seen: SeenMotion, position_step_m: float) -> str:
    """What to say of poses that stay while the pictures move: numbers that are not positions, or no
    attitudes; "" for others, and for positions rounded to more than the pictures move.
    """
    motions = Motions.of(T_world_camera, seen.spans or seen.edges)
    given, measured = (shift[:, :2] for shift in motions.shifts_in_world(T_world_camera))
    given_m, measured_m = (_median(np.linalg.norm(one, axis=1)) for one in (given, measured))
    if measured_m > max(MOVES_M, position_step_m) and given_m < STUCK * measured_m:
        scale = (given * measured).sum() / max((measured**2).sum(), 1e-12)
        unexplained_m = _median(np.linalg.norm(given - scale * measured, axis=1))
        if unexplained_m > STUCK_SCATTER * given_m or not given_m:
            return (
                f"the given positions hardly move (by {given_m:.2f} m where the images move by "
                f"{measured_m:.2f} m, medians), in other directions: they stay at one place, as "
                "of a sensor that repeats its last fix"
            )
        if given_m < STILL * measured_m:
            return (
                "the given positions hardly move while the images do: are they latitudes and "
                "longitudes, instead of meters?"
            )
    turns_rad = np.linalg.norm(rotation_vector(motions.measured[:, :3, :3]), axis=1)
    return ALIKE if turns_rad.max() > MAX_TURN_RAD and attitudes_equal(T_world_camera) else ""


def attitudes_equal(T_world_camera: Array) -> bool:
    """Tell whether all known attitudes are the same to the digit, as no vehicle holds them: they
    were not measured.
    """
    R = T_world_camera[np.isfinite(T_world_camera).all(axis=(1, 2)), :3, :3]
    return len(R) > 1 and float(np.abs(R - R[0]).max()) < STILL_RAD


def _lever_advice(arm_m: Array, std_m: Array) -> str:
    parts = zip(arm_m, std_m, ("right", "down", "forward"), strict=True)
    where = ", ".join(f"{along:+.2f} ± {std:.2f} {axis}" for along, std, axis in parts)
    return (
        f"the given positions are of a point {np.linalg.norm(arm_m):.2f} m from the camera "
        f"({where}), which was taken into account: if they are positions of a vehicle, set "
        "mapping.mount.xyz_m"
    )


def _north_advice(north: North) -> str:
    return (
        f"the given headings are turned by {np.degrees(north.angle_rad):+.1f} +- "
        f"{np.degrees(north.std_rad):.1f} degrees against the directions in which the positions "
        "move (magnetic declination, convergence of a grid, a compass or camera mounted so): the "
        "map is oriented by the positions"
    )


def _turn_advice(turn: Turn, config: MappingConfig) -> str:
    return (
        f"the camera is rotated by {turn.angle_deg:.1f} degrees relative to the given poses, "
        "which was taken into account: if they are poses of a vehicle, set "
        f"{mount_with(turn, config.mount)}"
    )
