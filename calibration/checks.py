"""Checks of a calibration on images of a dive: do rows agree, and the causes if they do not."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError, counted
from calibration.geometry import Array, RectifiedPair
from calibration.rectification import Rectification, plan_rectification, raw_points
from calibration.rig import StereoRig
from calibration.robust_statistics import deviation_about_zero
from calibration.verification.causes import find_causes
from calibration.verification.explanations import NOT_TESTED
from calibration.verification.matches import Matches, find_matches
from calibration.verification.rigid_motion import SeenTwice
from calibration.verification.row_fits import explain, row_inliers
from calibration.verification.vertical_disparity import BEHIND_PX, LIMITS, MIN_MATCHES, RowCheck

__all__ = ["RowCheck", "judge_matches", "rows_off_px", "vertical_disparity"]


def vertical_disparity(
    rig: StereoRig, pairs: Iterable[tuple[NDArray[np.generic], NDArray[np.generic]]]
) -> RowCheck:
    """Measure on raw image pairs, (H, W) or (H, W, C), whether the calibration fits them.

    Raises CalibrationError if the images are of another size, or too few points are found in both.
    """
    rectification = Rectification.from_rig(rig)
    return judge_matches(rig, [find_matches(rectification, left, right) for left, right in pairs])


def rows_off_px(rig: StereoRig, matches: Sequence[Matches]) -> float:
    """Median vertical disparity, pixels, of matches in the rectified images of each pair. Raises
    CalibrationError for too few.
    """
    left, right, _ = _points_near_rows(plan_rectification(rig).matching_pair, matches)
    return float(np.median(np.abs(right[:, 1] - left[:, 1])))


def judge_matches(
    rig: StereoRig, matches: Sequence[Matches], couples: Sequence[SeenTwice] = ()
) -> RowCheck:
    """Judge the rows as vertical_disparity does, from matches in the rectified images of each pair.

    couples: points of neighboring pairs, by whose motion causes are tested, too.
    """
    plan = plan_rectification(rig)
    pair = plan.matching_pair
    left, right, numbers = _points_near_rows(pair, matches)
    in_images = raw_points(rig, left, right)
    left, right = left - [pair.cx_left_px, pair.cy_px], right - [pair.cx_right_px, pair.cy_px]
    rows = right[:, 1] - left[:, 1]
    model, unexplained = explain(rows, left)
    row_error_px = float(np.median(np.abs(rows)))
    across = 1 - plan.pair.quarter_turns % 2  # rows, or columns of a vertical pair
    causes = find_causes(rig, matches, couples)
    agree = row_error_px <= LIMITS.acceptable_px
    return RowCheck(
        pairs=len(matches),
        matches=len(rows),
        row_error_px=row_error_px,
        offset_px=float(model[0]),
        scale=float(1 + model[1]),
        roll_deg=float(np.degrees(model[2])),
        unexplained_px=float(np.median(np.abs(unexplained))),
        behind_fraction=float((left[:, 0] - right[:, 0] < BEHIND_PX).mean()),
        causes=NOT_TESTED if agree and not causes.is_wrong else causes,
        unrectified_px=float(np.median(np.abs(in_images[1][:, across] - in_images[0][:, across]))),
        apart_px=float(np.median(np.hypot(*(in_images[1] - in_images[0]).T))),
        between_pairs_px=_between_pairs_px(unexplained, numbers),
        disparity_px=float(np.median(left[:, 0] - right[:, 0])),
    )


def _points_near_rows(
    pair: RectifiedPair, all_matches: Sequence[Matches]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """(n, 2) matched points of the left and right images that agree about the rows, and (n,) the
    number of the pair of each. Raises CalibrationError for too few.
    """
    joined = Matches.joined(all_matches)
    left, right = joined.left, joined.right
    numbers = np.repeat(np.arange(len(all_matches)), [len(matches.left) for matches in all_matches])
    if len(left) >= MIN_MATCHES:
        kept = row_inliers(left, right, pair)
        left, right, numbers = left[kept], right[kept], numbers[kept]
    if len(left) < MIN_MATCHES:
        raise CalibrationError(
            f"only {len(left)} points were found in both images of "
            f"{counted(len(all_matches), 'pair')}, {MIN_MATCHES} are needed: give pairs with "
            "texture, and check whether both images show the same scene at the same time"
        )
    return left, right, numbers


def _between_pairs_px(rest: Array, numbers: NDArray[np.int64]) -> float:
    """Robust standard deviation of the medians of pairs' rows; numbers: (n,) of the pairs."""
    medians = [np.median(rest[numbers == number]) for number in np.unique(numbers)]
    return deviation_about_zero(medians - np.median(medians)) if len(medians) > 2 else 0.0
