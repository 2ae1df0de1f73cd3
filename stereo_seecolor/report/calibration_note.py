"""What the page says, where it measures, of the calibration's part of standard errors."""

from stereo_seecolor.report.calibration_std import CalibrationStd
from stereo_seecolor.report.numbers import digits
from stereo_seecolor.report.texts import Texts


def calibration_note(known: CalibrationStd, texts: Texts) -> str:
    """How large it is, where it is known from, and what of it is the refined yaw."""
    said = [texts("measure.calibration", percent=digits(100 * known.total, 2))]
    if known.yaw is not None and known.range_m is not None:
        said.append(texts("measure.calibration_yaw", percent=digits(100 * known.yaw, 2), range=digits(known.range_m, 3)))
    percent = digits(100 * known.length, 2)
    said.append(texts(f"measure.calibration_{known.known_from}", percent=percent, stated_by=known.stated_by))
    return " ".join(said)
