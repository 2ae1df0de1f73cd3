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
from dataclasses import replace

import numpy as np

from calibration.errors import CalibrationError
from calibration.geometry import Array, RectifiedPair
from calibration.rectification import Rectification
from calibration.resampling import jackknife
from calibration.verification.matches import (
    QUICK,
    Images,
    Matches,
    MatchLimits,
    describe_left,
    describe_right,
    match_described,
    same_points,
)
from calibration.verification.motion_result import LIMITS, Motion
from calibration.verification.rigid_motion import (
    ASPECT,
    COLUMNS,
    FOCAL,
    LATER,
    LATER_ROWS,
    OFFSET,
    ROWS,
    Fitted,
    SeenTwice,
    corrected_points,
    disparity_noise_px,
    fit_motions,
)

FEATURES = replace(QUICK, max_features=1000)
NOISE_DRAWS = 2
"""Draws of noise: the scatter of their mean is a fifth of what noise does."""


def find_motion(couples: Iterable[SeenTwice], geometry: RectifiedPair) -> Motion:
    """``motion_of`` couples that are found while they are asked for: no more are, once the least
    number of them shows that ranges are right.
    """
    found: list[SeenTwice] = []
    for couple in couples:
        found.append(couple)
        if len(found) == LIMITS.least_couples:
            motion = motion_of(found, geometry)
            if motion.is_right:
                return motion
    return motion_of(found, geometry)


def changes_in_time(couples: Sequence[SeenTwice], geometry: RectifiedPair) -> bool:
    """Tell whether the couples before and after some moment want offsets that differ, and none
    stands out from those on its side: an offset of them all then describes neither.
    """
    own = []
    for couple in couples:
        with suppress(np.linalg.LinAlgError):  # one that holds no motion
            fitted = fit_motions([couple], geometry, OFFSET)
            own.append(_without_noise(fitted, [couple], geometry, [OFFSET]))
    if not own:
        return False
    offset_px = np.array([one.values[OFFSET] for one in own])
    # what a usual lens model leaves differs by relief: on a real dive by 0.5 of it between couples
    lens_px = LIMITS.lens_rad * geometry.focal_px / 2
    weight = 1 / (np.array([one.std[OFFSET] for one in own]) ** 2 + lens_px**2)
    disparity_px = float(np.median(np.concatenate([couple.first[:, 2] for couple in couples])))
    for place in range(1, len(own)):
        sides = (slice(None, place), slice(place, None))
        first, then = (np.average(offset_px[side], weights=weight[side]) for side in sides)
        std_px = float(np.sqrt(sum(1 / weight[side].sum() for side in sides)))
        least_px = max(LIMITS.uneven * disparity_px, LIMITS.pair_deviations * std_px)
        step_px = np.repeat([first, then], [place, len(own) - place])
        apart = np.abs(offset_px - step_px) * np.sqrt(weight)
        if abs(then - first) > least_px and apart.max() <= LIMITS.pair_deviations:
            return True
    return False


def fit_clear(
    couples: Sequence[SeenTwice], geometry: RectifiedPair
) -> tuple[Fitted, Collection[int]]:
    """Fit an offset, and a focal length, one of the other axis, and errors over rows and columns,
    where these couples show them clearly; and which values were fitted.

    Where an error over the rows is not clear, leaving it free would take a part of an offset.
    """
    disparity_px = float(np.median(np.concatenate([couple.first[:, 2] for couple in couples])))
    every, free = (OFFSET, FOCAL, ROWS, COLUMNS, ASPECT), [OFFSET, FOCAL]
    uneven = _without_noise(fit_motions(couples, geometry, *every), couples, geometry, every)
    for value in (ROWS, COLUMNS):
        std_px = float(np.hypot(uneven.std[value], LIMITS.lens_rad * geometry.focal_px / 2))
        least_px = max(LIMITS.uneven * disparity_px, LIMITS.deviations * std_px)
        free += [value] if abs(uneven.values[value]) > least_px else []
    aspect_std = float(np.hypot(uneven.std[ASPECT], LIMITS.focal / 2))
    free += [ASPECT] if abs(uneven.values[ASPECT]) > LIMITS.pair_deviations * aspect_std else []
    fitted = fit_motions(couples, geometry, *free, start=uneven)
    if fitted.std[FOCAL] >= LIMITS.known_focal:
        free.remove(FOCAL)
        fitted = fit_motions(couples, geometry, *free, start=fitted)
    fitted = _without_noise(fitted, couples, geometry, free)
    if ASPECT not in free:  # causes are tested on it, too
        for name in ("values", "partial", "std", "formal"):
            getattr(fitted, name)[..., ASPECT] = getattr(uneven, name)[..., ASPECT]
    return fitted, free


