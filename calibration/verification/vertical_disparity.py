"""Vertical disparity of a dive's matched points: what it says of a calibration, and its causes."""

from dataclasses import dataclass

from calibration.errors import counted
from calibration.rig_errors import RangeError
from calibration.verification.explanations import NOT_TESTED, Causes
from calibration.verification.mistake_table import GIVE_RECTIFIED, RECTIFIED
from calibration.verification.motion_result import NO_MOTION, Motion
from calibration.verification.table import CUT_OUT, IN_AIR, MOVED, OTHER, STRETCHED


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
MIN_MATCHES = 50
"""Fewer do not reach the corners of the image, where roll and scale show."""
BEHIND_PX = -0.5
"""Disparity of a point behind infinity: beyond the noise of matches, about 0.1 px."""


@dataclass(frozen=True, eq=False)
class RowCheck:
    """Vertical disparity in images of a dive.

    pairs, matches: what it rests on. row_error_px: median absolute value. offset_px, scale,
    roll_deg: the vertical offset, vertical scale (1 = none) and rotation of the right image that
    explain the most of it; unexplained_px: the median that these leave. behind_fraction: of the
    matches, those with impossible disparity (points behind infinity).
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
    mistake: str = ""
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
        return self._agree and not self.ranges_are_wrong and not self.odd

    @property
    def _agree(self) -> bool:
        return self.row_error_px <= LIMITS.acceptable_px

    @property
    def ranges_are_wrong(self) -> bool:
        """True if a cause that explains rows and motion makes ranges wrong, the motion contradicts
        them without it, left is not left, pairs differ, or rows are off by so much that ranges are.
        """
        return bool(
            self.swapped
            or self.causes.is_wrong
            or self._left.is_found
            or self._between
            or self.refusal
            or self.mistake
            or self.change
            or self.row_error_px > LIMITS.row_fraction * abs(self.disparity_px)
        )

    @property
    def swapped(self) -> bool:
        """Tell whether nearly all points lie behind infinity."""
        return self.behind_fraction > LIMITS.swapped_fraction

    @property
    def one_picture(self) -> bool:
        """Whether points lie at the same places of both images, as in one image given twice."""
        return self.apart_px < LIMITS.apart_px

    @property
    def no_rig(self) -> bool:
        """Whether pairs contradict each other, as those of one moving camera do."""
        return self.between_pairs_px > max(LIMITS.between_px, LIMITS.clear * self.row_error_px)

    @property
    def refusal(self) -> str:
        """Why ranges cannot be had from these images, and what to do; "" where they may be."""
        if self.one_picture:
            return (
                f"both sides show one camera's image: points lie {self.apart_px:.1f} px apart in "
                "the images (median): give the other camera's images on one of the sides"
            )
        if self.rectified_already:
            return (
                f"{RECTIFIED}: without rectification rows agree to {self.unrectified_px:.2f} px, "
                f"after rectification by this calibration to {self.row_error_px:.2f} px: "
                f"{GIVE_RECTIFIED}"
            )
        return ""

    @property
    def rectified_already(self) -> bool:
        """Tell whether rows agree in the images as they are, and neither after rectification nor
        after a movement of a camera.

        A rig without distortion that has moved a little may come to the same; refined, it is right.
        """
        explained_px = min(self.row_error_px, self.unexplained_px)
        as_they_are = self.unrectified_px <= min(
            LIMITS.acceptable_px, LIMITS.rectified_ratio * explained_px
        )
        return as_they_are and not self._agree

    @property
    def has_moved(self) -> bool:
        """True if rows disagree as after a movement of a camera, which refining can find."""
        turned = self.causes.is_wrong and self.causes.has_moved
        drifted = (self._is_drift and not self._agree) or turned
        otherwise = (
            self.swapped
            or self.air_in_water
            or self.cut_out
            or self.is_lens
            or self.refusal
            or self.no_rig
            or self.change
        )
        return drifted and not (otherwise or self.mistake)

    @property
    def is_lens(self) -> bool:
        """Tell whether ranges are wrong by what may be another distortion of the lenses."""
        return self.causes.may_be_lens

    @property
    def _is_drift(self) -> bool:
        explained = self.unexplained_px <= LIMITS.moved_ratio * self.row_error_px
        return explained and self.row_error_px < LIMITS.drift_px and not self.no_rig

    @property
    def air_in_water(self) -> bool:
        """Whether rays bent as by a flat port in water explain rows that disagree."""
        return self.causes.is_(IN_AIR) and not self._agree

    @property
    def cut_out(self) -> bool:
        """True if images cut out of those that were calibrated, and enlarged to their size or
        stretched, explain rows that do not agree.
        """
        return self.causes.is_(CUT_OUT, *STRETCHED) and not self._agree

    @property
    def _left(self) -> Motion:
        """What the motion shows, with the cause undone that explains all."""
        causes = self.causes
        return causes.motion if causes.explains and causes.motion.couples else self.motion

    @property
    def _between(self) -> str:
        """What differs between pairs in the motion, and does so without the cause found."""
        return "" if self.causes.explains_motion else self.motion.between

    @property
    def advice(self) -> tuple[str, ...]:
        """What to do, one line each, the most severe first."""
        if self.refusal or self.mistake:
            return (self.refusal or self.mistake,)
        if self.change:
            return (self.change,)
        if self.swapped:
            return (
                f"{self.behind_fraction:.0%} of the points lie behind the cameras: left and right "
                "are exchanged, the transform between them is the inverse one, or the images are "
                "rotated by 180 degrees or mirrored relative to the calibration; a camera has also "
                "moved since, so rows do not show which",
            )
        advice = []
        found = self.causes.is_wrong or self._left.is_found
        is_all = self._agree and self._between and not self.causes.line
        if not is_all and (not self._agree or found or (self.causes.line and self.motion.is_found)):
            advice.append(self._explanation)
        advice += [one for one in (self._between, self.odd) if one]
        return tuple(advice)

    def lines(self) -> list[str]:
        """The report line by line, the verdict last."""
        verdict = "acceptable" if self.acceptable else "NOT acceptable"
        rows_alone = not (self.acceptable or self.ranges_are_wrong or self.odd)
        only = ": rows alone; no cause that was found changes ranges by 2 %"
        return [
            f"{self.matches} points in {counted(self.pairs, 'pair')}: vertical disparity "
            f"{self.row_error_px:.2f} px (median); {self._movement} leave "
            f"{self.unexplained_px:.2f} px",
            *(
                []
                if self.motion is NO_MOTION
                or self._between
                or self.mistake
                or self.refusal
                or self.change
                or (self._contradiction and not self.causes.line)
                or self._is_unexplained
                else [self._of_motion]
            ),
            *self.advice,
            f"the calibration is {verdict} for these images (limit {LIMITS.acceptable_px} px)"
            f"{only if rows_alone else ''}{self._mended}",
        ]

    @property
    def measured(self) -> RangeError | None:
        """The error of ranges at the median disparity; None where none is known."""
        best = self.causes.best
        if best and best.is_wrong and self.causes.explains_motion:
            return RangeError(best.range_error, best.range_std, self.motion.at_m)
        return self._left.measured

    @property
    def _of_motion(self) -> str:
        """What the motion tells by itself, where the cause that was found says the same."""
        if self.causes.explains_motion and not self.causes.agrees_with(self.motion):
            return (
                f"motion between {counted(self.motion.couples, 'couple')} of neighboring pairs "
                "fits a rigid bottom once the fault that is named below is undone"
            )
        return self.motion.line

    @property
    def _is_unexplained(self) -> bool:
        """Tell whether no one cause explains all of the dive, which its line says: what the motion
        gives as one error of ranges is then not that error.
        """
        return bool(self.causes.best and self.causes.line and not self.causes.explains)

    @property
    def _mended(self) -> str:
        """That refining mends the rows, where it does, and does not only hide another cause."""
        refines = self.has_moved and self.unexplained_px <= LIMITS.acceptable_px
        hides = self.causes.is_wrong_if_refined or self._left.is_found
        if self.acceptable or not refines or hides:
            return ""
        return (
            f"; refined on the dive, it would leave about {self.unexplained_px:.2f} px: "
            "stereo-seecolor run --refine, or check --refine FILE"
        )

    @property
    def _movement(self) -> str:
        return (
            f"offset {self.offset_px:+.2f} px, vertical scale {self.scale - 1:+.3%}, roll "
            f"{self.roll_deg:+.3f} degrees"
        )

    @property
    def _explanation(self) -> str:
        """What does not fit, by how much, and what explains it."""
        if self._agree:
            what = "rows agree to a quarter of a pixel, but contradict the calibration"
            if self.motion.is_found:
                what = "neighboring pairs contradict the calibration"
        elif self._is_drift:
            what = f"a vertical disparity of {self.row_error_px:.2f} px, as after {self._movement}"
        else:
            what = (
                f"a vertical disparity of {self.row_error_px:.2f} px, of which {self._movement} "
                f"leave {self.unexplained_px:.2f} px"
            )
        if self.no_rig:
            return (
                f"{what}: the pairs differ among themselves by {self.between_pairs_px:.1f} px, as "
                "do images of one moving camera, and pairs not exposed at the same moment"
            )
        if self.causes is NOT_TESTED and self._is_drift:
            return f"{what}: {MOVED}"
        if self.causes.line:
            beside = f"; beside it, {self._contradiction}" if self._contradiction else ""
            return f"{what}: {self.causes.line}{beside}"
        if self._contradiction:
            return f"{what}: {self._contradiction}"
        return (
            f"{what}: no movement, lens or mode explains it: pairs not exposed at the same "
            "moment, moving objects, or images too noisy or blurred to be matched"
        )

    @property
    def _contradiction(self) -> str:
        """What the motion shows that the best cause leaves, and what to do; "" where nothing, or
        where it differs from pair to pair, which is a line of its own.
        """
        left = self._left
        if not left.is_found or left.between_px or self._is_unexplained:
            return ""
        return f"{left.line}; more than one cause would explain it, or none: {OTHER}"
