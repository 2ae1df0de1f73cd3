"""Two cameras on a vehicle's body, as OKVIS and VINS-Fusion configure them.

OKVIS keeps both in a list, T_SC from camera to body. VINS-Fusion has body_T_cam0 and body_T_cam1 in
its configuration and each lens in a file of CamOdoCal that it names.
"""

from pathlib import Path

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import CameraFormat, RigFormat
from calibration.formats.cameras import known_lens, make_camera
from calibration.formats.reading.document import load_document
from calibration.formats.reading.lens_models import fitted_camera, omni
from calibration.formats.reading.section import Section, naming
from calibration.geometry import camera_matrix
from calibration.rig import Camera, CameraModel, StereoRig
from calibration.transforms import inverse

DISTORTION_TYPES: dict[str, CameraModel] = {
    "radialtangential": "pinhole",
    "plumb_bob": "pinhole",
    "radialtangential8": "pinhole",
    "equidistant": "fisheye",
    "none": "pinhole",
}
POSES = ("T_SC", "T_BS")
MEI, KANNALA_BRANDT, PINHOLE = "MEI", "KANNALA_BRANDT", "PINHOLE"
LENS_FILES = ("cam0_calib", "cam1_calib")
Size = tuple[int, int]


def matches(document: Section) -> bool:
    """True for either configuration."""
    return bool(document.listed("cameras", *POSES)) or document.has(*LENS_FILES)


def is_lens(document: Section) -> bool:
    """Tell whether the document is one lens of CamOdoCal."""
    return document.has("model_type", "projection_parameters")


def refuse_lenses(left: Section, right: Section) -> StereoRig:
    """Raise CalibrationError: two lenses of CamOdoCal hold no transform between them."""
    raise CalibrationError(
        f"{left.where}: is one lens of CamOdoCal: give the VINS configuration that contains "
        "body_T_cam0 and body_T_cam1"
    )


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig of the two cameras. image_size is not needed. Raises CalibrationError."""
    if cameras := document.listed("cameras", *POSES):
        if len(cameras) != 2:
            raise CalibrationError(
                f"{document.where}: cameras: holds {len(cameras)}: keep the two of the stereo pair"
            )
        lenses = [_okvis_camera(camera) for camera in cameras]
        poses = [camera.matrix(camera.first(*POSES), 4, 4) for camera in cameras]
    else:
        lenses = [_camodocal_camera(_beside(document, key)) for key in LENS_FILES]
        poses = [document.matrix(key, 4, 4) for key in ("body_T_cam0", "body_T_cam1")]
    with naming(document.where):
        return StereoRig(lenses[0], lenses[1], inverse(poses[1]) @ poses[0])


def _okvis_camera(section: Section) -> Camera:
    K = camera_matrix(*section.numbers("focal_length", 2), *section.numbers("principal_point", 2))
    name = known_lens(section, "distortion_type", DISTORTION_TYPES, "none")
    distortion = section.numbers("distortion_coefficients") if name != "none" else np.zeros(0)
    size = section.image_size("image_dimension")
    return make_camera(section.where, K, distortion, size, DISTORTION_TYPES[name])


def _beside(document: Section, key: str) -> Section:
    """The file that ``key`` names, in the folder of the document."""
    return load_document(Path(document.where).parent / document.text(key))


def _camodocal_camera(section: Section) -> Camera:
    model = section.text("model_type")
    size = section.image_size("image_width", "image_height")
    lens = section.section("projection_parameters")
    if model == KANNALA_BRANDT:
        K = camera_matrix(*(lens.number(key) for key in ("mu", "mv", "u0", "v0")))
        return make_camera(
            section.where,
            K,
            np.array([lens.number(f"k{n}") for n in (2, 3, 4, 5)]),
            size,
            "fisheye",
        )
    if model not in (PINHOLE, MEI):
        raise CalibrationError(
            f"{section.where}: model_type: {model!r} is not supported: calibrate with {PINHOLE} "
            f"or {KANNALA_BRANDT}"
        )
    shape = section.section("distortion_parameters")
    distortion = np.array([shape.number(key) for key in ("k1", "k2", "p1", "p2")])
    if model == PINHOLE:
        K = camera_matrix(*(lens.number(key) for key in ("fx", "fy", "cx", "cy")))
        return make_camera(section.where, K, distortion, size, "pinhole")
    K = camera_matrix(*(lens.number(key) for key in ("gamma1", "gamma2", "u0", "v0")))
    mirror = section.section("mirror_parameters")
    return fitted_camera(section.where, omni(mirror.number("xi"), distortion), K, size, model)


FORMAT = RigFormat(matches, parse)
LENS = CameraFormat("CamOdoCal", is_lens, refuse_lenses)