def _without_noise(
    fitted: Fitted, couples: Sequence[SeenTwice], geometry: RectifiedPair, free: Collection[int]
) -> Fitted:
    """The fit without what noise of the disparities does to it (simulation and extrapolation, Cook
    and Stefanski 1994): parallax by a noisy disparity looks too small, as with an offset. As much
    noise again moves the values as much again; half of it is one more error. Rows and the second
    moment do not show all of the noise: windows around a point see the same beside it.
    """
    noise_px = disparity_noise_px(fitted, couples, geometry)
    rng, moved = np.random.default_rng(0), []
    for _ in range(NOISE_DRAWS):
        noisy = [
            replace(
                couple,
                first=couple.first + rng.normal(0, [0, 0, std_px], couple.first.shape),
                second=couple.second + rng.normal(0, [0, 0, std_px], couple.second.shape),
            )
            for couple, std_px in zip(couples, noise_px, strict=True)
        ]
        moved.append(fit_motions(noisy, geometry, *free, start=fitted).values - fitted.values)
    by_noise = np.mean(moved, axis=0)
    return replace(
        fitted,
        values=fitted.values - by_noise,
        partial=fitted.partial - by_noise,
        std=np.hypot(fitted.std, by_noise / 2),
        formal=np.hypot(fitted.formal, by_noise / 2),
    )


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
    columns_px = 0.0
    with suppress(np.linalg.LinAlgError):  # couples that differ may fit no values that they share
        columns_px = float(
            fit_motions(couples, geometry, OFFSET, FOCAL, ROWS, COLUMNS).values[COLUMNS]
        )
    # an error over the columns alike in all pairs looks, in each couple, like one between moments
    even = [_without_columns(couple, columns_px, geometry) for couple in couples]
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
        aspect=float(np.expm1(fitted.values[ASPECT])) if ASPECT in free else 0.0,
        aspect_std=float(np.hypot(fitted.std[ASPECT], LIMITS.focal / 2)),
    )


def _without_columns(couple: SeenTwice, columns_px: float, geometry: RectifiedPair) -> SeenTwice:
    """The couple with disparities corrected by an amount that grows over the columns."""
    first, second = (
        corrected_points(points, np.array([0.0, columns_px, 0.0]), geometry)
        for points in (couple.first, couple.second)
    )
    return replace(couple, first=first, second=second)


def _between_px(own: Sequence[Fitted], value: int, disparity_px: float) -> float:
    """Median difference of disparities between two moments where most couples show it; else 0."""
    found_px = np.array([abs(one.values[value]) for one in own])
    std_px = np.array([one.std[value] for one in own])
    clear = found_px > np.maximum(LIMITS.uneven * disparity_px, LIMITS.pair_deviations * std_px)
    return float(np.median(found_px)) if 2 * clear.sum() > len(own) else 0.0


def couple_of(
    rectification: Rectification, pairs: Iterable[Images], features: MatchLimits = FEATURES
) -> SeenTwice | None:
    """The points that the first raw pair of images and the first of those that follow it, nearest
    first, that has moved far enough show; None also for images of another size.
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
    at_first = same_points(moved.left, here.left, LIMITS.near_px)
    at_second = same_points(moved.right, there.left, LIMITS.near_px)
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
