"""Errors of the calibration that rows do not show, seen in the motion between neighboring pairs.

An offset that all disparities have (images shifted along the baseline, a principal point, a yaw of
a camera) and a focal length that is wrong in both cameras leave the rows as they are. But the
bottom is rigid: between two moments, points move in the image by their true inverse depth, and by
the turn of the camera. Disparities with an offset, or a wrong focal length, fit no rigid motion.
The length of the baseline is not seen: all of it would be larger, alike.

The cause is tested against its rivals: disparities that are wrong by an amount that grows over rows
(shutters that read them in opposite directions while the cameras move) or columns, and by amounts
that differ from pair to pair, look like an offset where an offset alone is fitted.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError, counted
from calibration.geometry import RectifiedPair
from calibration.rectification import Rectification
from calibration.resampling import jackknife
from calibration.rig_errors import RangeError
from calibration.verification.matches import (
    MATCH_LIMITS,
    QUICK,
    Images,
    Matches,
    MatchLimits,
    describe_left,
    describe_right,
    match_described,
    same_points,
)
from calibration.verification.rigid_motion import (
    COLUMNS,
    FOCAL,
    LATER,
    LATER_ROWS,
    OFFSET,
    ROWS,
    Fitted,
    SeenTwice,
    corrected_points,
    fit_motions,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotionLimits:
    """Limits of what is measured and of what is reported.

    least_points, least_couples: fewer tell nothing, or give no standard error. least_move: median
    movement in the image, of its width: less holds too little parallax. most_row_px: rows of a rig
    that has drifted are off by a pixel or two.
    least_disparity_px: less is infinity, or one camera's picture on both sides. near_px: points
    that two matches have in common lie within it.
    lens_rad: offset, as an angle, that errors of a usual lens model look like; focal: the same of
    the focal length, relative. A real rig of 1360x1024 px, whose ranges fit the track of its
    survey, has 0.0014 and 0.02.
    known_focal: the focal length is fitted where its standard error is below that. range_error,
    deviations: ranges are wrong where they are by more than both. right: no more couples are looked
    at where error and standard error together are below that. seen: an error of ranges that would
    be found, else it is reported as unseen.
    uneven: an error of ranges at the edges of the image, or from pair to pair, relative, that is
    named; pair_deviations: of single couples, by how many standard errors it must stand out.
    misfit: residuals so many times those of couples that each have values of their own are not
    understood (1.0 to 1.1 on the sample dive and a real survey).
    explained: part of an uneven error that a rival must make to be its cause.
    """

    least_points: int = 20
    least_couples: int = 3
    least_move: float = 0.04
    most_row_px: float = 5.0
    least_disparity_px: float = 1.0
    near_px: float = 1.0
    lens_rad: float = 0.0015
    focal: float = 0.02
    known_focal: float = 0.015
    range_error: float = 0.02
    right: float = 0.05
    deviations: float = 2.0
    seen: float = 0.15
    uneven: float = 0.02
    pair_deviations: float = 4.0
    misfit: float = 1.3
    explained: float = 0.5


LIMITS = MotionLimits()
FEATURES = replace(QUICK, max_features=1000)


@dataclass(frozen=True)
class Motion:
    """What the motion between couples of pairs tells of the calibration; couples: 0 where too few
    show the same.

    offset_px: to be added to all disparities; focal: the true focal length over the calibrated one,
    less 1, NaN where it is not seen. range_error: of ranges at the median disparity by both,
    relative; at_m: the depth that this disparity gives as calibrated, meters. std: their standard
    errors, with those of a lens model.
    pixel_error: what a pixel of offset changes a range by, relative, for each meter of range.
    rows_px, rows_std_px: to be added to disparities at the lower edge of the rectified image, and
    taken from them at the upper one; columns_px, columns_std_px: the same at the right and left;
    0 where they explain nothing.
    between_px: by how much disparities differ between two moments of a couple (median), where that
    is what couples show; between_rows: that is at the upper and lower edge alone; rolled_px: what a
    roll of a camera makes there (median), as the rows want it.
    rest_px, own_px: what the values leave, and what couples leave that each have values of their
    own. disparity_px: median.
    """

    couples: int = 0
    points: int = 0
    offset_px: float = 0.0
    offset_std_px: float = np.inf
    focal: float = np.nan
    focal_std: float = np.inf
    range_error: float = 0.0
    range_std: float = np.inf
    at_m: float = np.nan
    pixel_error: float = np.nan
    rows_px: float = 0.0
    rows_std_px: float = np.inf
    columns_px: float = 0.0
    columns_std_px: float = np.inf
    rolled_px: float = 0.0
    between_px: float = 0.0
    between_rows: bool = False
    rest_px: float = 0.0
    own_px: float = np.inf
    disparity_px: float = np.nan

    @property
    def is_known(self) -> bool:
        """True if an error of ranges that matters would have been seen."""
        return LIMITS.deviations * self.range_std < LIMITS.seen

    @property
    def measured(self) -> RangeError | None:
        """The error of ranges; None where motion does not show it, or one number does not describe
        it.
        """
        if self.is_misfit or self._is_uneven or not self.is_known:
            return None
        return RangeError(self.range_error, self.range_std, self.at_m)

    @property
    def is_right(self) -> bool:
        """True if ranges are right to 5 %, their standard error included."""
        return abs(self.range_error) + self.range_std < LIMITS.right and not self._is_uneven

    @property
    def _is_uneven(self) -> bool:
        """True if disparities are wrong by amounts that differ over the image or from pair to
        pair.
        """
        return bool(self.rows_px or self.columns_px or self.between_px)

    @property
    def is_misfit(self) -> bool:
        """True if points fit no rigid motion, and nothing that was tested explains it."""
        return self.rest_px > LIMITS.misfit * self.own_px

    @property
    def is_found(self) -> bool:
        """True if ranges are wrong by more than the points and a usual lens model leave open."""
        return self._is_uneven or self._is_off

    @property
    def _is_off(self) -> bool:
        return abs(self.range_error) > max(LIMITS.range_error, LIMITS.deviations * self.range_std)

    @property
    def line(self) -> str:
        """What was measured, or what is not seen, for a report."""
        if self.is_misfit:
            return (
                f"motion between {counted(self.couples, 'couple')} of neighboring pairs fits no "
                f"rigid bottom: {self.rest_px:.2f} px are left, {self.own_px:.2f} px where each "
                "couple has an error of its own; an offset, a focal length and errors over rows "
                "and columns do not explain it, and the error of ranges is unknown: moving "
                "things, or pairs that differ: compare a known length"
            )
        if self.between_px:
            return self.between
        if not (self.is_known or self.is_found):
            return (
                "not seen: images shifted along the baseline (a pixel changes ranges by "
                f"{self.pixel_error:.1%} for each meter of "
                "range), a focal length wrong in both cameras, a wrong baseline: rows do not "
                "show them, and too few neighboring pairs show "
                "the same bottom: compare a known length by stereo-seecolor measure or markers"
            )
        over = [
            f"disparities change by {amount_px:+.1f} +- {std_px:.1f} px at the {edge} edge of the "
            f"rectified image, and by {-amount_px:+.1f} px at the other one"
            for amount_px, std_px, edge in (
                (self.rows_px, self.rows_std_px, "lower"),
                (self.columns_px, self.columns_std_px, "right"),
            )
            if amount_px
        ]
        figures = "; ".join([*over, *([] if over and not self._is_off else [self.figures])])
        return (
            f"motion between {counted(self.couples, 'couple')} of neighboring pairs: {figures}"
            f"{self._unseen}"
        )

    @property
    def between(self) -> str:
        """What differs from pair to pair, the cause that its rival leaves, and what to do; ""
        where nothing does.
        """
        if not self.between_px:
            return ""
        error = self.between_px / self.disparity_px
        if not self.between_rows:
            return (
                f"disparities differ from pair to pair by {self.between_px:.1f} px (median) and "
                f"fit no one rig: ranges are wrong by about {error:.0%}, by another amount in each "
                "pair: images shifted along the baseline from frame to frame (stabilization of a "
                "side), or sides not of one moment: switch stabilization off, trigger both cameras "
                "together"
            )
        rolls = self.rolled_px > LIMITS.explained * self.between_px
        cause = (
            "images that are turned from frame to frame explain it, which rows show, too "
            f"({self.rolled_px:.1f} px): stabilization, or a loose camera"
            if rolls
            else f"rows show no such roll of a camera ({self.rolled_px:.1f} px): as rolling "
            "shutters that read rows in opposite directions, or not at one moment, while the "
            "cameras move sideways: mount and trigger both cameras alike, or move slowly"
        )
        return (
            "disparities are wrong by amounts that grow over the rows and differ from pair to "
            f"pair, by {self.between_px:.1f} px (median) at the upper and lower edge: ranges there "
            f"are wrong by about {error:.0%}; {cause}"
        )

    @property
    def figures(self) -> str:
        """Offset, focal length, and what they do to ranges."""
        offset = f"disparities change by {self.offset_px:+.1f} +- {self.offset_std_px:.1f} px"
        focal = (
            ""
            if np.isnan(self.focal)
            else f", the focal length by {self.focal:+.0%} +- {self.focal_std:.0%}"
        )
        return (
            f"at {self.at_m:.1f} m ranges may be wrong by {self.range_error:+.0%} +- "
            f"{self.range_std:.0%} ({offset}{focal})"
        )

    @property
    def _unseen(self) -> str:
        focal = "a focal length wrong in both cameras, " if np.isnan(self.focal) else ""
        return f"; this cannot show: {focal}a wrong baseline"


NO_MOTION = Motion()


def couple_across(rectification: Rectification, pairs: Iterable[Images]) -> SeenTwice | None:
    """As ``find_motion`` makes a couple, of all features that there are. pairs: the first, and
    those that follow it.
    """
    return _couple(rectification, pairs, MATCH_LIMITS)


def find_motion(rectification: Rectification, starts: Iterable[Iterable[Images]]) -> Motion:
    """Measure on raw image pairs. starts: as for ``find_couples``.

    No more couples are looked at once the least number of them shows that ranges are right.
    """
    couples: list[SeenTwice] = []
    for couple in find_couples(rectification, starts):
        couples.append(couple)
        if len(couples) == LIMITS.least_couples:
            motion = motion_of(couples, rectification.matching_pair)
            if motion.is_right:
                return motion
    return motion_of(couples, rectification.matching_pair)


def find_couples(
    rectification: Rectification, starts: Iterable[Iterable[Images]]
) -> Iterator[SeenTwice]:
    """Points that are seen twice. starts: for each couple its first pair and pairs that follow it,
    nearest first.

    The first of those that has moved far enough makes the couple.
    """
    for pairs in starts:
        if couple := _couple(rectification, pairs):
            yield couple


def fit_clear(
    couples: Sequence[SeenTwice], geometry: RectifiedPair
) -> tuple[Fitted, Collection[int]]:
    """Fit an offset, and a focal length and errors over rows and columns where these couples show
    them clearly; and which values were fitted.

    Where an error over the rows is not clear, leaving it free would take a part of an offset.
    """
    disparity_px = float(np.median(np.concatenate([couple.first[:, 2] for couple in couples])))
    uneven = fit_motions(couples, geometry, OFFSET, FOCAL, ROWS, COLUMNS)
    free = [OFFSET, FOCAL]
    for value in (ROWS, COLUMNS):
        std_px = float(np.hypot(uneven.std[value], LIMITS.lens_rad * geometry.focal_px / 2))
        least_px = max(LIMITS.uneven * disparity_px, LIMITS.deviations * std_px)
        free += [value] if abs(uneven.values[value]) > least_px else []
    fitted = fit_motions(couples, geometry, *free)
    if fitted.std[FOCAL] < LIMITS.known_focal:
        return fitted, free
    free.remove(FOCAL)
    return fit_motions(couples, geometry, *free), free


def range_error(offset_px: Array, log_focal: Array, disparity_px: float) -> Array:
    """Of ranges at a disparity, relative, that lacks this offset and is of this focal length."""
    return np.asarray((1 + offset_px / disparity_px) * np.exp(-log_focal) - 1)


def motion_of(couples: Sequence[SeenTwice], geometry: RectifiedPair) -> Motion:
    """Measure on points that were seen twice."""
    pixel_error = 1 / (geometry.focal_px * geometry.baseline_m)
    if len(couples) < LIMITS.least_couples:
        return Motion(pixel_error=pixel_error)
    try:
        return _motion_of(couples, geometry, Motion(pixel_error=pixel_error))
    except np.linalg.LinAlgError:  # points that hold no motion: all on a line
        return Motion(pixel_error=pixel_error)


def _motion_of(couples: Sequence[SeenTwice], geometry: RectifiedPair, unknown: Motion) -> Motion:
    focal_px, height = geometry.focal_px, geometry.image_size[1]
    disparity_px = float(np.median(np.concatenate([couple.first[:, 2] for couple in couples])))
    seen = replace(
        unknown,
        couples=len(couples),
        points=sum(len(couple.first) for couple in couples),
        at_m=focal_px * geometry.baseline_m / disparity_px,
        disparity_px=disparity_px,
    )
    uneven = fit_motions(couples, geometry, OFFSET, FOCAL, ROWS, COLUMNS)
    # an error over the columns alike in all pairs looks, in each couple, like one between moments
    even = [_without_columns(couple, float(uneven.values[COLUMNS]), geometry) for couple in couples]
    own = []
    for couple in even:
        with suppress(np.linalg.LinAlgError):  # one that holds no motion; the others do
            own.append(fit_motions([couple], geometry, OFFSET, LATER, LATER_ROWS))
    if not own:
        return unknown
    for value in (LATER, LATER_ROWS):
        if between_px := _between_px(own, value, disparity_px):
            rolled_px = float(np.median([abs(one.roll_rad) for one in couples])) * height / 2
            rows = value == LATER_ROWS
            return replace(seen, between_px=between_px, between_rows=rows, rolled_px=rolled_px)
    lens_px = LIMITS.lens_rad * focal_px
    fitted, free = fit_clear(couples, geometry)
    focal_is_known = FOCAL in free
    found = replace(
        seen, rest_px=fitted.rest_px, own_px=float(np.median([one.rest_px for one in own]))
    )
    if found.is_misfit:
        return found
    offset_px, log_focal, rows_px, columns_px = map(float, fitted.values[:4])
    lens_focal = LIMITS.focal * focal_is_known
    errors = range_error(fitted.partial[:, OFFSET], fitted.partial[:, FOCAL], disparity_px)
    parts = [
        float(jackknife(errors[:, None])[0]),
        fitted.std[OFFSET] / disparity_px,
        lens_px / disparity_px,
        lens_focal,
    ]
    return replace(
        found,
        offset_px=offset_px,
        offset_std_px=float(np.hypot(fitted.std[OFFSET], lens_px)),
        focal=float(np.expm1(log_focal)) if focal_is_known else np.nan,
        focal_std=float(np.hypot(fitted.std[FOCAL], lens_focal)) if focal_is_known else np.inf,
        range_error=float(range_error(fitted.values[OFFSET], fitted.values[FOCAL], disparity_px)),
        range_std=float(np.linalg.norm(parts)),
        rows_px=rows_px if ROWS in free else 0.0,
        rows_std_px=float(np.hypot(fitted.std[ROWS], lens_px / 2)) if ROWS in free else np.inf,
        columns_px=columns_px if COLUMNS in free else 0.0,
        columns_std_px=(
            float(np.hypot(fitted.std[COLUMNS], lens_px / 2)) if COLUMNS in free else np.inf
        ),
    )


def _without_columns(couple: SeenTwice, columns_px: float, geometry: RectifiedPair) -> SeenTwice:
    """The couple with disparities corrected by an amount that grows over the columns."""
    first, second = (
        corrected_points(points, np.array([0.0, columns_px, 0.0]), geometry)
        for points in (couple.first, couple.second)
    )
    return replace(couple, first=first, second=second)


def _between_px(own: Sequence[Fitted], value: int, disparity_px: float) -> float:
    """By how much disparities differ between two moments (median), where most couples show it; 0
    where they do not.
    """
    found_px = np.array([abs(one.values[value]) for one in own])
    std_px = np.array([one.std[value] for one in own])
    clear = found_px > np.maximum(LIMITS.uneven * disparity_px, LIMITS.pair_deviations * std_px)
    return float(np.median(found_px)) if 2 * clear.sum() > len(own) else 0.0


def _couple(
    rectification: Rectification, pairs: Iterable[Images], features: MatchLimits = FEATURES
) -> SeenTwice | None:
    """The points that the first pair and the first one that has moved far enough show; None also
    for images of another size.
    """
    with suppress(CalibrationError):
        return _moved(rectification, iter(pairs), features)
    return None


def _moved(
    rectification: Rectification, pairs: Iterator[Images], features: MatchLimits
) -> SeenTwice | None:
    start = next(pairs, None)
    if start is None:
        return None
    first = describe_left(rectification, start[0], features)
    for images in pairs:
        left = describe_left(rectification, images[0], features)
        moved = match_described(first, left, replace(features, max_row_fraction=1.0))
        if len(moved.left) < LIMITS.least_points:
            return None
        if (
            np.median(np.abs(moved.left - moved.right).max(axis=1))
            >= LIMITS.least_move * left.image.shape[1]
        ):
            here, there = (
                match_described(seen, describe_right(rectification, right, features), features)
                for seen, (_, right) in ((first, start), (left, images))
            )
            return _seen_twice(rectification, here, moved, there)
    return None


def _seen_twice(
    rectification: Rectification, here: Matches, moved: Matches, there: Matches
) -> SeenTwice | None:
    """Points of the left images of both pairs, with their disparities at both moments."""
    geometry = rectification.matching_pair
    at_first, at_second = (
        same_points(moved.left, here.left, LIMITS.near_px),
        same_points(moved.right, there.left, LIMITS.near_px),
    )
    found = np.flatnonzero((at_first >= 0) & (at_second >= 0))
    kept, sides, rows_px = np.ones(len(found), bool), [], []
    for left, matches, index in (
        (moved.left[found], here, at_first[found]),
        (moved.right[found], there, at_second[found]),
    ):
        disparity, row_px = (matches.left[index] - matches.right[index]).T
        disparity = disparity - (geometry.cx_left_px - geometry.cx_right_px)
        kept &= (np.abs(row_px) < LIMITS.most_row_px) & (disparity > LIMITS.least_disparity_px)
        sides.append(np.column_stack([left - [geometry.cx_left_px, geometry.cy_px], disparity]))
        rows_px.append(-row_px)
    if kept.sum() < LIMITS.least_points:
        return None
    return SeenTwice(sides[0][kept], sides[1][kept], np.column_stack(rows_px)[kept])
