"""SeaGIS's .cam, one file a camera: interior and exterior orientation of photogrammetry.

The layout as CAL and EventMeasure write it: "CAM", a version, two texts, pixel sizes in mm, rows
and columns, and a matrix of 16 numbers: principal point xp yp and distance c (mm), k3 k5 k7 (mm^-2
...), p1 p2 (mm^-1), orthogonality, affinity, the camera's position X Y Z (mm) and its angles omega
phi kappa (degrees).

Photogrammetry measures in the image with y up, and its distortion is what is added to a measured
point to get the ideal one (Fraser 1997, *Digital camera self-calibration*, eq. 1 to 5); both are
turned into OpenCV's here. Since no document of SeaGIS says so, the rig carries the other readings
too, and images decide.
"""

import struct
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import CameraFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.lens_models import brown_terms
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import rig_in_meters
from calibration.geometry import Array
from calibration.rig import Camera, StereoRig
from calibration.transforms import inverse, rigid_transform, rotation_from_euler

MARK = "SeaGIS .cam"
NUMBERS = (
    "xp", "yp", "c", "k3", "k5", "k7", "p1", "p2", "orthogonality", "affinity", "X", "Y", "Z",
    "omega", "phi", "kappa",
)  # fmt: skip
MAX_TEXT = 4096  # bytes of one text field: names and remarks are shorter
# a pixel over an image of 1000; more would have to be modeled, and its sign is not documented
MAX_AFFINITY = 1e-3
# points a side over the image at which the distortion is fitted: 441 for at most 8 coefficients
GRID = 21
IN_ORDER = [0, 1, 3, 4, 2]  # k1 k2 p1 p2 k3, of brown_terms
Y_DOWN = np.diag([1.0, -1.0, -1.0])  # photogrammetric axes look along -z with y up


def decode(raw: bytes) -> dict[str, Any] | None:
    """The fields of one .cam file; None for other files. Raises CalibrationError if it is damaged,
    or holds no exterior orientation.
    """
    if not raw.startswith((b"CAM", b"CBL")) or len(raw) < 4 or raw[3] >= 32:
        return None
    if raw.startswith(b"CBL"):
        raise CalibrationError(
            "contains only the interior orientation (.CamCAL): export the .cam files of the "
            "stereo pair"
        )
    reader = _Reader(raw, 4)
    names = reader.text(), reader.text()
    pixel_mm = reader.doubles(2)
    size = reader.integers(2)
    mark, rows, columns = reader.take(4), *reader.integers(2)
    if mark[:3] != b"MAT" or rows * columns < len(NUMBERS) or rows < 0:
        raise CalibrationError(
            f"is damaged, or of another version: {rows}x{columns} parameters where {len(NUMBERS)} "
            "are expected"
        )
    numbers = dict(zip(NUMBERS, reader.doubles(len(NUMBERS)), strict=True))
    return {
        "format": MARK,
        "name": names[0],
        "pixel_mm": list(pixel_mm),
        "size": sorted(size, reverse=True),
        **numbers,
    }


def matches(document: Section) -> bool:
    """True for one camera of a SeaGIS pair."""
    return document.content.get("format") == MARK


def parse(left: Section, right: Section) -> StereoRig:
    """The rig of a left and a right .cam file, and as alternatives the other readings of distortion
    and angles.
    """
    rigs, errors = [], []
    for corrects, to_camera in product((True, False), (True, False)):
        try:
            rigs.append(_read_as(left, right, corrects, to_camera))
        except CalibrationError as error:
            errors.append(error)
    if not rigs:
        raise errors[0]
    return rigs[0].with_alternatives(rigs[1:])


def _read_as(left: Section, right: Section, corrects: bool, to_camera: bool) -> StereoRig:
    cameras = [_camera(side, corrects) for side in (left, right)]
    poses = [_pose(side, to_camera) for side in (left, right)]
    T = poses[1] @ inverse(poses[0])
    distortion = "added to measured points" if corrects else "part of measured points"
    angles = (
        "from the object's axes to the camera's"
        if to_camera
        else "from the camera's axes to the object's"
    )
    reading = f"distortion {distortion}, angles {angles}"
    with naming(right.where):
        return rig_in_meters(cameras[0], cameras[1], T, "millimeters", reading)


