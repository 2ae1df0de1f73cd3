"""Comparison of navigation with the images: its residuals, and whether it was read rightly."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.clocks import LEAST_POSED, of_other_clocks
from stereo_seecolor.mapping.navigation.corrections import (
    ALIKE_MISFIT,
    MAX_TURN_RAD,
    CorrectedPoses,
    corrected,
)
from stereo_seecolor.mapping.navigation.depths import constant_depths, wrong_depths
from stereo_seecolor.mapping.navigation.deviations import deviations, jumps, without_jumps
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
from stereo_seecolor.mapping.navigation.priors import LEAST_STD
from stereo_seecolor.mapping.navigation.seen_motion import WRONG, WRONG_BETWEEN, SeenMotion
from stereo_seecolor.mapping.navigation.unmoved import still
from stereo_seecolor.mapping.navigation.wrong_parts import wrong_parts
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array, Trajectory

READ_RIGHTLY = 0.06
"""Poses that fit to so much, between neighbors and over spans together, are read rightly."""
CLOCK_FITS = 0.25
"""Of a clock that few frames do not contradict: on a synthetic dive with noise of 2 cm the right
one leaves 0.10, others 0.6 and more.
"""
BETTER, BEATS_A_TURN = 0.6, 0.8
"""Of the misfit another reading must leave less; and of what a turn leaves, where that helps as
well: the turn's three angles were fitted.
"""
LESS_COST = 0.9
"""Of two that leave about the same median the one whose cost is so much less fits better."""
ROUNDING = 1.0
"""Of the step that positions are rounded to: two rounded positions differ by up to 1.4 of it from
what they were, by half of it in the median, and no other reading is asked for.
"""
MOST_JUMPS = 10
"""Positions that jump more often are no longer those of this dive."""
DEPTH_EDGES = 500
"""Pairs of frames whose depths are compared."""


@dataclass(frozen=True)
class Navigation:
    """The outcome of given poses. Residuals are medians over the images' relative poses.

    relative_poses: how many there are. position_residual_m, attitude_residual_deg: given against
    measured. depth_residual_m: between what overlapping frames saw, by the given poses;
    depth_noise_m: by the measured ones. position_std_m, depth_std_m, attitude_std_deg: how far a
    pose was trusted, NaN where it was not used or taken as it is. fits: False where the poses
    contradict the images. advice: how they would fit, or what is off in them, "" where
    nothing is. blurred: whether poses that were taken as they are put what overlapping frames saw
    more than a voxel apart.
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
    blurred: bool = False

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
        if self.blurred:
            text += (
                "; the poses were used unchanged and put one place more than a voxel apart: "
                "rugosity and surfaces of the map are too large (mapping.poses=prior fits the "
                "poses to the images)"
            )
        return text

    def unchanged(self, voxel_m: float) -> "Navigation":
        """The outcome of poses that are taken as they are."""
        apart_m2 = self.depth_residual_m**2 - self.depth_noise_m**2
        return replace(self, blurred=apart_m2 > voxel_m**2)


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
    """Hold given poses against measured edges, and against the track by the images alone
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
    clock = _other_clock(T, survey, edges, own, trajectory, plain)
    if not np.isfinite(plain) and not clock:
        return verdict
    step_m = trajectory.position_step_m
    if wrong := clock or still(T, seen, step_m):
        return _unfit(verdict, wrong)
    correction = corrected(T, seen, plain, survey.index, config)
    is_rounded = navigation.position_residual_m < ROUNDING * step_m
    readings = []
    if plain > READ_RIGHTLY and not is_rounded:
        others = interpretations(T, seen, survey.index, trajectory)
        readings = best_readings(seen, others)
        # one jump that leaves less is no misreading
        with_one_jump = seen.misfit(without_jumps(T, seen.edges, survey.index, most=2))
        readings = [one for one in readings if one.misfit < with_one_jump]
    # a part is wrong where neither a correction nor a reading of the whole explains it
    parts = wrong_parts(correction.T, seen, survey.index)
    is_read_otherwise = bool(readings) and readings[0].misfit < BETTER * plain
    if parts and (not is_read_otherwise or wrong_parts(readings[0].T, seen, survey.index)):
        return _unfit(verdict, "; ".join(parts))
    straight = correction.T
    if wrong := _misread(T, seen, readings, correction, plain):
        return _unfit(verdict, f"{CONTRADICTED}{wrong}")
    if wrong := _contradiction(
        straight, seen, survey.index, step_m, WRONG_BETWEEN if are_few else WRONG
    ):
        return _unfit(verdict, f"{CONTRADICTED}: {wrong}")
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
    for name, other in of_other_clocks(index, trajectory, misfit):
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
    correction: CorrectedPoses,
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
    depths = wrong_depths(T, seen, left) or wrong_depths(correction.T, seen, left)
    return f": {depths}" if depths else ""


def _contradiction(
    T: Array, seen: SeenMotion, index: FrameIndex, step_m: float, wrong: float
) -> str:
    """What to say of poses that fit from frame to frame, and not over the dive, with jumps where
    these are all that does not fit; "" of others.
    """
    contradiction = seen.contradiction(T, step_m, wrong)
    if not contradiction:
        return ""
    steady = without_jumps(T, seen.edges, index, most=MOST_JUMPS)
    if seen.contradiction(steady, step_m, wrong):
        return f"{contradiction}: do they belong to this dive?"
    (jump,) = jumps(T, Motions.of(T, seen.edges), index)
    return f"{jump}; before and after they fit, and nothing shows which are right"


def _are_alike(
    reading: PoseReading, correction: CorrectedPoses, plain: float, seen: SeenMotion
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


def _unfit(verdict: ComparedNavigation, advice: str) -> ComparedNavigation:
    return replace(verdict, navigation=replace(verdict.navigation, fits=False, advice=advice))


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
