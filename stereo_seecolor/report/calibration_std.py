"""The calibration's part in a run's standard errors, its source, and the page's note."""

import math
from dataclasses import dataclass
from statistics import median
from typing import Literal

from calibration import CalibrationError, StereoRig
from calibration.rig_errors import RangeError
from stereo_seecolor.errors import InputError
from stereo_seecolor.report.texts import digits, phrase
from stereo_seecolor.run_folder.finished_run import FinishedRun

ASSUMED_STD = 0.005
"""Of a length, relative, where nothing else is known: what docs/calibration.md calls good."""


@dataclass(frozen=True)
class CalibrationStd:
    """Relative standard errors of a length by the calibration.

    known_from: "file": the calibration, as stated_by says; or "assumed". length: from that source.
    yaw: by the refined yaw, at range_m; None where the run refined none. checked: what the pairs of
    the dive show of the error of ranges, where that counts: beside an assumption, or where it
    certainly contradicts the file.
    """

    known_from: Literal["file", "assumed"]
    length: float
    yaw: float | None
    range_m: float | None
    stated_by: str = ""
    checked: RangeError | None = None

    @property
    def total(self) -> float:
        """All together."""
        return math.hypot(self.length, self.yaw or 0.0, self.checked.rms if self.checked else 0.0)


def calibration_std(run: FinishedRun) -> CalibrationStd:
    """The standard errors of a run, at its median range; assumed ones without its rig."""
    try:
        rig = run.rig
    except (InputError, CalibrationError, OSError):
        return CalibrationStd("assumed", ASSUMED_STD, None, None)
    ranges = [
        frame.facts["median_range_m"] for frame in run.frames if "median_range_m" in frame.facts
    ]
    range_m = median(ranges) if ranges else None
    yaw, checked = _yaw(rig, range_m), run.range_error
    if rig.errors is None:
        return CalibrationStd("assumed", ASSUMED_STD, yaw, range_m, checked=checked)
    errors = rig.errors
    sure = checked if checked and checked.is_sure else None
    return CalibrationStd("file", errors.length, yaw, range_m, errors.stated_by, sure)


def _yaw(rig: StereoRig, range_m: float | None) -> float | None:
    """The relative error by the refined yaw. Yaw shifts disparities by focal length times yaw, and
    so ranges by the fraction range / baseline times yaw.
    """
    if rig.refinement is None or range_m is None:
        return None
    return rig.refinement.std("yaw") * range_m / rig.baseline_m or None


def calibration_note(known: CalibrationStd) -> str:
    """Sentences on the size of the error, its source, and the parts of the refined yaw and of what
    the check of the dive found.
    """
    sentences = [phrase("measure.calibration", percent=digits(100 * known.total, 2))]
    if known.yaw is not None and known.range_m is not None:
        sentences.append(
            phrase(
                "measure.calibration_yaw",
                percent=digits(100 * known.yaw, 2),
                range=digits(known.range_m, 3),
            )
        )
    if known.checked is not None:
        sentences.append(
            phrase(
                "measure.calibration_checked",
                error=f"{100 * known.checked.error:+.1f}",
                std=digits(100 * known.checked.std, 2),
                range=digits(known.checked.at_m, 3),
            )
        )
    percent = digits(100 * known.length, 2)
    sentences.append(
        phrase(
            f"measure.calibration_{known.known_from}", percent=percent, stated_by=known.stated_by
        )
    )
    return " ".join(sentences)
