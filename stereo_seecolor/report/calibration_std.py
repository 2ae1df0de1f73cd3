"""The part of the calibration in the standard errors of a run's measurements, its source, and the
page's note on it.
"""

import math
from dataclasses import dataclass
from statistics import median
from typing import Literal

from calibration import CalibrationError, StereoRig
from calibration.rig_errors import RangeError
from stereo_seecolor.errors import InputError
from stereo_seecolor.report.texts import digits, phrase
from stereo_seecolor.run_folder.finished_run import FinishedRun


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
    """The standard errors of a run, at its median range; assumed ones where its rig cannot be
    read.
    """
    try:
        rig = run.rig
    except (InputError, CalibrationError, OSError):
        return CalibrationStd("assumed", LIMITS.calibration_std, None, None)
    ranges = [
        frame.facts["median_range_m"] for frame in run.frames if "median_range_m" in frame.facts
    ]
    range_m = median(ranges) if ranges else None
    yaw, checked = _yaw(rig, range_m), run.range_error
    if rig.errors is None:
        return CalibrationStd("assumed", LIMITS.calibration_std, yaw, range_m, checked=checked)
    errors = rig.errors
    sure = checked if checked and checked.is_sure else None
    return CalibrationStd("file", errors.length, yaw, range_m, errors.stated_by, sure)


def _yaw(rig: StereoRig, range_m: float | None) -> float | None:
    """The relative error by the refined yaw. Yaw shifts disparities by focal length times yaw, and
    so ranges by the fraction range / baseline times yaw.
    """
    if rig.refinement is None or range_m is None:
        return None
    std_rad = next((each.std for each in rig.refinement.movements if each.name == "yaw"), None)
    return None if std_rad is None else std_rad * range_m / rig.baseline_m


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


# Limits and thresholds of measurements on a frame; web/src/measure.ts has the same numbers.


@dataclass(frozen=True)
class MeasureLimits:
    """Windows, layers and errors."""

    half_window_px: int = 3  # 7x7: more is no more exact where a reef is rough, less is noisy
    least_pixels: int = 10  # a fifth of the window: an object's edge shows at least that
    # relative step in depth between object and background; slopes are steadier
    layer_gap: float = 0.02
    layer_gap_stds: float = 6.0  # no step is smaller than the noise
    # what the error of a pixel's range and the misfit of the plane around add to the standard error
    # of a point, and that adds to the one of its slope, a pixel (picking.py): as
    # benchmarks/standard_errors.py finds them on drawn reefs
    of_range: float = 0.4
    of_misfit: float = 0.4
    slope_of_misfit: float = 0.131
    # the part of an area by errors of slopes, which is taken off it, is known to this
    of_slopes: float = 0.15
    of_step: float = 0.16  # of the steps along a line, in its standard error
    click_std_px: float = 0.5  # how well a person hits a point
    # of a length, relative, where nothing else is known: what docs/calibration.md calls good
    calibration_std: float = 0.005
    least_step_px: int = 8  # along a line: windows that overlap little
    # a step along the surface is longer than its noise, which would lengthen it
    step_stds: float = 6.0
    area_step_px: int = 4  # a node of the area every fourth pixel


LIMITS = MeasureLimits()
