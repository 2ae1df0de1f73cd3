"""Calibration formats that are recognized but not supported, so that the error names the format and
the remedy.
"""

import re

_NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
_TWO = rf"{_NUMBER}[,\t ]+{_NUMBER}"
_FIRST_KEY = r"\A(?:%YAML.*\n\s*---|<\?xml.*>\s*<opencv_storage>)\s*<?"
"""Of a file of OpenCV."""

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
    "coefficients of a direct linear transformation (DLT)": (
        rf"\A({_TWO}\s*?\n){{10}}{_TWO}\s*\Z|<cal\.coeff\b|\bdlt_?coef"
    ),
    "a camera of RealityCapture (XMP)": r"capturingreality\.com",
    "a project of Meshroom": r"\"intrinsicId\"\s*:",
    "a reconstruction or rig of OpenSfM": (
        r"\"projection_type\"\s*:|\A\s*\{\s*\"[^\"]*\"\s*:\s*\{\s*\"(?:rotation|translation)\"\s*:"
    ),
    "a lens of Gyroflow": r"\"calibrated_by\"\s*:|\"fisheye_params\"\s*:",
    "a mission of oplab": r"\A(?:\s|#.*\n|version\s*:.*\n)*(?:origin|mission|vehicle)\s*:[\s\S]*?(?:records_|surge_m|latitude)",  # noqa: E501
    "a camera of mrcal": r"^[ \t]*[\"']?lensmodel[\"']?\s*:",
}


def foreign(text: str) -> str | None:
    """Name the calibration format of a text file that is not read here, with what to do; None if it
    is none of these.
    """
    for name, pattern in FOREIGN.items():
        if re.search(pattern, text, re.MULTILINE):
            return (
                f"holds {name}, which is not supported: write both cameras and the transform "
                "between them as cam.yaml, the native file of docs/calibration.md"
            )
    return None
