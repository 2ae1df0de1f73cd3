"""Bouguet's calibration toolbox (Caltech): ``Calib_Results_stereo.mat``, its fields at the top or
inside one struct.

x_right = R x_left + T, R by the rotation vector ``om``; pixels from 0; millimeters, since squares
are entered in millimeters.
"""

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import to_meters
from calibration.rig import Camera, StereoRig
from calibration.rig_errors import RigErrors
from calibration.transforms import rigid_transform

Size = tuple[int, int]
STDS = 3
"""The toolbox's *_error are "approximately three times the standard deviations" (its manual)."""


def matches(document: Section) -> bool:
    """True for a stereo file of the toolbox, and for one of a single camera, which is refused."""
    return _find(document) is not None


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig. image_size: for files that store none. Raises CalibrationError, naming the field."""
    fields = _find(document)
    assert fields is not None
    if not fields.has("fc_left"):
        raise CalibrationError(
            f"{fields.where}: contains only one camera: give Calib_Results_stereo.mat"
        )
    left, right = (_camera(fields, side, image_size) for side in ("left", "right"))
    if fields.has("om"):
        R, _ = cv2.Rodrigues(fields.numbers("om", 3))
    else:
        R = fields.matrix("R", 3, 3)
    T, doubts = to_meters(fields.numbers("T", 3), "millimeters")
    with naming(fields.where):
        return StereoRig(left, right, rigid_transform(R, T), doubts=doubts, errors=_errors(fields))


def _errors(fields: Section) -> RigErrors | None:
    """None for files without them."""
    if not fields.has("fc_left_error", "fc_right_error", "T_error"):
        return None
    lenses = [
        (fields.numbers(f"fc_{side}", 2), fields.numbers(f"fc_{side}_error", 2))
        for side in ("left", "right")
    ]
    T, T_error = fields.numbers("T", 3), fields.numbers("T_error", 3)
    focal = max(float((error / STDS / value).mean()) for value, error in lenses)
    along = T / np.linalg.norm(T)
    baseline = float(np.linalg.norm(along * T_error) / STDS / np.linalg.norm(T))
    return RigErrors(focal, baseline, "Bouguet's toolbox")


def _find(document: Section) -> Section | None:
    inner = (
        Section(f"{document.where}: {name}", value)
        for name, value in document.content.items()
        if isinstance(value, dict)
    )
    for section in (document, *inner):
        if section.has("fc_left", "fc_right", "cc_left", "cc_right") or section.has(
            "fc", "cc", "kc"
        ):
            return section
    return None


def _camera(fields: Section, side: str, image_size: Size | None) -> Camera:
    fx, fy = fields.numbers(f"fc_{side}", 2)
    cx, cy = fields.numbers(f"cc_{side}", 2)
    alpha = fields.number(f"alpha_c_{side}", 0.0)
    K = np.array([[fx, alpha * fx, cx], [0, fy, cy], [0, 0, 1]])
    distortion = fields.numbers(f"kc_{side}", 4, 5) if fields.has(f"kc_{side}") else np.zeros(5)
    return make_camera(
        f"{fields.where}: {side}",
        K,
        distortion,
        _size(fields, side, (cx, cy), image_size),
        "pinhole",
    )


def _size(
    fields: Section, side: str, center_px: tuple[float, float], image_size: Size | None
) -> Size:
    if fields.has("nx", "ny"):
        return fields.image_size("nx", "ny")
    if fields.has(f"image_size_{side}"):
        # (width, height) or MATLAB's (rows, columns): the middle decides
        size = fields.image_size(f"image_size_{side}")
        turned = (size[1], size[0])
        return min(
            (size, turned),
            key=lambda s: abs(s[0] / 2 - center_px[0]) + abs(s[1] / 2 - center_px[1]),
        )
    return fields.needed_size(image_size)


FORMAT = RigFormat(matches, parse)
