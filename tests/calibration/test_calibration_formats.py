"""Every format gives back the rays that went in; the traps of each, by hand-written files."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from calibration_texts import (
    KALIBR,
    MIDDLEBURY,
    NATIVE,
    OPENCV_EXTRINSICS,
    OPENCV_INTRINSICS,
    OPLAB,
    ORBSLAM_NEW,
    ROS_LEFT,
    ROS_RIGHT,
    WHOLE_RIGS,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, floats, integers

from calibration import CalibrationError, Camera, Rectification, StereoRig
from calibration.formats import WritableFormat, load_rig, write_rig
from calibration.rig_errors import RigErrors
from calibration.transforms import rigid_transform

FORMATS: dict[WritableFormat, str] = {
    "native": "cam.yaml",
    "ros": "pair",
    "kalibr": "camchain.yaml",
    "opencv": "stereo.xml",
}


@st.composite
def rigs(draw: DrawFn, representable: bool = True) -> StereoRig:
    """Random side-by-side rigs, with what every format can hold."""
    fisheye = draw(st.booleans())
    size = (draw(integers(320, 4000)), draw(integers(240, 3000)))
    cameras = [_camera(draw, size, fisheye) for _ in range(2)]
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([draw(floats(-0.3, 0.3)) for _ in range(3)]))[0]
    center = np.array(
        [draw(floats(0.02, 1.5)), draw(floats(-0.01, 0.01)), draw(floats(-0.01, 0.01))]
    )
    T[:3, 3] = -T[:3, :3] @ center
    return StereoRig(cameras[0], cameras[1], T)


def _camera(draw: DrawFn, size: tuple[int, int], fisheye: bool) -> Camera:
    fx = draw(floats(0.3, 3)) * size[0]
    K = np.array(
        [
            [fx, 0, draw(floats(0.4, 0.6)) * size[0]],
            [0, fx * draw(floats(0.95, 1.05)), size[1] / 2],
            [0, 0, 1],
        ]
    )
    limits = [0.05, 0.02, 0.01, 0.005] if fisheye else [0.4, 0.2, 0.01, 0.01]
    distortion = np.array([draw(floats(-limit, limit)) for limit in limits])
    if not fisheye:
        distortion = np.append(distortion, 0.0)
    return Camera(K, distortion, size, "fisheye" if fisheye else "pinhole")


def seen(rig: StereoRig) -> np.ndarray:
    """Where both cameras see points scattered before them, in focal lengths; ties down every ray
    and the transform.
    """
    x, y, z = np.meshgrid([-0.4, 0.0, 0.3], [-0.3, 0.1, 0.3], [0.5, 2.0, 8.0])
    points = np.stack([x * z, y * z, z], axis=-1).reshape(-1, 1, 3)
    poses = [(np.zeros(3), np.zeros(3)), (cv2.Rodrigues(rig.R)[0], rig.T_right_left[:3, 3])]
    pixels = []
    for camera, (rvec, tvec) in zip((rig.left, rig.right), poses, strict=True):
        project = cv2.fisheye.projectPoints if camera.model == "fisheye" else cv2.projectPoints
        pixels.append(
            project(points, rvec, tvec, camera.K, camera.distortion)[0].reshape(-1, 2)
            / camera.K[0, 0]
        )
    return np.array(pixels)


MOST_SLOPE = 10.0
"""Focal lengths from the middle: no image reaches as far."""


@pytest.mark.slow
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rig=rigs())
def test_every_pair_of_formats_reproduces_rays(rig: StereoRig, tmp_path: Path) -> None:
    expected = seen(rig)
    # farther out, a division by nearly 0 enlarges what rounding leaves
    looked_at = np.abs(expected).max(axis=-1) < MOST_SLOPE
    for first, second in product(FORMATS, repeat=2):
        write_rig(rig, tmp_path / FORMATS[first], first)
        write_rig(load_rig(tmp_path / FORMATS[first]), tmp_path / FORMATS[second], second)
        again = load_rig(tmp_path / FORMATS[second])
        np.testing.assert_allclose(
            seen(again)[looked_at], expected[looked_at], rtol=1e-14, atol=1e-9
        )
        assert again.left.image_size == rig.left.image_size
        assert again.left.model == rig.left.model


@pytest.mark.parametrize("name", WHOLE_RIGS)
def test_format_is_found_by_content(name: str, tmp_path: Path) -> None:
    file = tmp_path / "calibration.dat"
    file.write_text(WHOLE_RIGS[name])
    assert load_rig(file).baseline_m == pytest.approx(0.1, abs=1e-7)


@pytest.mark.parametrize("name", WHOLE_RIGS)
@pytest.mark.parametrize(
    "encode", [lambda t: b"\xef\xbb\xbf" + t.encode(), lambda t: t.replace("\n", "\r\n").encode()]
)
def test_byte_order_mark_and_crlf_are_harmless(
    name: str, encode: Callable[[str], bytes], tmp_path: Path
) -> None:
    file = tmp_path / "cam"
    file.write_bytes(encode(WHOLE_RIGS[name]))
    assert load_rig(file).baseline_m == pytest.approx(0.1, abs=1e-7)


def write_ros(folder: Path, left: str = ROS_LEFT, right: str = ROS_RIGHT) -> Path:
    (folder / "left.yaml").write_text(left)
    (folder / "right.yaml").write_text(right)
    return folder


def test_ros_pair_as_folder_and_as_two_files(tmp_path: Path) -> None:
    write_ros(tmp_path)
    for path in (tmp_path, f"{tmp_path}/left.yaml,{tmp_path}/right.yaml"):
        assert load_rig(path).baseline_m == pytest.approx(0.1, abs=1e-12)


def test_ros_rotations_become_extrinsics(tmp_path: Path) -> None:
    """R = R_r^T R_l and T = R_r^T [-B, 0, 0]: the rectifying rotations must be undone."""
    R_left, R_right = (
        cv2.Rodrigues(np.array(v))[0] for v in ([0.01, 0.05, -0.02], [0.0, -0.03, 0.01])
    )
    unit = "[1, 0, 0, 0, 1, 0, 0, 0, 1]"
    write_ros(
        tmp_path,
        ROS_LEFT.replace(unit, str(R_left.ravel().tolist())),
        ROS_RIGHT.replace(unit, str(R_right.ravel().tolist())),
    )
    rig = load_rig(tmp_path)
    np.testing.assert_allclose(rig.R, R_right.T @ R_left, atol=1e-12)
    np.testing.assert_allclose(rig.T_right_left[:3, 3], R_right.T @ [-0.1, 0, 0], atol=1e-12)


def test_ros_rectified_topics_are_a_rectified_rig(tmp_path: Path) -> None:
    def rectified(text: str) -> str:
        text = text.replace(
            "[1000, 0, 640, 0, 1000, 512, 0, 0, 1]", "[980, 0, 640, 0, 980, 512, 0, 0, 1]"
        )
        return text.replace("[-0.2, 0.05, 0, 0, 0]", "[0, 0, 0, 0, 0]")

    assert load_rig(write_ros(tmp_path, rectified(ROS_LEFT), rectified(ROS_RIGHT))).is_rectified


@pytest.mark.parametrize(
    ("model", "coefficients", "expected"),
    [
        ("rational_polynomial", 8, "pinhole"),
        ("equidistant", 4, "fisheye"),
        ("plumb_bob", 5, "pinhole"),
    ],
)
def test_ros_distortion_models(
    model: str, coefficients: int, expected: str, tmp_path: Path
) -> None:
    def change(text: str) -> str:
        return text.replace("plumb_bob", model).replace(
            "[-0.2, 0.05, 0, 0, 0]", str([0.01] * coefficients)
        )

    rig = load_rig(write_ros(tmp_path, change(ROS_LEFT), change(ROS_RIGHT)))
    assert (rig.left.model, rig.left.distortion.size) == (expected, coefficients)


@pytest.mark.parametrize("model", ["", "none", "plumb_bob"])
def test_ros_rectified_topics_as_printed_by_ros(model: str, tmp_path: Path) -> None:
    sides = []
    for side, tx in (("left", 0), ("right", -98)):
        P = [980, 0, 640, tx, 0, 980, 512, 0, 0, 0, 1, 0]
        message = f"""header:
  frame_id: camera
