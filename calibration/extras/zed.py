"""Stereolabs' SN*.conf of a ZED: a section for each side and resolution, and [STEREO] with
millimeters and a rotation vector.

[STEREO] holds Baseline, TY, TZ, and RX, CV (about y) and RZ for each resolution. The baseline is
positive: OpenCV's T is -(Baseline, TY, TZ). The documentation leaves the sense of the rotation
open: the rig carries both, and images decide.
"""

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.section import Section, naming
from calibration.geometry import camera_matrix
from calibration.rig import Camera, StereoRig
from calibration.transforms import rigid_transform

SIZES = {
    "4K": (3840, 2160),
    "QHDPLUS": (3200, 1800),
    "2K": (2208, 1242),
    "FHD1200": (1920, 1200),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "SVGA": (960, 600),
    "VGA": (672, 376),
}
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def matches(document: Section) -> bool:
    """True for a ZED's factory calibration."""
    return document.has("STEREO") and any(document.has(f"LEFT_CAM_{name}") for name in SIZES)


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig at the resolution of the images. Raises CalibrationError without it."""
    held = {
        size: name
        for name, size in SIZES.items()
        if document.has(f"LEFT_CAM_{name}", f"RIGHT_CAM_{name}")
    }
    if image_size not in held:
        sizes = ", ".join(f"{width}x{height}" for width, height in held)
        raise CalibrationError(
            f"{document.where}: holds calibrations for images of {sizes}: give the size of the "
            "images as one of these"
        )
    name = held[image_size]
    left, right = (_camera(document, side, name, image_size) for side in ("LEFT", "RIGHT"))
    stereo = document.section("STEREO")
    T = -np.array([stereo.number(key) for key in ("Baseline", "TY", "TZ")]) / 1000
    R = cv2.Rodrigues(
        np.array(
            [stereo.number(stereo.first(f"{axis}_{name}", axis)) for axis in ("RX", "CV", "RZ")]
        )
    )[0]
    with naming(document.where):
        rigs = [
            StereoRig(
                left, right, rigid_transform(Q, T), "air", reading=f"the rotation takes {axes}"
            )
            for Q, axes in ((R, "left to right axes"), (R.T, "right to left axes"))
        ]
    return rigs[0].with_alternatives(rigs[1:])


def _camera(document: Section, side: str, name: str, size: tuple[int, int]) -> Camera:
    section = document.section(f"{side}_CAM_{name}")
    lens = document.section(f"{side}_DISTO") if document.has(f"{side}_DISTO") else section
    distortion = np.array([lens.number(key, 0.0) for key in COEFFICIENTS])
    K = camera_matrix(*(section.number(key) for key in ("fx", "fy", "cx", "cy")))
    return make_camera(
        section.where, K, distortion[: 8 if distortion[5:].any() else 5], size, "pinhole"
    )


FORMAT = RigFormat(matches, parse)
