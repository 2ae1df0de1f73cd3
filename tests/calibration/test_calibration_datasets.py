"""Calibrations of the vision data sets that people try a stereo program on first: KITTI and
EuRoC.
"""

from pathlib import Path

import numpy as np
import pytest

from calibration import CalibrationError
from calibration.formats import format_name, load_rig
from calibration.rig import for_channels
from stereo_seecolor.commands.inspect_rig import find_calibration

P = {
    "0": "7.215377e+02 0 6.095593e+02 0 0 7.215377e+02 1.728540e+02 0 0 0 1 0",
    "1": "7.215377e+02 0 6.095593e+02 -3.875744e+02 0 7.215377e+02 1.728540e+02 0 0 0 1 0",
    "2": "7.215377e+02 0 6.095593e+02 4.485728e+01 0 7.215377e+02 1.728540e+02 2.163791e-01 0 0 "
    "1 2.745884e-03",
    "3": "7.215377e+02 0 6.095593e+02 -3.395242e+02 0 7.215377e+02 1.728540e+02 2.199936e+00 0 0 "
    "1 2.729905e-03",
}
RAW = """calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1392 512
K_00: 984 0 690 0 980 233 0 0 1
D_00: -0.37 0.2 0.001 0.002 -0.07
R_rect_00: 1 0 0 0 1 0 0 0 1
S_rect_00: 1242 375
P_rect_00: 720 0 609 0 0 720 173 0 0 0 1 0
S_01: 1392 512
K_01: 989 0 702 0 984 245 0 0 1
D_01: -0.36 0.19 0.001 0 -0.07
R_rect_01: 0.8 -0.6 0 0.6 0.8 0 0 0 1
S_rect_01: 1242 375
P_rect_01: 720 0 609 -360 0 720 173 0 0 0 1 0
"""


def kitti(folder: Path, cameras: str) -> Path:
    file = folder / "calib.txt"
    file.write_text(
        "".join(f"P{camera}: {P[camera]}\n" for camera in cameras) + "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n"
    )
    return file


def test_the_gray_cameras_are_rectified(tmp_path: Path) -> None:
    rig = load_rig(kitti(tmp_path, "01"), (1242, 375))
    assert rig.is_rectified
    assert rig.baseline_m == pytest.approx(387.5744 / 721.5377)
    assert not rig.doubts


@pytest.mark.parametrize("cameras", ["01", "0123"])
def test_projections_without_names(cameras: str, tmp_path: Path) -> None:
    (tmp_path / "calib.txt").write_text("".join(f"{P[camera]}\n" for camera in cameras))
    rig, named = (
        load_rig(tmp_path / "calib.txt", (1242, 375)),
        load_rig(kitti(tmp_path, cameras), (1242, 375)),
    )
    np.testing.assert_array_equal(rig.T_right_left, named.T_right_left)
    np.testing.assert_array_equal(rig.left.K, named.left.K)


def test_poses_are_no_projections(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text(2 * "1 0 0 12.5 0 1 0 0 0 0 1 30\n")
    with pytest.raises(CalibrationError, match="not a calibration"):
        load_rig(tmp_path / "poses.txt", (1242, 375))


def test_of_four_cameras_color_is_taken_and_said(tmp_path: Path) -> None:
    file = kitti(tmp_path, "0123")
    rig = load_rig(file, (1242, 375))
    assert format_name(file) == "kitti"
    assert rig.baseline_m == pytest.approx(0.5327, abs=1e-4)
    assert (
        "color cameras 2 and 3 (baseline 532.7 mm) and the gray ones 0 and 1 (537.2 mm)"
        in rig.doubts[0]
    )


def test_of_four_cameras_the_images_choose(tmp_path: Path) -> None:
    rig = load_rig(kitti(tmp_path, "0123"), (1242, 375))
    assert for_channels(rig, monochrome=False).baseline_m == pytest.approx(0.5327, abs=1e-4)
    gray = for_channels(rig, monochrome=True)
    assert gray.baseline_m == pytest.approx(0.5372, abs=1e-4)
    assert "the gray cameras are used" in gray.doubts[0]
    assert gray.alternatives == ()


def test_points_project_as_the_file_says(tmp_path: Path) -> None:
    rig = load_rig(kitti(tmp_path, "23"), (1242, 375))
    point = np.array([2.0, 1.0, 20.0, 1.0])
    seen = [np.array(P[camera].split(), float).reshape(3, 4) @ point for camera in "23"]
    left = np.linalg.inv(rig.left.K) @ seen[0]
    np.testing.assert_allclose(rig.left.project(left[None])[0], seen[0][:2] / seen[0][2])
    right = rig.T_right_left[:3, :3] @ left + rig.T_right_left[:3, 3]
    np.testing.assert_allclose(rig.right.project(right[None])[0], seen[1][:2] / seen[1][2])


def test_sizes_tell_raw_images_from_rectified_ones(tmp_path: Path) -> None:
    file = tmp_path / "calib_cam_to_cam.txt"
    file.write_text(RAW)
    rectified, raw = load_rig(file, (1242, 375)), load_rig(file, (1392, 512))
    assert rectified.is_rectified
    assert not raw.is_rectified
    assert rectified.baseline_m == pytest.approx(0.5)
    assert raw.baseline_m == pytest.approx(0.5)
    assert (raw.left.K[0, 0], raw.right.distortion[0]) == (984, -0.36)
    np.testing.assert_allclose(
        raw.R, np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]]).T, atol=1e-12
    )


def test_a_file_without_a_size_says_so(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="stores no image size"):
        load_rig(kitti(tmp_path, "01"))


EUROC = """%YAML:1.0
# General sensor definitions.
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [{}, 0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [{}] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
"""
POSES = (
    "0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975, 0.999557249008, "
    "0.0149672133247, 0.025715529948, "
    "-0.064676986768, -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949",
    "0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556, 0.999598781151, "
    "0.0130119051815, 0.0251588363115, "
    "0.0453689425024, -0.0253898008918, 0.0179005838253, 0.999517347078, 0.00786212447038",
)


def euroc(folder: Path, order: tuple[int, int] = (0, 1)) -> Path:
    for camera, number in zip(("cam0", "cam1"), order, strict=True):
        (folder / camera).mkdir()
        (folder / camera / "sensor.yaml").write_text(
            EUROC.format(POSES[number], "458.654, 457.296, 367.215, 248.375")
        )
    return folder


def test_euroc_as_a_folder_and_as_two_files(tmp_path: Path) -> None:
    folder = euroc(tmp_path)
    for given in (folder, f"{folder}/cam0/sensor.yaml,{folder}/cam1/sensor.yaml"):
        rig = load_rig(given)
        assert rig.baseline_m == pytest.approx(0.1101, abs=1e-4)
        assert rig.left.image_size == (752, 480)


def test_euroc_is_found_in_the_folder_of_a_dive(tmp_path: Path) -> None:
    (tmp_path / "dive" / "mav0").mkdir(parents=True)
    folder = euroc(tmp_path / "dive" / "mav0")
    assert [
        (one.path, one.format) for one in find_calibration([tmp_path / "dive"], (752, 480))
    ] == [(folder, "euroc")]


def test_one_camera_of_euroc_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="one camera of a EuRoC pair"):
        load_rig(euroc(tmp_path) / "cam0" / "sensor.yaml")
