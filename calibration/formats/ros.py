"""ROS camera_info: two YAML files, one a camera, whose projection matrices hide the baseline.

Follows sensor_msgs/CameraInfo: a rectified right camera has P[0, 3] = -fx' B, so with both
rectifying rotations R = R_r^T R_l and T = R_r^T [-B, 0, 0]. Dumps of the message itself (D, K, R,
P) are read too.
"""

from pathlib import Path

import numpy as np

from calibration.errors import CalibrationError
from calibration.files import write_atomic
from calibration.formats.cameras import known_lens, make_camera
from calibration.formats.reading.section import Section, naming
from calibration.geometry import Array
from calibration.rectification import upright_rotations
from calibration.rig import Camera, CameraModel, StereoRig, quarter_turn
from calibration.transforms import is_backward, rigid_transform

DISTORTION_MODELS: dict[str, CameraModel] = {
    "plumb_bob": "pinhole",
    "rational_polynomial": "pinhole",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
    "": "pinhole",  # of images that are rectified already, as is the next
    "none": "pinhole",
}


def matches(document: Section) -> bool:
    """True for one camera's camera_info, which states its size."""
    return (document.has("image_width") or document.has("width")) and (
        document.has("projection_matrix", "camera_matrix")
        or document.has("P", "K", "D")
        or document.has("p", "k", "d")
    )


def parse(left: Section, right: Section) -> StereoRig:
    """The rig of a left and a right camera_info.

    Raises CalibrationError where names and geometry both say that left and right are swapped.
    """
    rotations = [
        side.matrix(side.first("rectification_matrix", "R", "r"), 3, 3) for side in (left, right)
    ]
    projections = [
        side.matrix(side.first("projection_matrix", "P", "p"), 3, 4) for side in (left, right)
    ]
    cameras = parse_camera(left), parse_camera(right)
    rig = StereoRig(*cameras, transform_of_projections(rotations, projections))
    check_sides_named(rig, [str(side.content.get("camera_name", "")) for side in (left, right)])
    return rig


def parse_camera(section: Section) -> Camera:
    """K, distortion and size of one camera_info (oplab's cameras have the same keys)."""
    name = known_lens(section, "distortion_model", DISTORTION_MODELS, "plumb_bob")
    size = section.image_size(
        section.first("image_width", "width"), section.first("image_height", "height")
    )
    K = section.matrix(section.first("camera_matrix", "K", "k"), 3, 3)
    distortion = section.numbers(section.first("distortion_coefficients", "D", "d"))
    return make_camera(section.where, K, distortion, size, DISTORTION_MODELS[name])


def check_sides_named(rig: StereoRig, names: list[str]) -> None:
    """Raise CalibrationError if the second camera stands left of the first, as their names say."""
    named_so = "right" in names[0].lower() and "left" in names[1].lower()
    if named_so and is_backward(rig.T_right_left):
        raise CalibrationError(
            f"{names[1]!r} stands to the left of {names[0]!r}, but is given as the right camera: "
            "left and right are swapped"
        )


ROUNDED = 1e-6
"""Of a projection matrix, where it is zero."""
TURNED = np.diag([-1.0, -1.0, 1.0])


def upright(P: Array) -> Array:
    """A projection (3, 4) with positive focal lengths, in axes that are turned by 180 degrees where
    they were negative.

    OpenCV's stereoRectify writes negative ones where it turns the axes; both are the same pixels.
    """
    return np.column_stack([P[:, :3] @ TURNED, P[:, 3]]) if P[0, 0] < 0 and P[1, 1] < 0 else P


