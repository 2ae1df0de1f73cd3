"""What changes from pair to pair of a dive: focus, zoom, a knocked camera, stabilization, pairs of
another rig; by the rows of matched points.

A rig is rigid: the rows of all its pairs disagree alike. Each pair is described by the offset, the
roll and the vertical scale of its right image that explain its rows, and the pairs are compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibration.geometry import Array, RectifiedPair
from calibration.robust_statistics import deviation_about_zero
from calibration.verification.matches import Matches
from calibration.verification.rigid_motion import LATER, SeenTwice, fit_motions
from calibration.verification.row_fits import explain, robust_fit, row_inliers

Kind = Literal["", "odd", "step", "drift", "each"]

LEAST_PX = 0.5
"""Pairs of one rig differ by less over the image: by 0.02 px in the sample dive, up to 0.3 px on a
real survey with a drifted rig, whose lens model leaves more in one scene than in another."""
RANGE_ERROR = 0.02
"""Of the median disparity: a change that moves it by less makes no range wrong by more than 2 %."""
DEVIATIONS = 5.0
"""Standard errors by which pairs must differ: those of neighboring points are alike."""
LEAST_POINTS = 50
"""Of a pair: fewer do not reach the corners of the image, where roll and scale show."""
LEAST_PAIRS = 4
"""Fewer pairs do not tell which of them is the odd one."""
MOST_ODD = 0.34
"""Fraction of pairs that may be odd among others that agree."""
ONE_CAUSE = 0.9
"""Fraction of the squared change that one of offset, roll and scale makes where it is the cause."""
DRIFT_PAIRS = 6
"""Fewer do not tell a drift from a step."""
STEADY = 0.9
"""Fraction of the squared change that grows in proportion to the place in the dive in a drift: of a
step, three quarters at most."""
JUMP = 0.5
"""Fraction of the whole change that two neighboring pairs may differ by in a drift."""
CLEARLY = 1.5
"""A rival explains rows better only where it leaves so many times less."""
LIKELIER = 15.0
"""Logarithm of a likelihood ratio from which on a side is named: errors of neighboring points are
alike, so that far more than the usual 3 is asked for."""


@dataclass(frozen=True)
class PairRows:
    """The rows of one pair.

    motion_px: (3,) what the offset, the roll and the vertical scale that explain them move rows by,
    pixels, root mean square over the image, with their signs; std_px: the standard error of all
    three, more where points are few or lie in one corner. scale: of the right image's rows over
    the left one's. rest_px: median that these leave; parallax_px: the same beside a term in
    disparity, as between two moments. disparity_px: median.
    """

    motion_px: Array
    std_px: float
    scale: float
    rest_px: float
    parallax_px: float
    disparity_px: float

    @property
    def is_behind(self) -> bool:
        """Tell whether most points lie behind infinity."""
        return self.disparity_px < 0


def pair_rows(matches: Matches, pair: RectifiedPair) -> PairRows | None:
    """Describe a pair by its matches in the images that are matched; None for too few."""
    if len(matches.left) < LEAST_POINTS:
        return None
    kept = row_inliers(matches.left, matches.right, pair)
    if kept.sum() < LEAST_POINTS:
        return None
    left = matches.left[kept] - [pair.cx_left_px, pair.cy_px]
    right = matches.right[kept] - [pair.cx_right_px, pair.cy_px]
    rows, disparity = right[:, 1] - left[:, 1], left[:, 0] - right[:, 0]
    (offset, scale, roll), rest = explain(rows, left)
    terms = np.column_stack([np.ones(len(left)), left, disparity - np.median(disparity)])
    _, between = robust_fit(terms, rows)
    to_px = np.array([1, *np.array(pair.image_size) / np.sqrt(12)])
    design = np.column_stack([np.ones(len(left)), left]) / to_px
    return PairRows(
        np.array([offset, roll, scale]) * to_px,
        deviation_about_zero(rest) * float(np.sqrt(np.trace(np.linalg.pinv(design.T @ design)))),
        1 + float(scale),
        float(np.median(np.abs(rest))),
        float(np.median(np.abs(between))),
        float(np.median(disparity)),
    )


def differ(one: PairRows, other: PairRows) -> bool:
    """Tell whether two pairs cannot be of one rigid rig, or ranges of one are wrong by more than
    2 % if the other's are right.

    A change that rows show is taken to move columns as much.
    """
    least_px = min(abs(one.disparity_px), abs(other.disparity_px))
    apart_px = float(np.linalg.norm(one.motion_px - other.motion_px))
    noise_px = max(
        CLEARLY * one.rest_px,
        CLEARLY * other.rest_px,
        DEVIATIONS * float(np.hypot(one.std_px, other.std_px)),
    )
    return one.is_behind != other.is_behind or apart_px > max(
        LEAST_PX, noise_px, RANGE_ERROR * least_px
    )


@dataclass(frozen=True)
class Changes:
    """How pairs of a dive differ, in its order.

    kind: "odd", some pairs among others that agree; "step", all from a pair on; "drift", steadily;
    "each", pair by pair; "" where they agree, or too few tell. first: place of the first pair after
    a step; before: of the last one before it. odd: places of all odd pairs.
    scale: the vertical scale of the right image against the left one after the change, over that
    before; NaN where the change is another. spread_px: standard deviation of the rows of pairs, or
    size of the step, root mean square over the image.
    range_error: what ranges at the median disparity are wrong by where columns change as rows do,
    relative. moments: rows are explained better by parallax, as of two moments.
    """

    kind: Kind = ""
    first: int = 0
    before: int = 0
    odd: tuple[int, ...] = ()
    scale: float = float("nan")
    spread_px: float = 0.0
    range_error: float = 0.0
    moments: bool = False


NO_CHANGES = Changes()


def changes_of(rows: Sequence[PairRows | None]) -> Changes:
    """Compare the pairs of a dive, None for those that show too little."""
    places = [place for place, one in enumerate(rows) if one]
    known = [one for one in rows if one]
    if len(known) < LEAST_PAIRS:
        return NO_CHANGES
    groups = _groups(known)
    largest = max(groups, key=len)
    others = sorted(set(range(len(known))) - set(largest))
    if not others:
        return NO_CHANGES
    if _drifts(known, places):
        change_px = known[-1].motion_px - known[0].motion_px
        return _changed("drift", change_px, known, _moments(known))
    if step := _step(known):
        before, after = known[:step], known[step:]
        change_px = _middle(after) - _middle(before)
        scale = _scale(after) / _scale(before)
        found = _changed("step", change_px, known, _moments(after), scale)
        return replace(found, first=places[step], before=places[step - 1])
    if len(others) <= MOST_ODD * len(known):
        return Changes("odd", odd=tuple(places[other] for other in others))
    spread_px = np.array([one.motion_px for one in known]).std(axis=0, ddof=1)
    return _changed("each", spread_px, known, _moments(known), 1.0)


def _changed(
    kind: Kind, change_px: Array, known: Sequence[PairRows], moments: bool, scale: float = np.nan
) -> Changes:
    """A change of this size, as PairRows has motions; scale: where it is one of scale."""
    size_px = float(np.linalg.norm(change_px))
    of_scale = change_px[2] ** 2 > ONE_CAUSE * float(change_px @ change_px)
    return Changes(
        kind,
        scale=scale if of_scale else float("nan"),
        spread_px=size_px,
        range_error=size_px / _disparity(known),
        moments=moments,
    )


def _drifts(known: Sequence[PairRows], places: Sequence[int]) -> bool:
    """Tell whether the rows of pairs change steadily from the first to the last one."""
    if len(known) < DRIFT_PAIRS:
        return False
    motions = np.array([one.motion_px for one in known])
    _, _, directions = np.linalg.svd(motions - motions.mean(axis=0))
    along = motions @ directions[0]
    steady = np.corrcoef(places, along)[0, 1] ** 2 > STEADY
    return bool(steady and np.abs(np.diff(along)).max() < JUMP * np.ptp(along))


def _groups(known: Sequence[PairRows]) -> list[list[int]]:
    """For each pair, those that it agrees with."""
    return [
        [other for other in range(len(known)) if not differ(known[one], known[other])]
        for one in range(len(known))
    ]


def _step(known: Sequence[PairRows]) -> int:
    """The first pair of a second part, where each of two parts agrees in itself and not with the
    other, but for single odd pairs; 0 where there are no such parts.
    """
    best, least = 0, len(known)
    for step in range(2, len(known) - 1):
        misfits = 0
        sides = (known[:step], known[step:])
        middles = [
            min(side, key=lambda one: float(np.linalg.norm(one.motion_px - _middle(side))))
            for side in sides
        ]
        if not differ(*middles):
            continue
        for side, middle in zip(sides, middles, strict=True):
            odd = sum(differ(one, middle) for one in side)
            misfits += odd if odd <= len(side) / 4 else len(known)
        if misfits < least:
            best, least = step, misfits
    return best


def _middle(rows: Sequence[PairRows]) -> Array:
    return np.asarray(np.median([one.motion_px for one in rows], axis=0))


def _scale(rows: Sequence[PairRows]) -> float:
    return float(np.median([one.scale for one in rows]))


def _disparity(rows: Sequence[PairRows]) -> float:
    return max(float(np.median([abs(one.disparity_px) for one in rows])), 1.0)


def _moments(rows: Sequence[PairRows]) -> bool:
    rest_px, parallax_px = np.median([(one.rest_px, one.parallax_px) for one in rows], axis=0)
    return bool(rest_px > CLEARLY * parallax_px)


def enlarged_side(couples: Sequence[SeenTwice], geometry: RectifiedPair, scale: float) -> str:
    """Which side a lens changed on, "left" or "right"; "" where motion does not tell.

    couples: of a pair before the change and one after. scale: of the right images against the left
    ones after the change, over that before. Either right images became that much larger, or left
    ones smaller: with the wrong one of both, points after the change look as if the focal length of
    both sides had changed, which no motion over a bottom with relief explains.
    """
    likelier = 0.0  # the logarithm of the likelihood of the right side over that of the left one
    for couple in couples:
        if_left_px = _rest_px(couple, geometry, scale, 1.0)
        if_right_px = _rest_px(couple, geometry, 1.0, 1 / scale)
        if np.isfinite([if_left_px, if_right_px]).all():
            likelier += 3 * len(couple.first) * float(np.log(if_left_px / if_right_px))
    if abs(likelier) < LIKELIER:
        return ""
    return "right" if likelier > 0 else "left"


def _rest_px(couple: SeenTwice, geometry: RectifiedPair, left: float, right: float) -> float:
    """What a rigid motion leaves if the images of the second moment are resized by these."""
    x, y, disparity = couple.second.T
    back = np.column_stack([left * x, left * y, left * x - right * (x - disparity)])
    try:
        return fit_motions([replace(couple, second=back)], geometry, LATER).rest_px
    except np.linalg.LinAlgError:
        return float("inf")
