"""Checks on the first pairs of a dive before a run: whether they fit the calibration, and whether limits of range cut them off."""

from collections.abc import Sequence
from contextlib import suppress

from calibration import CalibrationError
from calibration.checks import RowCheck, vertical_disparity
from calibration.mistakes import likely_mistake, may_be_mistaken
from calibration.quick_look import quick_look
from stereo_seecolor.commands.dive_rig import DECIDING_PAIRS, first_images, spread
from stereo_seecolor.commands.range_limits import range_limits
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.neighbors import constant_shift
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline

LOOKED_AT = 4
"""Pairs, spread over the dive, of which the first with enough matches is checked: a descent may last a quarter of a dive."""


def first_notes(pipeline: Pipeline, pairs: Sequence[Pair]) -> tuple[str, ...]:
    """Notes on rows that disagree by over half a pixel, and on features outside the limits of range, from the first usable pair.

    A quick check is enough for most dives. A full one, with two more pairs, takes longer than matching a pair and is made only
    where rows disagree or may hold a keystone. Raises InputError where no pair can be matched and the likely mistake is known.
    """
    looked_at = spread(pairs, LOOKED_AT)
    with suppress(CalibrationError):  # of pairs that are not as large as calibrated: the run names them
        for pair in looked_at:
            for both in first_images([pair], pipeline.config.input):
                look = quick_look(pipeline.rectification, both)
                if not look.range_m.size:
                    continue
                near = pairs[pairs.index(pair) :]
                if not look.rows_agree:
                    return _rows_note(pipeline, pairs, near)
                limits = range_limits(look.range_m, pipeline.config.matching)
                notes = tuple(f"range: in pair {pair.name}, {limit.note}" for limit in limits)
                return notes + (_rows_note(pipeline, pairs, near, (DECIDING_PAIRS,)) if look.keystone else ())
    return _rows_note(pipeline, pairs, looked_at)


def _rows_note(
    pipeline: Pipeline, pairs: Sequence[Pair], chosen: Sequence[Pair], counts: Sequence[int] = (1, DECIDING_PAIRS)
) -> tuple[str, ...]:
    """The full check of rows. pairs: of the whole dive. chosen: pairs to check, more of ``counts`` where fewer warn."""
    rig, images = pipeline.rig, pipeline.config.input
    check: RowCheck | None = None
    with suppress(CalibrationError):  # too few points to tell
        for most in counts:
            check = vertical_disparity(rig, first_images(chosen, images, most))
            if check.warning is None:
                return ()
    if check is None or may_be_mistaken(check):
        if mistake := likely_mistake(rig, first_images(chosen, images)):
            raise InputError(mistake.line)
        if shift := constant_shift(spread(pairs, DECIDING_PAIRS + 2)[1:-1], pairs, pipeline.rectification, images):
            raise InputError(shift)
    if check is None:
        return ()
    return (f"calibration: {check.warning}" + (" (stereo-seecolor run --refine)" if check.has_moved else ""),)
