"""Comparison of navigation with the pictures: its residuals, its standard errors, and whether it
was read rightly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.geometry import inverse, nearest_rotation, pose, rotation_vector
from stereo_seecolor.mapping.navigation.deviations import deviations
from stereo_seecolor.mapping.navigation.interpretations import (
    INVERTED,
    better_interpretation,
    interpretations,
    is_rather_inverted,
)
from stereo_seecolor.mapping.navigation.motions import Motions, by_frame, depth_difference_m, misfit
from stereo_seecolor.mapping.navigation.mount import Turn, constant_turn, lever_arm, mount_with
from stereo_seecolor.mapping.navigation.wrong_parts import wrong_parts
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Trajectory
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]

TURN_HELPS = 0.9
"""A constant turn must leave at most this fraction of the misfit."""
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
STILL_RAD = 1e-6
"""Attitudes that differ by less are one number."""
ALIKE = (
    "the given attitudes are all equal, and differ from those of the images: if you have only "
    "positions, give only these, as a table with a column map "
    "(nav.csv:time=...,lat=...,lon=...)"
)
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
) -> ComparedNavigation:
    """Hold given poses against measured edges; find the reading, or the mount's angle, that would
    fit where they do not.
    """
    T = given.T_world_camera
    posed = [e for e in edges if np.isfinite(T[[e.i, e.j]]).all()]
    motions = Motions.of(T, posed)
    navigation = _residuals(motions, posed, survey)
    count = len(T)
    position_m, attitude_deg = (
        by_frame(motions.position_m, posed, count),
        by_frame(np.degrees(motions.attitude_rad), posed, count),
    )
    verdict = ComparedNavigation(navigation, given, position_m, attitude_deg)
    plain = misfit(T, posed)
    if not np.isfinite(plain):
        return verdict
    step_m = trajectory.position_step_m
    if still := _still(T, posed, motions, step_m):
        return _unfit(verdict, still)
    if parts := wrong_parts(T, posed, survey.index):
        return _unfit(verdict, "; ".join(parts))
    turn = constant_turn(motions)
    turned = T.copy()
    turned[:, :3, :3] = T[:, :3, :3] @ turn.R
    left = misfit(turned, posed)
    helps = turn.believed and left < TURN_HELPS * plain
    rounded = navigation.position_residual_m < ROUNDING * step_m
    best = left if helps else plain
    others = interpretations(T, posed, survey.index, trajectory, config)
    reading = None if rounded else better_interpretation(best, posed, others)
    if not reading and helps and is_rather_inverted(turned, turn, T, posed):
        reading = INVERTED
    if reading:
        return _unfit(verdict, f"{CONTRADICTED}; they would fit with {reading}")
    if float(np.median(Motions.of(turned if helps else T, posed).attitude_rad)) > MAX_TURN_RAD:
        return _unfit(
            verdict, (f"{CONTRADICTED}, under every interpretation: do they belong to this dive?")
        )
    advice_lines = [_turn_advice(turn, config)] if helps else []
    straight = turned if helps else T
    arm_m = lever_arm(Motions.of(straight, posed))
    if arm_m is not None:
        straight = straight @ pose(np.eye(3), -arm_m)
        advice_lines.append(_lever_advice(arm_m))
    advice_lines += deviations(straight, posed, survey.index) if not rounded else []
    if rounded and step_m > LEAST_STD[0]:
        advice_lines.append(
            f"the given positions are rounded to {step_m:.2g} m, and their weight is limited by "
            "that: write more digits"
        )
    used = replace(given, T_world_camera=straight)
    return replace(
        verdict, navigation=replace(navigation, advice="; ".join(advice_lines)), placement=used
    )


def _unfit(verdict: ComparedNavigation, advice: str) -> ComparedNavigation:
    return replace(verdict, navigation=replace(verdict.navigation, fits=False, advice=advice))


def priors(own: Placement, given: Placement, config: MappingConfig) -> list[Prior]:
    """The given poses as priors, with the configuration's standard errors, or those that the dive
    itself shows.

    own: placed by the pictures alone. Each of its components is brought to the given poses by one
    rigid motion; what is left is their error, the own track's drift included.
    """
    offsets, turns = [], []
    for component in range(len(own.sizes)):
        frames = [i for i in own.frames_of(component) if given.components[i] >= 0]
        if len(frames) < MIN_FRAMES:
            continue
        moved = move_to_given(own.T_world_camera, given.T_world_camera, frames)[frames]
        scale = np.sqrt(len(frames) / (len(frames) - 2))  # six of the numbers are fitted
        offsets.append(scale * (given.T_world_camera[frames, :3, 3] - moved[:, :3, 3]))
        turns.append(
            scale
            * rotation_vector(
                np.swapaxes(moved[:, :3, :3], 1, 2) @ given.T_world_camera[frames, :3, :3]
            )
        )
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
    placed = np.flatnonzero(given.components >= 0)
    return [
        Prior(
            int(i), given.T_world_camera[i], np.array([position, position, depth]), float(attitude)
        )
        for i in placed
    ]


def move_to_given(T: Array, given: Array, frames: Sequence[int]) -> Array:
    """T (N, 4, 4) as a whole brought to the given poses of some frames: mean turn, then mean
    position.
    """
    R = nearest_rotation((given[frames] @ inverse(T[frames]))[:, :3, :3].mean(axis=0))
    shift = given[frames, :3, 3].mean(axis=0) - R @ T[frames, :3, 3].mean(axis=0)
    return np.asarray(pose(R, shift) @ T)


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


def _still(
    T_world_camera: Array, edges: Sequence[Edge], motions: Motions, position_step_m: float
) -> str:
    """What to say of poses that stay while the pictures move: numbers that are not positions, or no
    attitudes; "" for others, and for positions rounded to more than the pictures move.
    """
    start = T_world_camera[[e.i for e in edges], :3, :3]
    given_m, measured_m = (
        _median(np.linalg.norm(np.einsum("nij,nj->ni", start, shift[:, :3, 3])[:, :2], axis=1))
        for shift in (motions.given, motions.measured)
    )
    if measured_m > max(MOVES_M, position_step_m) and given_m < STILL * measured_m:
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


def _lever_advice(arm_m: Array) -> str:
    right, down, forward = arm_m
    return (
        f"the given positions are of a point {np.linalg.norm(arm_m):.2f} m from the camera "
        f"({right:+.2f} right, {down:+.2f} down, {forward:+.2f} forward), which was taken "
        "into account: if they are positions of a vehicle, set mapping.mount.xyz_m"
    )


def _turn_advice(turn: Turn, config: MappingConfig) -> str:
    return (
        f"the camera is rotated by {turn.angle_deg:.1f} degrees relative to the given poses, "
        "which was taken into account: if they are poses of a vehicle, set "
        f"{mount_with(turn, config.mount)}"
    )
