"""A calibration that ``inspect`` found, tested on sample pairs of the dive."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration import CalibrationError, Rectification, StereoRig
from calibration.checks import RowCheck
from calibration.rig import for_channels
from calibration.suspicions import suspicions
from calibration.verification.conventions import resolve_convention
from calibration.verification.matches import find_matches
from calibration.verification.mistakes import FoundMistake
from calibration.verification.quick_check import quick_check
from stereo_seecolor.checks.changes import find_change
from stereo_seecolor.checks.range_limits import RangeLimits, range_limits
from stereo_seecolor.checks.rig import judge_rig
from stereo_seecolor.checks.sample import DECIDING_PAIRS, matching_threads
from stereo_seecolor.commands.check import RigFacts, rig_facts
from stereo_seecolor.commands.inspect_dive import Misfit, SampleMeasures, measure, misfits
from stereo_seecolor.commands.inspect_rig import FoundCalibration
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.matching.image_texture import sides_without_texture
from stereo_seecolor.records import StereoFrame, is_monochrome


@dataclass(frozen=True)
class CalibrationFacts:
    """A calibration that was found, tested on the dive. vertical: the right camera is above or
    below the left one.

    rows: vertical disparity on sample pairs, None where too few points were found in both images.
    """

    path: Path
    format: str
    rig: RigFacts
    vertical: bool
    rows: RowCheck | None
    suspicions: tuple[str, ...]


@dataclass(frozen=True)
class Tested:
    """A calibration tested on sample pairs.

    misfits: pairs that do not show one scene. fitting: at least one pair shows one. limits: limits
    of range to be set.
    mistake: the likely mistake where pairs do not fit the calibration.
    """

    facts: CalibrationFacts | None = None
    misfits: tuple[Misfit, ...] = ()
    measured: SampleMeasures | None = None
    fitting: bool = True
    limits: tuple[RangeLimits, ...] = ()
    mistake: FoundMistake | None = None

    @property
    def rows(self) -> RowCheck | None:
        """Vertical disparity on sample pairs; None if both images share too few points."""
        return self.facts.rows if self.facts else None

    @property
    def agrees(self) -> bool:
        """False where sample pairs show that this calibration gives no ranges for these images."""
        return self.fitting and not (self.rows and self.rows.refusal)

    @property
    def exchanged(self) -> bool:
        """True if left and right are to be exchanged."""
        return self.mistake.exchanged if self.mistake else bool(self.rows and self.rows.swapped)


NOTHING_TESTED = Tested()


def tested_calibration(
    calibration: FoundCalibration,
    pairing: Pairing,
    sample: Mapping[Pair, StereoFrame],
    config: RunConfig,
) -> Tested:
    """Test a calibration on sample pairs: one scene, rows, mistakes, limits of range; and measure
    pairs unless it is unusable.
    """
    rig = _settled_rig(calibration.rig, list(sample.values())[:DECIDING_PAIRS])
    wrong = misfits(rig, pairing, sample, config)
    fitting = [pair for pair in sample if pair.name not in {misfit.pair for misfit in wrong}]
    rectification = Rectification.from_rig(rig)
    change = find_change(rectification, pairing.pairs, config.input)
    pairs, fitting = change.shared(pairing.pairs), list(change.shared(fitting))
    frames = [sample[pair] for pair in fitting]
    matches = list(
        matching_threads(rectification.raw_size).each(
            lambda one: find_matches(rectification, one.left, one.right), frames
        )
    )
    judged = judge_rig(rig, matches, pairs, config.input, change)
    judged = judged.with_motion(rig, matches, pairs, config.input)
    rows, mistake = judged.rows, judged.mistake
    ranges_m = [quick_check(rectification, (one.left, one.right)).range_m for one in frames]
    limits = range_limits(np.concatenate([np.zeros(0), *ranges_m]), config.matching)
    x_m, y_m, _ = rig.R.T @ rig.T_right_left[:3, 3]
    vertical = bool(abs(y_m) > abs(x_m))
    facts = CalibrationFacts(
        calibration.path, calibration.format, rig_facts(rig), vertical, rows, suspicions(rig)
    )
    unrelated = rows is None and mistake is None and not all(map(sides_without_texture, frames))
    if not fitting or unrelated or mistake or (rows and (rows.swapped or rows.refusal)):
        return Tested(facts, wrong, fitting=bool(fitting) and not unrelated, mistake=mistake)
    matching = config.matching.model_copy(update={limit.key: limit.fits_m for limit in limits})
    measured = measure(
        rig, fitting, len(pairing.pairs), config.model_copy(update={"matching": matching})
    )
    return Tested(facts, wrong, measured, limits=limits)


def _settled_rig(rig: StereoRig, sample: Sequence[StereoFrame]) -> StereoRig:
    rig = for_channels(rig, is_monochrome(sample[0].left))
    with suppress(CalibrationError):  # too few points to tell: said of the rows
        return resolve_convention(rig, [(frame.left, frame.right) for frame in sample])
    return rig
