"""What the motion between neighboring pairs shows of a calibration: numbers, verdict, lines."""

from dataclasses import dataclass

import numpy as np

from calibration.errors import counted
from calibration.rig_errors import RangeError


@dataclass(frozen=True)
class MotionLimits:
    """Limits of what is measured and of what is reported.

    least_points, least_couples: fewer tell nothing, or give no standard error. least_move: median
    movement in the image, of its width: less holds too little parallax. most_row_px: rows of a rig
    that has drifted are off by a pixel or two.
    least_disparity_px: less is infinity, or one camera's image on both sides. near_px: points
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


@dataclass(frozen=True)
class Motion:
    """What the motion between couples of pairs tells of the calibration; couples: 0 for too few.

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
    aspect, aspect_std: by how much the focal length across the baseline is longer than calibrated
    if the one along it is right, relative; 0 where it explains nothing.
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
    aspect: float = 0.0
    aspect_std: float = np.inf
    rest_px: float = 0.0
    own_px: float = np.inf
    disparity_px: float = np.nan

    @property
    def is_known(self) -> bool:
        """True if an error of ranges that matters would have been seen."""
        return LIMITS.deviations * self.range_std < LIMITS.seen

    @property
    def measured(self) -> RangeError | None:
        """The error of ranges; None where motion or one number does not describe it."""
        if self.is_misfit or self._is_uneven or not self.is_known:
            return None
        return RangeError(self.range_error, self.range_std, self.at_m)

    @property
    def is_right(self) -> bool:
        """True if ranges are right to 5 %, their standard error included."""
        return abs(self.range_error) + self.range_std < LIMITS.right and not self._is_uneven

    @property
    def _is_uneven(self) -> bool:
        """Whether disparities are wrong by amounts that differ over the image or by pair."""
        return bool(self.rows_px or self.columns_px or self.between_px or self.aspect)

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
                f"rigid bottom: {self.rest_px:.2f} px are left, {self.own_px:.2f} px if each "
                "couple has an error of its own; an offset, a focal length and errors over rows "
                "and columns do not explain it, and the error of ranges is unknown: moving "
                "objects, or pairs that differ: compare a known length"
            )
        if self.between_px:
            return self.between
        if not (self.is_known or self.is_found):
            return (
                "not seen: images shifted along the baseline (a pixel changes ranges by "
                f"{self.pixel_error:.1%} for each meter of range), a focal length wrong in both "
                "cameras, a wrong baseline: rows do not show them, and too few neighboring pairs "
                "show the same bottom: compare a known length by stereo-seecolor measure or markers"
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
        if self.aspect:
            over.append(
                f"the focal length across the baseline changes by {self.aspect:+.0%} +- "
                f"{self.aspect_std:.0%} against that along it"
            )
        figures = "; ".join([*over, *([] if over and not self._is_off else [self.figures])])
        return (
            f"motion between {counted(self.couples, 'couple')} of neighboring pairs: {figures}"
            f"{self._unseen}"
        )

    @property
    def between(self) -> str:
        """What differs from pair to pair, its cause, and what to do; "" where nothing does."""
        if not self.between_px:
            return ""
        error = self.between_px / self.disparity_px
        if not self.between_rows:
            return (
                f"disparities differ from pair to pair by {self.between_px:.1f} px (median) and "
                f"fit no single rig: ranges are wrong by about {error:.0%}, by a different amount "
                "in each pair: images shifted along the baseline from frame to frame "
                "(stabilization of a side), or sides that were not exposed at the same moment: "
                "switch stabilization off, trigger both cameras together"
            )
        rolls = self.rolled_px > LIMITS.explained * self.between_px
        cause = (
            "images that rotate from frame to frame explain it, and rows show this, too "
            f"({self.rolled_px:.1f} px): stabilization, or a loose camera"
            if rolls
            else f"rows show no such roll of a camera ({self.rolled_px:.1f} px): rolling "
            "shutters that read rows in opposite directions, or at different moments, while the "
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
