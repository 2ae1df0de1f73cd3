"""Vertical disparity of matched points: what it says of a calibration, fitted over the image, and
quickly over one pair.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from calibration.field_checks.causes import MOVED, NOT_TESTED, Causes
from calibration.field_checks.enlargement import NOT_ENLARGED, Enlargement
from calibration.field_checks.matches import (
    NO_KEYSTONE,
    QUICK,
    Images,
    Keystone,
    find_keystone,
    find_matches,
)
from calibration.field_checks.motion import NO_MOTION, Motion
from calibration.geometry import RectifiedPair
from calibration.port import FLAT_PORT
from calibration.rectification import Rectification

# Check of a calibration by the rows of matched points of a dive, and what explains disagreement.


@dataclass(frozen=True)
class RowLimits:
    """Decides what vertical disparity means."""

    # matching searches one row: the confidence of fine texture falls from here on
    acceptable_px: float = 0.25
    # points behind infinity; nearly all of a swapped pair, and only mismatches of another
    swapped_fraction: float = 0.8
    # offset, scale and roll that leave more than this of the disparity do not explain it
    moved_ratio: float = 0.7
    # real rigs drift by a pixel or two; pairs off by one frame had 29 and 58 px
    drift_px: float = 20.0
    # water is 1.33 to 1.36, and the grid steps by 0.02
    water_index: tuple[float, float] = (1.26, 1.42)
    # light bent by a port must leave less than this of what a moved camera leaves ...
    air_ratio: float = 0.7
    # ... and gain more than matches are uncertain by; the same for images cut out and enlarged
    air_gain_px: float = 0.05
    # rows of rectified images agree to 0.1 px; a camera that moved so that raw rows agree is not
    # usual
    rectified_ratio: float = 0.5
    # a point lies that near to its own place in the other image only where it is infinitely far
    apart_px: float = 2.0
    # of the median disparity: where rows are off by more, more than 5 % of the ranges are wrong by
    # more than 2 % (sample dive: rows off by 0.6, 1.2, 2 px of 28: 1.3, 1.9, 2.9 %)
    row_fraction: float = 0.05
    # a rig's pairs agree to 0.1 px, with a rolling shutter to some tenths; those of a moving camera
    # do not
    between_px: float = 1.0
    clear: float = 0.25  # ... or so much of what was to be explained


LIMITS = RowLimits()
RECTIFIED = "the images are rectified already"
GIVE_RECTIFIED = (
    "give the calibration of the rectified images (rectified.yaml, P of ROS, P1 and P2 of OpenCV, "
    "or one focal length without distortion and rotation), or the raw images"
)


@dataclass(frozen=True, eq=False)
class RowCheck:
    """Vertical disparity in images of a dive.

    pairs, matches: what it rests on. row_error_px: median absolute value. offset_px, scale,
    roll_deg: the vertical offset, vertical scale (1 = none) and rotation of the right image that
    explain the most of it; unexplained_px: the median that these leave. behind_fraction: of the
    matches, those with impossible disparity (points behind infinity).
    enlargement: of images cut out of those that were calibrated, and what it leaves.
    keystone: what a yaw of the right camera would leave in the rows.
    index: the refractive index of a flat port that explains the matches best, 1 = none;
    index_unexplained_px: what it leaves.
    mistake: what was done wrong with the calibration and explains the rest, where one was looked
    for and found.
    motion: between neighboring pairs, which shows what rows do not. causes: what explains both.
    unrectified_px: median difference of the rows in the images as they are; apart_px: median
    distance of the points in them.
    between_pairs_px: standard deviation of the pairs' rows, each pair's median, after what explains
    the most; 0 for under three.
    disparity_px: median.
    change: what changes from pair to pair, so that no one calibration fits all, and what to do.
    odd: which pairs are of another rig; they are left out of all else.
    """

    pairs: int
    matches: int
    row_error_px: float
    offset_px: float
    scale: float
    roll_deg: float
    unexplained_px: float
    behind_fraction: float
    index: float
    index_unexplained_px: float
    enlargement: Enlargement = NOT_ENLARGED
    mistake: str = ""
    keystone: Keystone = NO_KEYSTONE
    motion: Motion = NO_MOTION
    causes: Causes = NOT_TESTED
    unrectified_px: float = float("inf")
    apart_px: float = float("inf")
    between_pairs_px: float = 0.0
    disparity_px: float = float("inf")
    change: str = ""
    odd: str = ""

    @property
    def acceptable(self) -> bool:
        """True if rows agree to a quarter of a pixel, and ranges are not wrong."""
        agree = self.row_error_px <= LIMITS.acceptable_px
        return agree and not self.ranges_are_wrong and not self.odd

    @property
    def ranges_are_wrong(self) -> bool:
        """True if a cause that explains rows and motion makes ranges wrong, left is not left,
        pairs differ, or rows are off by so much that ranges are.
        """
        return bool(
            self.swapped
            or self.causes.is_wrong
            or self.motion.between_px
            or self.refusal
            or self.mistake
            or self.change
            or (self.row_error_px > LIMITS.acceptable_px and (self.cut_out or self.air_in_water))
            or self.row_error_px > LIMITS.row_fraction * abs(self.disparity_px)
        )

    @property
    def swapped(self) -> bool:
        """Tell whether nearly all points lie behind infinity."""
        return self.behind_fraction > LIMITS.swapped_fraction

    @property
    def one_picture(self) -> bool:
        """Tell whether points lie at the same places of both images, as in one camera's picture
        that was given twice.
        """
        return self.apart_px < LIMITS.apart_px

    @property
    def no_rig(self) -> bool:
        """Tell whether pairs contradict each other, as those of one moving camera, or of two
        moments, do.
        """
        return self.between_pairs_px > max(LIMITS.between_px, LIMITS.clear * self.row_error_px)

    @property
    def refusal(self) -> str:
        """Why these are not images of this rig that ranges can be had from, and what to do; ""
        where they may be.
        """
        if self.one_picture:
            return (
                f"both sides show one camera's picture: points lie {self.apart_px:.1f} px apart in "
                "the images (median): give the other camera's images on one of the sides"
            )
        if self.rectified_already:
            return (
                f"{RECTIFIED}: as they are their rows agree to {self.unrectified_px:.2f} px, and "
                "after rectification by this "
                f"calibration to {self.row_error_px:.2f} px: {GIVE_RECTIFIED}"
            )
        return ""

    @property
    def rectified_already(self) -> bool:
        """Tell whether rows agree in the images as they are, and neither after rectification nor
        after a movement of a camera.

        A rig without distortion that has moved a little may come to the same: refined, it is right
        either way.
        """
        explained_px = min(self.row_error_px, self.unexplained_px)
        agree = self.unrectified_px <= min(
            LIMITS.acceptable_px, LIMITS.rectified_ratio * explained_px
        )
        return agree and self.row_error_px > LIMITS.acceptable_px

    @property
    def in_front(self) -> bool:
        """Tell whether nearly all points lie in front of the cameras."""
        return self.behind_fraction < 1 - LIMITS.swapped_fraction

    @property
    def has_moved(self) -> bool:
        """True if rows disagree as after a movement of a camera, which refining can find."""
        turned = self.causes.is_wrong and self.causes.has_moved
        drifted = (self.row_error_px > LIMITS.acceptable_px and self._is_drift) or turned
        otherwise = (
            self.swapped
            or self.air_in_water
            or self.cut_out
            or self.keystone.is_lens
            or self.refusal
            or self.no_rig
            or self.change
        )
        return drifted and not (otherwise or self.mistake)

    @property
    def _is_drift(self) -> bool:
        explained = self.unexplained_px <= LIMITS.moved_ratio * self.row_error_px
        return explained and self.row_error_px < LIMITS.drift_px and not self.no_rig

    @property
    def air_in_water(self) -> bool:
        """Tell whether bending the rays as a flat port in water does explains rows that do not
        agree without it.
        """
        bent_px = self.index_unexplained_px
        in_water = LIMITS.water_index[0] <= self.index <= LIMITS.water_index[1]
        return (
            in_water
            and not self.rectified_already
            and self._explains(bent_px)
            and bent_px <= self.enlargement.unexplained_px
            and not self.causes.is_simple
        )

    @property
    def cut_out(self) -> bool:
        """True if images cut out of those that were calibrated, and enlarged to their size, explain
        rows that do not agree.
        """
        left_px = self.enlargement.unexplained_px
        return (
            self._explains(left_px)
            and not self.causes.is_simple
            and not (self.air_in_water or self.rectified_already)
        )

    def _explains(self, left_px: float) -> bool:
        gain_px = self.unexplained_px - left_px
        return left_px < LIMITS.air_ratio * self.unexplained_px and gain_px > LIMITS.air_gain_px

    @property
    def advice(self) -> tuple[str, ...]:
        """What to do, one line each, the most severe first."""
        if self.refusal or self.mistake:
            return (self.refusal or self.mistake,)
        if self.change:
            return (self.change,)
        if self.swapped:
            return (
                f"{self.behind_fraction:.0%} of the points lie behind infinity: left and right are "
                "exchanged, the transform between them is the inverse one, or the images are "
                "turned by 180 degrees or mirrored against the calibration; a camera has moved "
                "since, too, so that rows do not tell which",
            )
        advice = []
        if self.air_in_water:
            advice.append(
                f"light bent by a flat port (index {self.index:.2f}) explains the rows, "
                f"{self.index_unexplained_px:.2f} px left instead of {self.unexplained_px:.2f} px: "
                "it looks like a calibration made in air; calibrate in water, or describe the "
                f"port: --set input.flat_port={FLAT_PORT} (lens to window, and its thickness)"
            )
        elif self.cut_out:
            factor = self.enlargement.factor
            in_water = LIMITS.water_index[0] <= factor <= LIMITS.water_index[1]
            air = (
                "; a focal length measured in air looks the same in water: calibrate in water"
                if in_water
                else ""
            )
            advice.append(
                f"images cut out of the calibrated ones and enlarged about {factor:.2f} times, to "
                f"their size, explain the rows, {self.enlargement.unexplained_px:.2f} px left "
                f"instead of {self.unexplained_px:.2f} px: ranges would be {1 / factor:.2f} of the "
                "true ones; give the whole images, or a calibration of this (or of the stabilized) "
                f"mode{air}"
            )
        else:
            advice += [self._explanation] if self._is_to_explain else []
        advice += [self.motion.between] if self.motion.between_px else []
        advice += [self.odd] if self.odd else []
        return tuple(advice)

    def lines(self) -> list[str]:
        """The report line by line, the verdict last."""
        verdict = "acceptable" if self.acceptable else "NOT acceptable"
        rows_alone = not (self.acceptable or self.ranges_are_wrong or self.odd)
        only = ": rows alone; ranges are off by less than 2 %"
        return [
            f"{self.matches} points in {counted(self.pairs, 'pair')}: vertical disparity "
            f"{self.row_error_px:.2f} px (median); offset {self.offset_px:+.2f} px, vertical scale "
            f"{self.scale - 1:+.3%}, roll {self.roll_deg:+.3f} degrees leave "
            f"{self.unexplained_px:.2f} px",
            *(
                []
                if self.motion is NO_MOTION
                or self.motion.between_px
                or self.mistake
                or self.refusal
                or self.change
                else [self.motion.line]
            ),
            *self.advice,
            f"the calibration is {verdict} for these images (limit {LIMITS.acceptable_px} px)"
            f"{only if rows_alone else ''}{self._mended}",
        ]

    @property
    def _mended(self) -> str:
        """That refining mends the rows, where it does, and does not only hide another cause."""
        refines = self.has_moved and self.unexplained_px <= LIMITS.acceptable_px
        if self.acceptable or not refines or self.causes.is_wrong_if_refined:
            return ""
        return (
            f"; refined on the dive, it would leave about {self.unexplained_px:.2f} px: "
            "stereo-seecolor run --refine, or check --refine FILE"
        )

    @property
    def _is_to_explain(self) -> bool:
        return bool(self.row_error_px > LIMITS.acceptable_px or self.causes.line)

    @property
    def _explanation(self) -> str:
        """What does not fit, by how much, and what explains it."""
        movement = (
            f"offset {self.offset_px:+.2f} px, vertical scale {self.scale - 1:+.3%}, roll "
            f"{self.roll_deg:+.3f} degrees"
        )
        if self.row_error_px <= LIMITS.acceptable_px:
            what = "rows that agree to a quarter of a pixel contradict the calibration all the same"
            if self.motion.is_found:
                what = "neighboring pairs contradict the calibration"
        elif self._is_drift:
            what = f"a vertical disparity of {self.row_error_px:.2f} px, as after {movement}"
        else:
            what = (
                f"a vertical disparity of {self.row_error_px:.2f} px, of which {movement} leave "
                f"{self.unexplained_px:.2f} px"
            )
        if self.no_rig:
            return (
                f"{what}: the pairs differ among themselves by {self.between_pairs_px:.1f} px, as "
                "pictures of one moving camera do, and pairs that are not of one moment"
            )
        if self.causes is NOT_TESTED and self._is_drift:
            return f"{what}: {MOVED}"
        return (
            f"{what}: {self.causes.line}"
            if self.causes.line
            else f"{what}: no movement, lens or mode explains it: pairs that are not of one "
            "moment, moving things, or images too noisy or blurred to be matched"
        )


# A quick look at one pair, an eighth of the time of a full check: whether its rows agree, and how
# far away its points are.

Array = NDArray[np.float64]
MIN_MATCHES = 50  # fewer do not reach the corners of the image, where roll and scale show
BEHIND_PX = -0.5  # disparity of a point behind infinity: beyond the noise of matches, about 0.1 px
# images smaller than that at a third of their size show too few features there
LEAST_PIXELS = 1.6e5
STRAY_PX = 1.0  # a row that much off the median is not a match of the same point


@dataclass(frozen=True, eq=False)
class QuickCheck:
    """The outcome of a quick look. rows_agree: to a quarter of a pixel, and left is left; False
    also if too little matches to tell.

    keystone: True if there may be one that stands for wrong ranges, which more pairs must tell.
    range_m: (n,) of the points in front of the cameras, along the ray; empty if too little matches
    to tell.
    """

    rows_agree: bool
    keystone: bool
    range_m: Array


def quick_check(rectification: Rectification, images: Images) -> QuickCheck:
    """Look at one raw pair. ``vertical_disparity`` says what is wrong where rows do not agree."""
    pair = rectification.matching_pair
    step_px = min(QUICK.step_px, math.ceil(math.sqrt(math.prod(pair.image_size) / LEAST_PIXELS)))
    found = find_matches(rectification, *images, replace(QUICK, step_px=step_px))
    if len(found.left) < MIN_MATCHES:
        return QuickCheck(False, False, np.zeros(0))
    shift_px, row_px = (found.left - found.right).T
    disparity_px = shift_px - (pair.cx_left_px - pair.cx_right_px)
    apart = np.median(disparity_px) > -BEHIND_PX  # else swapped, or one camera's picture twice
    agree = np.median(np.abs(row_px)) <= LIMITS.acceptable_px and apart
    centered = (
        found.left - [pair.cx_left_px, pair.cy_px],
        found.right - [pair.cx_right_px, pair.cy_px],
    )
    keystone = find_keystone(*centered, np.zeros(len(row_px), np.int64), pair.focal_px)
    in_front = (np.abs(row_px - np.median(row_px)) < STRAY_PX) & (disparity_px > -BEHIND_PX)
    return QuickCheck(
        bool(agree),
        keystone.is_possible,
        _range_m(pair, found.left[in_front], disparity_px[in_front]),
    )


def _range_m(pair: RectifiedPair, left: Array, disparity_px: Array) -> Array:
    slopes = (left - [pair.cx_left_px, pair.cy_px]) / pair.focal_px
    return np.asarray(
        pair.focal_px * pair.baseline_m / disparity_px * np.sqrt(1 + (slopes**2).sum(axis=1))
    )