@dataclass
class _Reader:
    data: bytes
    position: int

    def take(self, count: int) -> bytes:
        taken = self.data[self.position : self.position + count]
        if len(taken) < count:
            raise CalibrationError("is truncated or damaged: it ends before its last parameter")
        self.position += count
        return taken

    def integers(self, count: int) -> tuple[int, ...]:
        return struct.unpack(f"<{count}i", self.take(4 * count))

    def doubles(self, count: int) -> tuple[float, ...]:
        return struct.unpack(f"<{count}d", self.take(8 * count))

    def text(self) -> str:
        (length,) = self.integers(1)  # negative: so many UTF-16 characters
        if not -MAX_TEXT <= length <= 0:
            raise CalibrationError("is truncated or damaged: a text has an impossible length")
        return self.take(-2 * length).decode("utf-16-le", "replace")


def _camera(section: Section, corrects: bool) -> Camera:
    c_mm = section.number("c")
    pixel_mm = section.numbers("pixel_mm", 2)
    for name in ("orthogonality", "affinity"):
        if abs(section.number(name)) > MAX_AFFINITY:
            raise CalibrationError(
                f"{section.where}: {name}: {section.number(name):g} is not supported: calibrate "
                "with it fixed at 0"
            )
    if not (pixel_mm > 0).all() or not c_mm > 0:
        raise CalibrationError(
            f"{section.where}: pixel size {pixel_mm.tolist()} mm and distance c {c_mm:g} mm must "
            "be positive"
        )
    width, height = section.image_size("size")
    focal_px = c_mm / pixel_mm
    offset_mm = np.array([section.number("xp"), -section.number("yp")])
    center = (np.array([width, height]) - 1) / 2 + offset_mm / pixel_mm
    K = np.array([[focal_px[0], 0, center[0]], [0, focal_px[1], center[1]], [0, 0, 1]])
    distortion = _fitted(section, K, (width, height)) if corrects else _forward(section)
    return make_camera(section.where, K, distortion, (width, height), "pinhole")


def _forward(section: Section) -> Array:
    """k1 k2 p1 p2 k3 of unit focal length, as if the numbers said what the lens does to an ideal
    point. y up: p1 changes sign.
    """
    c = section.number("c")
    k3, k5, k7, p1, p2 = (section.number(name) for name in ("k3", "k5", "k7", "p1", "p2"))
    return np.array([k3 * c**2, k5 * c**4, -p2 * c, p1 * c, k7 * c**6])


def _fitted(section: Section, K: Array, size: tuple[int, int]) -> Array:
    """k1 k2 p1 p2 k3 of OpenCV that take the corrected points to the measured ones: least squares
    over the image, linear.
    """
    k1, k2, p1, p2, k3 = _forward(section)
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, GRID), np.linspace(0, size[1] - 1, GRID))
    measured = (np.column_stack([u.ravel(), v.ravel()]) - K[:2, 2]) / K[[0, 1], [0, 1]]
    ideal = measured + brown_terms(measured)[..., IN_ORDER] @ np.array([k1, k2, p1, p2, k3])
    terms, off = brown_terms(ideal)[..., IN_ORDER], measured - ideal
    fitted, *_ = np.linalg.lstsq(np.concatenate([*terms.swapaxes(0, 1)]), off.T.ravel(), rcond=None)
    return np.asarray(fitted)


def _pose(section: Section, to_camera: bool) -> Array:
    """(4, 4) from the rig's axes (mm) to the camera's, x right and y down."""
    angles_deg = [-section.number(name) for name in ("omega", "phi", "kappa")]
    R = rotation_from_euler(*np.radians(angles_deg))
    R = Y_DOWN @ (R if to_camera else R.T)
    center = np.array([section.number(name) for name in ("X", "Y", "Z")])
    return rigid_transform(R, -R @ center)


FORMAT = CameraFormat("SeaGIS", matches, parse, decode)
