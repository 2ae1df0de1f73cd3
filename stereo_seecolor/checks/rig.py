"""The calibration against pairs spread over a dive, before a run; and its limits of range."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration import CalibrationError
from calibration.checks import RowCheck, vertical_disparity
from calibration.field_checks.hypotheses import likely_hypothesis, may_be_wrong
from calibration.field_checks.motion import Motion, find_motion
from calibration.field_checks.vertical_disparity import quick_check
from calibration.rig import RangeError
from stereo_seecolor.checks.changes import DiveChange
from stereo_seecolor.checks.sample import (
    DECIDING_PAIRS,
    evenly_spaced,
    first_images,
    neighbors,
    readable,
)
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline

LOOKED_AT = 4
"""Pairs, spread over the dive, that have a quick look: a descent may last a quarter of a dive, and
a camera may be knocked.
"""


@dataclass(frozen=True)
class RigCheck:
    """What the check of a dive's rig found. is_wrong: ranges are wrong, as the notes say. ranges:
    what it measured of their error, None where it could not.
    """

    notes: tuple[str, ...] = ()
    is_wrong: bool = False
    ranges: RangeError | None = None

    def after(self, notes: tuple[str, ...]) -> "RigCheck":
        """This check, after these notes."""
        return replace(self, notes=(*notes, *self.notes))


def check_rig(pipeline: Pipeline, pairs: Sequence[Pair], change: DiveChange) -> RigCheck:
    """Check rows as ``check`` does, and features against the limits of range, on pairs spread over
    the dive.

    A quick look is enough for most dives. A full check takes longer than matching a pair and is
    made only where rows of a pair disagree or may hold a keystone. change: what changes from pair
    to pair. Raises InputError where no pair can be matched and the likely mistake is known.
    """
    pairs = change.shared(pairs)
    said = (f"calibration: {change.line}",) if change.line else ()
    # of pairs that are not as large as calibrated: the run names them
    with suppress(CalibrationError):
        seen = readable(evenly_spaced(pairs, LOOKED_AT), pipeline.config.input)
        looks = [(pair, quick_check(pipeline.rectification, both)) for pair, both in seen]
        looks = [(pair, look) for pair, look in looks if look.range_m.size]
        if change.is_rigid and looks and all(look.rows_agree for _, look in looks):
            pair, first = looks[0]
            limits = range_limits(first.range_m, pipeline.config.matching)
            said = (*(f"range: in pair {pair.name}, {limit.note}" for limit in limits), *said)
            if not any(look.keystone for _, look in looks):
                return _motion_check(pipeline, pairs).after(said)
    if not change.is_rigid:  # no one number describes pairs that differ
        return RigCheck(said, is_wrong=True)
    return _rows_check(pipeline, pairs).after(said)


def _motion_check(pipeline: Pipeline, pairs: Sequence[Pair]) -> RigCheck:
    """What the motion shows and rows do not; of a refined rig, which rows were made to fit, also
    that it shows nothing.
    """
    starts = list(neighbors(pairs, pipeline.config.input))
    from_ends = [*starts[::2], *starts[1::2]]  # first, middle and last, then what lies between
    motion = find_motion(pipeline.rectification, from_ends, until_right=True)
    ranges = motion.measured
    if motion.is_found:
        return RigCheck((f"calibration: {motion.advice}",), is_wrong=True, ranges=ranges)
    unseen = motion.is_misfit or (pipeline.config.input.refine and not motion.is_known)
    return RigCheck((f"calibration: {motion.line}",) if unseen else (), ranges=ranges)


def _motion(pipeline: Pipeline, pairs: Sequence[Pair]) -> Motion:
    return find_motion(pipeline.rectification, neighbors(pairs, pipeline.config.input))


def _rows_check(pipeline: Pipeline, pairs: Sequence[Pair]) -> RigCheck:
    """What ``check`` says of the rows of pairs spread over the dive."""
    rig, images = pipeline.rig, pipeline.config.input
    chosen = evenly_spaced(pairs, LOOKED_AT)
    check: RowCheck | None = None
    with suppress(CalibrationError):  # too few points to tell
        check = vertical_disparity(rig, first_images(chosen, images, LOOKED_AT))
    if check and check.refusal:
        raise InputError(check.refusal)
    if check is None or may_be_wrong(check):
        if mistake := likely_hypothesis(rig, first_images(chosen, images)):
            raise InputError(mistake.line)
        from stereo_seecolor.checks.neighbors import constant_shift  # hardly ever needed

        if shift := constant_shift(
            evenly_spaced(pairs, DECIDING_PAIRS + 2)[1:-1], pairs, pipeline.rectification, images
        ):
            raise InputError(shift)
    if check is None:
        return RigCheck()
    with suppress(CalibrationError):
        check = replace(check, motion=_motion(pipeline, pairs))
    ranges = check.motion.measured
    if check.acceptable:
        return RigCheck(ranges=ranges)
    return RigCheck(
        (
            f"calibration: {'; '.join(check.advice)}"
            + (" (stereo-seecolor run --refine)" if check.has_moved else ""),
        ),
        is_wrong=check.ranges_are_wrong or check.cut_out or check.air_in_water,
        ranges=ranges,
    )


# The limits of range in the settings against features of a dive: reefs lie within 20 m, streets
# and cliffs do not.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RangeConstants:
    """Constants of the check.

    lost: fraction of features outside a limit above which the limit is reported; on reefs 0 to 0.01
    are, by mismatches.
    ends: percentiles of range taken for the nearest and the farthest point, which leave out
    mismatches.
    margin: factor between these and the proposed limits.
    """

    lost: float = 0.05
    ends: tuple[float, float] = (1.0, 95.0)
    margin: float = 1.3


CONSTANTS = RangeConstants()


@dataclass(frozen=True)
class RangeLimits:
    """A limit of range that cuts off features of a dive. key: its setting in ``matching``. now_m:
    its value. fits_m: one that fits.

    lost: fraction of the features outside it.
    """

    key: str
    now_m: float
    fits_m: float
    lost: float

    @property
    def option(self) -> str:
        """The proposed setting, as --set takes it."""
        return f"matching.{self.key}={self.fits_m:g}"

    @property
    def note(self) -> str:
        """A line on what is lost, and what to do."""
        side = "beyond" if self.fits_m > self.now_m else "nearer than"
        limit = f"matching.{self.key} ({self.now_m:g} m)"
        return (
            f"{self.lost:.0%} of the features lie {side} {limit} and get no range: --set "
            f"{self.option}"
        )


def range_limits(range_m: Array, config: MatchingConfig) -> tuple[RangeLimits, ...]:
    """The limits that too many features lie outside of. range_m: (n,) ranges of features,
    meters.
    """
    if range_m.size == 0:
        return ()
    near_m, far_m = np.percentile(range_m, CONSTANTS.ends)
    near = RangeLimits(
        "min_range_m",
        config.min_range_m,
        _rounded(near_m / CONSTANTS.margin, np.floor),
        float((range_m < config.min_range_m).mean()),
    )
    far = RangeLimits(
        "max_range_m",
        config.max_range_m,
        _rounded(far_m * CONSTANTS.margin, np.ceil),
        float((range_m > config.max_range_m).mean()),
    )
    return tuple(limit for limit in (near, far) if limit.lost > CONSTANTS.lost)


def _rounded(value_m: float, towards: np.ufunc) -> float:
    """A length rounded to one digit, down or up: ``towards`` is np.floor or np.ceil."""
    unit_m = 10 ** np.floor(np.log10(value_m))
    return float(f"{towards(value_m / unit_m) * unit_m:.1g}")