def transform_of_projections(rotations: list[Array], projections: list[Array]) -> Array:
    """The transform (4, 4) from left to right axes behind two rectifying rotations (3, 3) and
    projections (3, 4), in their unit.
    """
    if not all(P[0, 0] * P[1, 1] > 0 and np.linalg.matrix_rank(P[:, :3]) == 3 for P in projections):
        raise CalibrationError(
            "a projection matrix has no focal length, or one of another sign across than down: "
            "calibrate the two cameras as a stereo pair"
        )
    if any(np.abs(P[[1, 2, 2], [0, 0, 1]]).max() > ROUNDED for P in projections):
        raise CalibrationError(
            "a projection matrix contains a rotation, as K [R t] does: it must be that of a "
            "rectified image, [f 0 cx tx; 0 f cy ty; 0 0 1 0]"
        )
    rotations = [
        (TURNED @ R if P[0, 0] < 0 else R) for R, P in zip(rotations, projections, strict=True)
    ]
    centers = [np.linalg.solve(P[:, :3], P[:, 3]) for P in map(upright, projections)]
    offset = centers[1] - centers[0]
    if not offset.any():
        raise CalibrationError(
            "both projection matrices have P[0, 3] = 0: these are two single-camera calibrations "
            "without a baseline; calibrate the two cameras as a stereo pair"
        )
    return rigid_transform(rotations[1].T @ rotations[0], rotations[1].T @ offset)


def rectified_rig(where: str, projections: list[Array], size: tuple[int, int]) -> StereoRig:
    """The rig of rectified images from their projections (3, 4), left first. where: the file."""
    projections = [upright(P) for P in projections]
    left, right = (
        make_camera(where, P[:, :3].copy(), np.zeros(0), size, "pinhole") for P in projections
    )
    with naming(where):
        return StereoRig(left, right, transform_of_projections([np.eye(3)] * 2, projections))


def write(rig: StereoRig, left_path: Path, right_path: Path) -> None:
    """Write both camera_info files.

    Raises CalibrationError for a distortion that ROS has no name for.
    """
    T = rig.T_right_left
    R_left, R_right, turns = upright_rotations(T)
    K_new = (rig.left.K + rig.right.K) / 2
    focal_px = K_new[1, 1]
    baseline_terms = quarter_turn(turns)[:2, 0] * -rig.baseline_m * focal_px
    for camera, R, (term_x, term_y), path, side in (
        (rig.left, R_left, (0.0, 0.0), left_path, "left"),
        (rig.right, R_right, baseline_terms, right_path, "right"),
    ):
        cx_px = camera.K[0, 2] if rig.is_rectified else K_new[0, 2]
        P = np.array(
            [[focal_px, 0, cx_px, term_x], [0, focal_px, K_new[1, 2], term_y], [0, 0, 1, 0]]
        )
        with write_atomic(path) as temporary:
            temporary.write_text(_camera_text(camera, R, P, side), encoding="utf-8")


def _camera_text(camera: Camera, R: Array, P: Array, side: str) -> str:
    name, coefficients = _named_distortion(camera)
    width, height = camera.image_size
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {side}\n"
        f"camera_matrix:\n{_matrix_text(camera.K)}"
        f"distortion_model: {name}\ndistortion_coefficients:\n{_matrix_text(coefficients[None])}"
        f"rectification_matrix:\n{_matrix_text(R)}projection_matrix:\n{_matrix_text(P)}"
    )


def _matrix_text(matrix: Array) -> str:
    data = ", ".join(repr(float(value)) for value in matrix.ravel())
    return f"  rows: {matrix.shape[0]}\n  cols: {matrix.shape[1]}\n  data: [{data}]\n"


def _named_distortion(camera: Camera) -> tuple[str, Array]:
    if camera.model == "fisheye":
        return "equidistant", camera.distortion
    if camera.distortion.size <= 5:
        return "plumb_bob", np.pad(camera.distortion, (0, 5 - camera.distortion.size))
    if not camera.distortion[8:].any():
        return "rational_polynomial", camera.distortion[:8]
    raise CalibrationError(
        f"ROS has no distortion model of {camera.distortion.size} coefficients: calibrate with 8 "
        "or fewer"
    )
