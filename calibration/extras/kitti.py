"""KITTI's calib.txt (P0 to P3) and calib_cam_to_cam.txt: projections of rectified cameras, gray 0
and 1, color 2 and 3.

Geiger et al., Vision meets Robotics: The KITTI Dataset, 2013, section 4: x = P R X with P = K [I |
t], meters.
"""

from dataclasses import replace

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.finder import find
from calibration.formats.reading.section import Section, naming
from calibration.formats.ros import rectified_rig, transform_of_projections
from calibration.rig import COLOR_TAKEN, GRAY_TAKEN, Camera, StereoRig

COLOR, GRAY = ("2", "3"), ("0", "1")
Size = tuple[int, int]


def matches(document: Section) -> bool:
    """True for either file, but not for K0 D0 K1 D1 with what rectification makes of them."""
    raw, rectified = (
        any(document.has(prefix + a, prefix + b) for a, b in (COLOR, GRAY))
        for prefix in ("P_rect_0", "P")
    )
    return raw or (rectified and find(document.content).pair("K") is None)


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The color cameras where the file holds them, else the gray ones; of a file that holds both,
    the gray ones as an alternative.

    image_size: (width, height). calib.txt stores none, and calib_cam_to_cam.txt one before and one
    after rectification.
    Raises CalibrationError if it is needed and missing.
    """
    raw = document.has("P_rect_00") or document.has("P_rect_02")
    prefix = "P_rect_0" if raw else "P"
    pairs = [pair for pair in (COLOR, GRAY) if document.has(*(prefix + camera for camera in pair))]
    rigs = [
        _of_raw(document, pair, image_size)
        if raw
        else _rectified(document, [f"P{camera}" for camera in pair], image_size)
        for pair in pairs
    ]
    if len(rigs) == 1:
        return rigs[0]
    color_mm, gray_mm = (1000 * rig.baseline_m for rig in rigs)
    both = (
        f"holds the color cameras 2 and 3 (baseline {color_mm:.1f} mm) and the gray ones 0 and "
        f"1 ({gray_mm:.1f} mm)"
    )
    color, gray = (
        replace(rig, reading=reading, doubts=(*rig.doubts, f"{both}: {reading}"))
        for rig, reading in zip(rigs, (COLOR_TAKEN, GRAY_TAKEN), strict=True)
    )
    return color.with_alternatives([gray])


def _of_raw(document: Section, pair: tuple[str, str], size: Size | None) -> StereoRig:
    """Images of the size before rectification have K, D and R_rect; all others are rectified."""
    first = pair[0]
    if (
        size is None
        or not document.has(f"S_0{first}")
        or size != document.image_size(f"S_0{first}")
    ):
        stored = (
            document.image_size(f"S_rect_0{first}") if document.has(f"S_rect_0{first}") else size
        )
        if stored is None:
            raise CalibrationError(
                f"{document.where}: no 'S_rect_0{first}': the file is incomplete"
            )
        return _rectified(document, [f"P_rect_0{camera}" for camera in pair], stored)
    cameras = [_camera(document, camera, size) for camera in pair]
    rotations = [document.matrix(f"R_rect_0{camera}", 3, 3) for camera in pair]
    projections = [document.matrix(f"P_rect_0{camera}", 3, 4) for camera in pair]
    with naming(document.where):
        T = transform_of_projections(rotations, projections)
        return StereoRig(cameras[0], cameras[1], T, medium="air")


def _camera(document: Section, camera: str, size: Size) -> Camera:
    K, distortion = document.matrix(f"K_0{camera}", 3, 3), document.numbers(f"D_0{camera}", 5)
    return make_camera(document.where, K, distortion, size, "pinhole")


def _rectified(document: Section, keys: list[str], size: Size | None) -> StereoRig:
    needed = document.needed_size(size)
    projections = [document.matrix(key, 3, 4) for key in keys]
    return replace(rectified_rig(document.where, projections, needed), medium="air")


FORMAT = RigFormat(matches, parse)
