"""Calibrations of formats that are not read here, recognized so that a user is told what the file is and what to do."""

import re

FOREIGN = {
    "cameras of Metashape": r"<document[^>]*>\s*<chunk",
    "one lens of Metashape": r"<calibration>\s*<projection>",
    "cameras of COLMAP": r"^\d+ (SIMPLE_PINHOLE|PINHOLE|SIMPLE_RADIAL|RADIAL|OPENCV|FULL_OPENCV|OPENCV_FISHEYE) \d+ \d+ ",
    "a rig of COLMAP": r'\A\s*\[\s*\{\s*"cameras"',
    "a lens of Pix4D": r"\APix4D camera calibration",
    "settings of a RealSense camera": r"RealSense",
    "one camera of CamOdoCal or VINS": r"^model_type:\s*\W?(KANNALA_BRANDT|PINHOLE|MEI|SCARAMUZZA)",
}


def foreign(text: str) -> str | None:
    """What a text file is, with what to do, if it is a calibration of a format that is not read here; else None."""
    for name, pattern in FOREIGN.items():
        if re.search(pattern, text, re.MULTILINE):
            return (
                f"holds {name}, which is not read here: write both cameras and the transform between them as cam.yaml, "
                "the native file of docs/calibration.md"
            )
    return None
