"""A new calibration, and one tested against a dive, as text for a person."""

from typing import TYPE_CHECKING

from stereo_seecolor.cli.console import lines

if TYPE_CHECKING:
    from stereo_seecolor.commands.calibrate import CalibrationResult
    from stereo_seecolor.commands.check import CheckResult, RigFacts


def calibration_text(result: "CalibrationResult") -> str:
    """A new calibration and its quality."""
    return lines(
        *result.report.lines(),
        f"  {result.calibration}: the calibration",
        f"  {result.coverage}: where in the images the corners lay",
    )


def check_text(result: "CheckResult") -> str:
    """A calibration against a dive."""
    suspicious = (f"suspicious: {text}" for text in result.suspicions)
    said = [*_rig_lines(result.rig), *suspicious, *result.rows.lines()]
    if result.refined is not None:
        said += [*result.refined.lines(), f"  {result.refined_file}: the refined calibration"]
    return lines(*said)


def _rig_lines(rig: "RigFacts") -> list[str]:
    width, height = rig.image_size
    said = [
        f"{rig.camera_model} cameras of {width}x{height} px, baseline {rig.baseline_m * 1000:.1f} mm, calibrated in {rig.medium}",
        f"rectified: focal length {rig.focal_px:.1f} px, {rig.field_deg:.0f} degrees across; a point at 1 m has a disparity of "
        f"{rig.disparity_at_1_m_px:.1f} px",
    ]
    if rig.port == "flat":
        listed = ", ".join(f"{error:.2%} at {range_m:.2g} m" for range_m, error in rig.port_error)
        said.append(f"flat port, exact at {rig.working_range_m:g} m; range error left elsewhere: {listed}")
    elif rig.port == "dome":
        said.append("dome port, taken to be centered on the cameras: nothing is corrected")
    return said
