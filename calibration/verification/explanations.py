"""What explains the evidence about a rig: causes with their amounts, what they do to ranges, and
the lines that a user reads.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.rig import StereoRig
from calibration.verification.motion_result import NO_MOTION, Motion
from calibration.verification.table import LENSES, MOVED, Cause

ENOUGH = 3.0
"""Squared standard errors for each number of the evidence that a good explanation may leave."""
RANGE_ERROR, DEVIATIONS = 0.02, 2.0
"""Ranges are wrong where they are by more than both."""


@dataclass(frozen=True)
class Explanation:
    """Causes that explain the evidence together. text: with their amounts.

    misfit: squared standard errors that they leave. range_error, range_std:
    of ranges, median over the image, relative, with the offset that a usual lens model leaves and
    what the motion contradicts. is_wrong: ranges are off by more than 2 % and two standard errors
    of the amounts.
    edge_error: the largest over the image (95 of 100 points).
    """

    text: str
    causes: tuple[Cause, ...]
    misfit: float
    range_error: float = 0.0
    range_std: float = 0.0
    edge_error: float = 0.0
    is_wrong: bool = False

    @property
    def is_movement(self) -> bool:
        """Tell whether it is a movement of a camera alone, which refining finds."""
        return bool(self.causes) and all(cause.cure == MOVED for cause in self.causes)

    @property
    def ranges(self) -> str:
        """What it does to ranges."""
        if not self.is_wrong and abs(self.range_error) <= RANGE_ERROR:
            return "this changes ranges by less than 2 %, or two standard errors"
        sure = "" if self.is_wrong else ", within two standard errors"
        return (
            f"ranges may be off by {100 * self.range_error:+.0f} +- {100 * self.range_std:.0f} %, "
            f"by up to {100 * self.edge_error:.0f} % over the image{sure}"
        )


@dataclass(frozen=True)
class Causes:
    """best: what explains the evidence by the fewest causes; rivals: others as few that explain it
    as well. numbers: of the evidence, 0 where it was not tested. left: what the best leaves of the
    rows, most over the image, and of the motion, relative to the median disparity.

    motion: between neighboring pairs, with the best undone; NO_MOTION where none was given. rig:
    with the best undone, None where it was not tested. parts: what explains the beginning and the
    end of a dive where nothing explains all of it, or its ends contradict what does; None where
    nothing does.
    """

    best: Explanation | None = None
    rivals: tuple[Explanation, ...] = ()
    numbers: int = 0
    left: float = 0.0
    motion: Motion = NO_MOTION
    rig: StereoRig | None = None
    parts: tuple[Explanation, Explanation] | None = None

    @property
    def explains(self) -> bool:
        """Tell whether the best leaves no more than chance does, over all of the dive."""
        fits = self.best is not None and self.best.misfit <= ENOUGH * self.numbers
        return fits and not self.parts

    @property
    def rig_of_one(self) -> StereoRig | None:
        """The rig that one cause makes which explains all. Several, each of any amount, can imitate
        a mistake with the file, which has no amount to choose.
        """
        return self.rig if self.explains and self.best and len(self.best.causes) == 1 else None

    def in_parts(self, before: "Causes", after: "Causes") -> "Causes":
        """Add what explains the beginning and the end of the dive, if nothing explains both."""
        if not (before.best and after.best and before.explains and after.explains):
            return self
        ends = [{frozenset(one.causes) for one in end._all} for end in (before, after)]
        return self if ends[0] & ends[1] else replace(self, parts=(before.best, after.best))

    @property
    def explains_motion(self) -> bool:
        """Tell whether there is a cause that explains the motion with all else."""
        named = self.explains and self.best is not None and self.best.text
        return bool(named and self.motion.couples) and not (
            self.motion.between_px or self.motion.is_misfit
        )

    @property
    def is_wrong(self) -> bool:
        """Tell whether ranges are wrong by the best explanation, or by one as good, or may be by
        what no cause explains.
        """
        unknown = self.best is not None and not self.explains and self.left > RANGE_ERROR
        return bool(self._wrong) or unknown or any(one.is_wrong for one in self.parts or ())

    @property
    def _wrong(self) -> list[Explanation]:
        return [one for one in self._all if one.is_wrong]

    @property
    def _all(self) -> list[Explanation]:
        return [one for one in (self.best, *self.rivals) if one]

    @property
    def has_moved(self) -> bool:
        """Tell whether the best is a movement of a camera alone, which refining finds."""
        return self.best is not None and self.best.is_movement

    @property
    def is_wrong_if_refined(self) -> bool:
        """Tell whether ranges are wrong by the best, or by one as good, and refining, which takes
        all for a movement of a camera, would hide it.
        """
        return not all(one.is_movement for one in self._wrong)

    @property
    def may_be_lens(self) -> bool:
        """Tell whether ranges are wrong by what may be another distortion of a lens."""
        return any(set(one.causes) & set(LENSES) for one in self._wrong)

    def is_(self, *causes: Cause) -> bool:
        """Tell whether these causes alone, or some of them, explain all, as the best."""
        found = self.best.causes if self.explains and self.best else ()
        return bool(found) and set(found) <= set(causes)

    def agrees_with(self, motion: Motion) -> bool:
        """Tell whether the best says of ranges what the motion alone says."""
        if self.best is None or motion.measured is None:
            return False
        std = float(np.hypot(self.best.range_std, motion.range_std))
        return abs(self.best.range_error - motion.range_error) < DEVIATIONS * std

    @property
    def line(self) -> str:
        """The best and the rivals that say otherwise of ranges, what they do to these, and what to
        do; what is left where none explains all; "" where nothing is to be explained.
        """
        if self.best is None or not (self.best.text or not self.explains):
            return ""
        if not self.explains:
            if self.parts:
                before, after = (
                    f"{one.text or 'nothing is wrong'}{f': {one.ranges}' * bool(one.text)}"
                    for one in self.parts
                )
                return (
                    "no single cause explains all pairs, but one explains their beginning "
                    f"({before}) and another their end ({after}): zoom, focus, crop or mode "
                    "changed in the dive: process both parts separately, each with its own "
                    "calibration"
                )
            times = float(np.sqrt(self.best.misfit / self.numbers))
            return (
                "no cause that was tested explains it: the best one leaves "
                f"{times:.1f} times the errors of points and usual lens models; the error of "
                "ranges is unknown: several faults at once, moving objects, or pairs not exposed "
                "at the same moment: calibrate again, and compare a known length"
            )
        # of rivals that leave ranges right one is enough, and none where the best does as well
        harmless = [one for one in self._all if not one.is_wrong][:1]
        named = [one for one in self.rivals if one.is_wrong or one in harmless]
        rivals = "".join(f"; as likely: {one.text}: {one.ranges}" for one in named)
        cures = dict.fromkeys(cause.cure for one in (self.best, *named) for cause in one.causes)
        return f"{self.best.text}: {self.best.ranges}{rivals}: {'; '.join(cures)}"


NOT_TESTED = Causes()
