"""Writes VIAME's and KWIVER's camera rig in JSON: fx_left ... k3_right, R (9) and T (3) of x_right
= R x_left + T, in mm.
"""

import json
from pathlib import Path

from calibration.formats.cameras import five_coefficients
from calibration.rig import Camera, StereoRig

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")


def write(rig: StereoRig, path: Path) -> None:
    """Write the JSON, millimeters. Raises CalibrationError for a camera that it has no model for
    (fisheye, 8 coefficients).
    """
    width, height = rig.left.image_size
    content: dict[str, object] = {"image_width": width, "image_height": height}
    if rig.rms_px is not None:
        content["rms_error_stereo"] = rig.rms_px
    content |= {"T": (rig.T_right_left[:3, 3] * 1000).tolist(), "R": rig.R.ravel().tolist()}
    for side, camera in (("left", rig.left), ("right", rig.right)):
        content |= _camera_content(camera, side)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _camera_content(camera: Camera, side: str) -> dict[str, float]:
    five = five_coefficients(camera, side, "VIAME has only k1 k2 p1 p2 k3").tolist()
    (fx, skew, cx), (_, fy, cy), _ = camera.K.tolist()
    content = {f"fx_{side}": fx, f"fy_{side}": fy, f"cx_{side}": cx, f"cy_{side}": cy}
    if skew:
        content[f"skew_{side}"] = skew
    return content | {
        f"{name}_{side}": value for name, value in zip(COEFFICIENTS, five, strict=True)
    }