height: 1024
width: 1280
distortion_model: '{model}'
D: []
K: [980, 0, 640, 0, 980, 512, 0, 0, 1]
R: [1, 0, 0, 0, 1, 0, 0, 0, 1]
P: {P}
---
"""
        sides.append(tmp_path / f"{side}.yaml")
        sides[-1].write_text(2 * message)
    rig = load_rig(f"{sides[0]},{sides[1]}")
    assert rig.is_rectified
    assert rig.baseline_m == pytest.approx(0.1)


@pytest.mark.parametrize(("key", "inverse"), [("T_cam_imu", False), ("T_imu_cam", True)])
def test_kalibr_poses_to_an_imu(key: str, inverse: bool, tmp_path: Path) -> None:
    content = yaml.safe_load(KALIBR)
    to_left = rigid_transform(
        cv2.Rodrigues(np.array([0.3, -0.2, 1.5]))[0], np.array([0.02, 0.1, -0.05])
    )
    to_right = np.array(content["cam1"].pop("T_cn_cnm1")) @ to_left
    for camera, pose in (("cam0", to_left), ("cam1", to_right)):
        content[camera][key] = (np.linalg.inv(pose) if inverse else pose).tolist()
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(content))
    (tmp_path / "plain.yaml").write_text(KALIBR)
    np.testing.assert_allclose(
        seen(load_rig(tmp_path / "camchain.yaml")),
        seen(load_rig(tmp_path / "plain.yaml")),
        atol=1e-9,
    )


def test_middlebury_without_the_size_of_the_images(tmp_path: Path) -> None:
    file = tmp_path / "calib.txt"
    file.write_text(
        "".join(
            line for line in MIDDLEBURY.splitlines(True) if not line.startswith(("width", "height"))
        )
    )
    assert load_rig(file, (2400, 2000)).left.image_size == (2400, 2000)


def test_opencv_two_files_in_any_order_and_the_size_of_the_images(tmp_path: Path) -> None:
    intrinsics, extrinsics = tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"
    intrinsics.write_text(OPENCV_INTRINSICS)
    extrinsics.write_text(OPENCV_EXTRINSICS)
    for path in (f"{intrinsics},{extrinsics}", f"{extrinsics},{intrinsics}", tmp_path):
        assert load_rig(path, image_size=(640, 480)).left.image_size == (640, 480)
    with pytest.raises(CalibrationError, match="no image size"):
        load_rig(tmp_path)


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_opencv_notations(suffix: str, tmp_path: Path) -> None:
    native = tmp_path / "cam.yaml"
    native.write_text(NATIVE)
    rig = load_rig(native)
    write_rig(rig, tmp_path / f"stereo{suffix}", "opencv")
    again = load_rig(tmp_path / f"stereo{suffix}")
    np.testing.assert_array_equal(again.left.K, rig.left.K)
    np.testing.assert_array_equal(again.right.distortion, rig.right.distortion)
    np.testing.assert_array_equal(again.T_right_left, rig.T_right_left)


def test_kalibr_with_the_right_camera_first(tmp_path: Path) -> None:
    file = tmp_path / "camchain.yaml"
    file.write_text(KALIBR.replace("-0.1]", "0.1]"))
    rig = load_rig(file)
    assert rig.left.K[0, 0] == 457.6
    assert rig.T_right_left[0, 3] == pytest.approx(-0.1)


def kalibr_results(focal: float) -> str:
    """As kalibr_calibrate_cameras prints them; focal: of cam0."""
    return f"""Calibration results
