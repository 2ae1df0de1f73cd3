"""VIAME's and KWIVER's camera rig in JSON: fx_left ... k3_right, R (9) and T (3) of x_right = R x_left + T, in mm or in meters."""

import json
from pathlib import Path

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.ros import make_camera
from calibration.formats.section import Section, naming
from calibration.formats.units import to_meters
from calibration.rig import Camera, StereoRig
from calibration.transforms import rigid

Size = tuple[int, int]
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def matches(document: Section) -> bool:
    """True for a camera rig in JSON."""
    return document.has("fx_left", "fx_right")


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig. image_size: for files without image_width and image_height. Raises CalibrationError, naming the key."""
    if document.has("image_width", "image_height"):
        size = document.image_size("image_width", "image_height")
    elif image_size is None:
        raise CalibrationError(f"{document.where}: stores no image_width and image_height: give the size of the images")
    else:
        size = image_size
    left, right = (_camera(document, side, size) for side in ("left", "right"))
    stated = "millimeters" if document.has("square_size_mm") else None
    T, doubts = to_meters(document.numbers("T", 3), stated)
    rms_px = document.number("rms_error_stereo") if document.has("rms_error_stereo") else None
    with naming(document.where):
        return StereoRig(left, right, rigid(document.matrix("R", 3, 3), T), rms_px=rms_px, doubts=doubts)


def write(rig: StereoRig, path: Path) -> None:
    """Write the JSON, millimeters. Raises CalibrationError for a camera that it has no model for (fisheye, 8 coefficients)."""
    width, height = rig.left.image_size
    content: dict[str, object] = {"image_width": width, "image_height": height}
    if rig.rms_px is not None:
        content["rms_error_stereo"] = rig.rms_px
    content |= {"T": (rig.T_right_left[:3, 3] * 1000).tolist(), "R": rig.R.ravel().tolist()}
    for side, camera in (("left", rig.left), ("right", rig.right)):
        content |= _camera_content(camera, side)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _camera(document: Section, side: str, size: Size) -> Camera:
    fx, fy, cx, cy = (document.number(f"{name}_{side}") for name in ("fx", "fy", "cx", "cy"))
    skew = document.number(f"skew_{side}") if document.has(f"skew_{side}") else 0.0
    given = [name for name in COEFFICIENTS if document.has(f"{name}_{side}")]
    distortion = np.array([document.number(f"{name}_{side}") if name in given else 0.0 for name in COEFFICIENTS])
    K = np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])
    return make_camera(f"{document.where}: {side}", K, distortion[: 8 if distortion[5:].any() else 5], size, "pinhole")


def _camera_content(camera: Camera, side: str) -> dict[str, float]:
    if camera.model == "fisheye" or camera.distortion[5:].any():
        raise CalibrationError(f"{side}: VIAME has k1 k2 p1 p2 k3 alone, and this {camera.model} camera has more: write native")
    (fx, skew, cx), (_, fy, cy), _ = camera.K.tolist()
    content = {f"fx_{side}": fx, f"fy_{side}": fy, f"cx_{side}": cx, f"cy_{side}": cy}
    if skew:
        content[f"skew_{side}"] = skew
    five = np.pad(camera.distortion[:5], (0, 5 - camera.distortion[:5].size)).tolist()
    return content | {f"{name}_{side}": value for name, value in zip(COEFFICIENTS, five, strict=False)}
