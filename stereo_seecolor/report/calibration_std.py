"""The calibration's part of the standard errors of all measures of a run, where it is known from, and what the page says of it."""

import math
from dataclasses import dataclass
from statistics import median
from typing import Literal

from calibration import CalibrationError, StereoRig
from stereo_seecolor.errors import InputError
from stereo_seecolor.measuring.limits import LIMITS
from stereo_seecolor.report.texts import digits, phrase
from stereo_seecolor.run_folder.finished_run import FinishedRun


@dataclass(frozen=True)
class CalibrationStd:
    """Standard errors of a length, relative.

    known_from: the setting measuring.length_error; the calibration itself, as stated_by says; or an assumption. length: by that.
    yaw: by the yaw that the run refined, at range_m; None where it did not, and where the setting says all.
    """

    known_from: Literal["setting", "file", "assumed"]
    length: float
    yaw: float | None
    range_m: float | None
    stated_by: str = ""

    @property
    def total(self) -> float:
        """By both together."""
        return math.hypot(self.length, self.yaw or 0.0)


def calibration_std(run: FinishedRun) -> CalibrationStd:
    """Of a run, at its median range; of a run whose rig cannot be read, an assumption."""
    if run.config.measuring.length_error is not None:
        return CalibrationStd("setting", run.config.measuring.length_error, None, None)
    try:
        rig = run.rig
    except (InputError, CalibrationError, OSError):
        return CalibrationStd("assumed", LIMITS.calibration_std, None, None)
    ranges = [frame.facts["median_range_m"] for frame in run.frames if "median_range_m" in frame.facts]
    range_m = median(ranges) if ranges else None
    yaw = _yaw(rig, range_m)
    if rig.errors is None:
        return CalibrationStd("assumed", LIMITS.calibration_std, yaw, range_m)
    return CalibrationStd("file", rig.errors.length, yaw, range_m, rig.errors.stated_by)


def _yaw(rig: StereoRig, range_m: float | None) -> float | None:
    """Yaw shifts all disparities by focal length times it, and so ranges by range / baseline times it, relative."""
    if rig.refinement is None or range_m is None:
        return None
    std_rad = next((each.std for each in rig.refinement.movements if each.name == "yaw"), None)
    return None if std_rad is None else std_rad * range_m / rig.baseline_m


def calibration_note(known: CalibrationStd) -> str:
    """How large it is, where it is known from, and what of it is the refined yaw."""
    sentences = [phrase("measure.calibration", percent=digits(100 * known.total, 2))]
    if known.yaw is not None and known.range_m is not None:
        sentences.append(phrase("measure.calibration_yaw", percent=digits(100 * known.yaw, 2), range=digits(known.range_m, 3)))
    percent = digits(100 * known.length, 2)
    sentences.append(phrase(f"measure.calibration_{known.known_from}", percent=percent, stated_by=known.stated_by))
    return " ".join(sentences)