====================
Camera-system parameters:
\tcam0 (/cam0/image_raw):
\t type: <class 'aslam_cv.libaslam_cv_python.DistortedPinholeCameraGeometry'>
\t distortion: [-0.27  0.06  0.0008  0.0001] +- [ 0.001  0.001  0.0001  0.0001]
\t projection: [ {focal}  460.3  362.6  248.1] +- [ 0.9232  0.9206  0.4  0.3]
\t reprojection error: [0.000001, 0.000002] +- [0.1, 0.1]

\tcam1 (/cam1/image_raw):
\t projection: [ 457.6  456.1  379.9  255.2] +- [ 0.1  0.1  0.4  0.3]

\tbaseline T_1_0:
\t q: [0. 0. 0. 1.] +- [ 0.001  0.001  0.0002]
\t t: [-0.1  0.  0.] +- [ 0.0003  0.0009  0.0009]
"""


def test_kalibrs_results_beside_the_camchain_state_its_errors(tmp_path: Path) -> None:
    file, results = tmp_path / "dive-camchain.yaml", tmp_path / "dive-results-cam.txt"
    file.write_text(KALIBR)
    assert load_rig(file).errors is None
    results.write_text(kalibr_results(461.6))
    errors = load_rig(file).errors
    assert errors is not None
    assert (errors.focal, errors.baseline) == pytest.approx((0.002, 0.003))
    results.write_text(kalibr_results(470.0))  # of another calibration
    assert load_rig(file).errors is None


def test_native_files_keep_the_errors(tmp_path: Path) -> None:
    (tmp_path / "cam.yaml").write_text(NATIVE)
    rig = replace(load_rig(tmp_path / "cam.yaml"), errors=RigErrors(0.001, 0.002, "Kalibr"))
    write_rig(rig, tmp_path / "again.yaml")
    assert load_rig(tmp_path / "again.yaml").errors == rig.errors


def test_oplab_trusts_the_length_of_the_data(tmp_path: Path) -> None:
    file = tmp_path / "stereo_LC_RC.yaml"
    file.write_text(OPLAB)
    assert load_rig(file).left.distortion.size == 8


def test_oplab_invalid_line_is_tolerated(tmp_path: Path) -> None:
    file = tmp_path / "stereo_LC_RC.yaml"
    file.write_text(
        OPLAB.replace("extrinsics:\n   rotation_matrix", "extrinsics:  rotation_matrix")
    )
    assert load_rig(file).baseline_m == pytest.approx(0.1)


def test_orbslam_new_transform_is_inverted(tmp_path: Path) -> None:
    file = tmp_path / "EuRoC.yaml"
    file.write_text(ORBSLAM_NEW)
    assert load_rig(file).T_right_left[0, 3] == pytest.approx(-0.1)


def test_middlebury_doffs_and_millimeters(tmp_path: Path) -> None:
    file = tmp_path / "calib.txt"
    file.write_text(MIDDLEBURY)
    rig = load_rig(file)
    assert rig.is_rectified
    pair = Rectification.from_rig(rig).pair
    disparity = np.full((1988, 2964), 100.0, dtype=np.float32)
    assert pair.depth_from_disparity(disparity)[0, 0] == pytest.approx(
        3997.684 * 0.1 / (100 + 131.111), rel=1e-6
    )


REFUSED = {
    "a lens not known": (
        KALIBR.replace("camera_model: pinhole", "camera_model: bal"),
        "'bal' with 'radtan' is not supported",
    ),
    "omni without xi": (
        KALIBR.replace("camera_model: pinhole", "camera_model: omni"),
        "expected 5 numbers, got 4",
    ),
    "millimeters": (KALIBR.replace("-0.1]", "-94.0]"), "millimeters it is 0.094 m"),
    "squares": (KALIBR.replace("-0.1]", "-3.88]"), "in board squares"),
    "swapped by topic": (
        KALIBR.replace("-0.1]", "0.1]").replace("/cam0/", "/left/").replace("/cam1/", "/right/"),
        "left and right are swapped",
    ),
    "one behind the other": (
        NATIVE.replace("-0.1]", "0.0]").replace("1.0, 0.0],", "1.0, 0.1],"),
        "along the optical axis",
    ),
    "rotation": (
        NATIVE.replace("[[1.0, 0.0, 0.0, -0.1]", "[[1.1, 0.0, 0.0, -0.1]"),
        "R is not a rotation",
    ),
    "mono": (ROS_LEFT, "one camera of a ROS pair"),
    "intrinsics alone": (OPENCV_INTRINSICS, "also give the extrinsics file"),
    "extrinsics alone": (OPENCV_EXTRINSICS, "also give the intrinsics file"),
    "a transform of 14 numbers": (
        "K1: [[478, 0, 289], [0, 478, 220], [0, 0, 1]]\n"
        "K2: [[478, 0, 289], [0, 478, 220], [0, 0, 1]]\n"
        "stereo:\n  T_right_left: [1, 0, 0, -0.12, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0]\n",
        r"stereo\.T_right_left holds 14 numbers, and a transform has 16 or 12",
    ),
    "a rotation of 8 numbers": (
        "K1: [[478, 0, 289], [0, 478, 220], [0, 0, 1]]\n"
        "K2: [[478, 0, 289], [0, 478, 220], [0, 0, 1]]\n"
        "R: [1, 0, 0, 0, 1, 0, 0, 0]\nT: [-0.12, 0, 0]\n",
        "R holds 8 numbers, and a rotation has 9",
    ),
    "a lens of 8 numbers": (
        "K1: [478, 0, 289, 0, 478, 220, 0, 0]\nR: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.12, 0, 0]\n"
        "K2: [478, 0, 289, 0, 478, 220, 0, 0, 1]\n",
        "K1 holds 8 numbers, and a camera matrix has 9",
    ),
    "three cameras": (KALIBR + "cam2:\n  camera_model: pinhole\n", "more than two cameras"),
    "doffs": (MIDDLEBURY.replace("131.111\n", "31.1\n"), "one is wrong"),
    "other": ("name: something\nkeys: 3\n", "not a calibration of a known format"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_by_name(case: str, tmp_path: Path) -> None:
    text, message = REFUSED[case]
    file = tmp_path / "cam.yaml"
    file.write_text(text)
    with pytest.raises(CalibrationError, match=message):
        load_rig(file)


def test_two_mono_calibrations_hold_no_baseline(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="two single-camera calibrations"):
        load_rig(write_ros(tmp_path, ROS_LEFT, ROS_LEFT.replace("/left", "/right")))


def test_swapped_ros_files(tmp_path: Path) -> None:
    write_ros(tmp_path)
    with pytest.raises(CalibrationError, match="left and right are swapped"):
        load_rig(f"{tmp_path}/right.yaml,{tmp_path}/left.yaml")


def test_folder_with_two_rigs_is_ambiguous(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(KALIBR)
    (tmp_path / "b.yaml").write_text(NATIVE)
    with pytest.raises(CalibrationError, match="name the file"):
        load_rig(tmp_path)


def test_writers_refuse_what_their_format_cannot_hold(tmp_path: Path) -> None:
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    T = np.eye(4)
    T[0, 3] = -0.1
    tilted = Camera(K, np.full(14, 0.01), (640, 480))
    with pytest.raises(CalibrationError, match="no distortion model of 14"):
        write_rig(StereoRig(tilted, tilted, T), tmp_path / "pair", "ros")
    five = Camera(K, np.full(5, 0.01), (640, 480))
    with pytest.raises(CalibrationError, match="radtan has only k1 k2 p1 p2"):
        write_rig(StereoRig(five, five, T), tmp_path / "camchain.yaml", "kalibr")
    with pytest.raises(CalibrationError, match="two files: give"):
        write_rig(StereoRig(five, five, T), tmp_path / "one.yaml", "ros")
    four = Camera(K, np.full(4, 0.01), (640, 480))
    with pytest.raises(CalibrationError, match="left and right are swapped: exchange the sides"):
        write_rig(StereoRig(four, four, np.linalg.inv(T)), tmp_path / "camchain.yaml", "kalibr")
