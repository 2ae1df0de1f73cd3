"""EuRoC's and ASL's sensor.yaml: a file a camera, T_BS from the camera to the vehicle's body (Burri
et al., IJRR 2016).
"""

from calibration.formats.calibration_format import CameraFormat
from calibration.formats.cameras import known_lens, make_camera
from calibration.formats.reading.section import Section, naming
from calibration.formats.ros import check_sides_named
from calibration.geometry import camera_matrix
from calibration.rig import Camera, CameraModel, StereoRig
from calibration.transforms import inverse

DISTORTION_MODELS: dict[str, CameraModel] = {
    "radial-tangential": "pinhole",
    "radtan": "pinhole",
    "equidistant": "fisheye",
}


def matches(document: Section) -> bool:
    """True for one camera's sensor.yaml."""
    return document.has("T_BS", "intrinsics")


def parse(left: Section, right: Section) -> StereoRig:
    """The rig of two cameras of one body.

    Raises CalibrationError where names and geometry both say that left and right are swapped.
    """
    T_body_left, T_body_right = (side.matrix("T_BS", 4, 4) for side in (left, right))
    with naming(f"{right.where}: T_BS"):
        rig = StereoRig(_camera(left), _camera(right), inverse(T_body_right) @ T_body_left)
    check_sides_named(rig, [left.where, right.where])
    return rig


def _camera(section: Section) -> Camera:
    name = known_lens(section, "distortion_model", DISTORTION_MODELS)
    K = camera_matrix(*section.numbers("intrinsics", 4))
    distortion = section.numbers("distortion_coefficients", 4)
    return make_camera(
        section.where, K, distortion, section.image_size("resolution"), DISTORTION_MODELS[name]
    )


FORMAT = CameraFormat("EuRoC", matches, parse)
