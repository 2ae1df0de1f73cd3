"""Calibration formats that are recognized but not read: errors name the format and the remedy."""

import re

_FIRST_KEY = r"\A(?:%YAML.*\n\s*---|<\?xml.*>\s*<opencv_storage>)\s*<?"
"""Of a file of OpenCV."""

DLT = "coefficients of a direct linear transformation (DLT)"
DLT_COUNT = 11
"""Coefficients of a camera."""

FOREIGN = {
    "one lens of Metashape": r"<calibration>\s*<projection>",
    "a lens of Pix4D": r"\APix4D camera calibration",
    "settings of a RealSense camera": r"RealSense",
    "the lenses of a RealSense camera": r"\"ppx\"\s*:",
    "a calibration as MATLAB's window displays it": (
        r"^[ \t]*(?:stereoParams|stereoParameters)[ \t]*=[ \t]*$"
        r"|^[ \t]*(?:RotationOfCamera2|CameraParameters1):[ \t]*\["
    ),
    "rectification maps without their cameras": rf"{_FIRST_KEY}\w*[Ss]tereo_?[Mm]ap",
    DLT: r"<cal\.coeff\b|\bdlt_?coef",
    "a camera of RealityCapture (XMP)": r"capturingreality\.com",
    "a project of Meshroom": r"\"intrinsicId\"\s*:",
    "a reconstruction or rig of OpenSfM": (
        r"\"projection_type\"\s*:|\A\s*\{\s*\"[^\"]*\"\s*:\s*\{\s*\"(?:rotation|translation)\"\s*:"
    ),
    "a lens of Gyroflow": r"\"calibrated_by\"\s*:|\"fisheye_params\"\s*:",
    "a mission of oplab": r"\A(?:\s|#.*\n|version\s*:.*\n)*(?:origin|mission|vehicle)\s*:[\s\S]*?(?:records_|surge_m|latitude)",  # noqa: E501
    "a lens of Scaramuzza's OCamCalib": r"\bocam_model\b",
    "a rig of the Ames Stereo Pipeline": r"^ref_sensor_name:",
    "a camera of mrcal": r"^[ \t]*[\"']?lensmodel[\"']?\s*:",
}


def foreign(text: str) -> str | None:
    """Name the calibration format of a text that is not read here, and what to do; else None."""
    for name, pattern in FOREIGN.items():
        if re.search(pattern, text, re.MULTILINE) or (name == DLT and _is_dlt(text)):
            return (
                f"holds {name}, which is not supported: write both cameras and the transform "
                "between them as cam.yaml, the native file of docs/calibration.md"
            )
    return None


def _is_dlt(text: str) -> bool:
    """Whether a text is eleven numbers for one camera or two, also below a line of names."""
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) > DLT_COUNT + 1:
        return False
    rows = [_numbers(line) for line in lines]
    counts = [len(row) for row in (rows if rows[:1] != [[]] else rows[1:])]
    return counts in ([1] * DLT_COUNT, [2] * DLT_COUNT, [DLT_COUNT], [DLT_COUNT] * 2)


def _numbers(line: str) -> list[float]:
    """The numbers of a line that holds nothing else, also with decimal commas; else none."""
    for cells in (re.split(r"[;\s]+", line.strip(" ;\t\r")), line.split(",")):
        try:
            return [float(cell.strip(" ,").replace(",", ".")) for cell in cells]
        except ValueError:
            continue
    return []
