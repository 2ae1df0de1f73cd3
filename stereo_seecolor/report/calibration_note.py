"""What the page says, where it measures, of the calibration's part of standard errors."""

from calibration import CalibrationError
from stereo_seecolor.errors import InputError
from stereo_seecolor.measuring.limits import LIMITS
from stereo_seecolor.report.dive_facts import DiveFacts
from stereo_seecolor.report.numbers import digits
from stereo_seecolor.report.texts import Texts
from stereo_seecolor.run_folder.finished_run import FinishedRun


def calibration_note(facts: DiveFacts, texts: Texts) -> str:
    """That it is assumed; and, where the run refined its rig with yaw, what the standard error of yaw makes of a typical range."""
    said = texts("measure.calibration", percent=digits(100 * LIMITS.calibration_std, 2))
    std_rad, range_m, geometry = _yaw_std_rad(facts.run), facts.typical("median_range_m"), facts.run.geometry
    if std_rad is None or range_m is None or geometry is None:
        return said
    relative = std_rad * range_m / geometry.baseline_m  # of a range: yaw shifts all disparities by as much as focal length times it
    return f"{said} {texts('measure.calibration_yaw', percent=digits(100 * relative, 2), range=digits(range_m, 3))}"


def _yaw_std_rad(run: FinishedRun) -> float | None:
    """None where the rig was not refined, or not in yaw."""
    try:
        refinement = run.rig.refinement
    except (InputError, CalibrationError, OSError):
        return None
    return next((each.std for each in refinement.movements if each.name == "yaw"), None) if refinement else None
