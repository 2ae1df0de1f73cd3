"""Fusing a run's folder: whose poses they are, who else writes there, and what is damaged in it."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Dive
from mapping_scene import ReefFrames, height_at, read_cloud, write_run
from numpy.typing import NDArray

from calibration import Camera, Rectification, StereoRig
from calibration.formats import write_rig
from calibration.port import FlatPort, FlatWindow
from calibration.rectification import rectified_points
from calibration.refraction import CameraInWater
from stereo_seecolor import jobs
from stereo_seecolor.config import MappingConfig, RunConfig
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.inputs.trajectories.axes import R_ENU_NED
from stereo_seecolor.mapping import fusion
from stereo_seecolor.mapping.poses import inverse, rotation_from_vector
from stereo_seecolor.synthetic.survey import SurveySpec

try:
    fusion.check_available()
except DeviceError as error:
    pytest.skip(str(error), allow_module_level=True)

MAPPING = MappingConfig(voxel_m=0.02, mosaic_m=0.02, dem_m=0.02)


def toed_in_rig(port: FlatPort | None = None, size: tuple[int, int] = (640, 480)) -> StereoRig:
    """The left camera is turned by five degrees by rectification."""
    camera = Camera(np.array([[0.8 * size[0], 0, size[0] / 2], [0, 0.8 * size[0], size[1] / 2], [0, 0, 1]]), np.zeros(5), size)
    T = np.eye(4)
    T[:3, :3] = rotation_from_vector(np.array([0.03, 0.17, -0.02]))
    T[:3, 3] = T[:3, :3] @ [-0.12, 0.004, 0.006]
    return StereoRig(camera, camera, T, "air" if port else "water", port=port)


def test_poses_of_the_raw_camera_put_things_where_the_rectified_image_shows_them() -> None:
    rig = toed_in_rig()
    T_world_raw = np.eye(4)
    T_world_raw[:3, :3], T_world_raw[:3, 3] = rotation_from_vector(np.array([2.9, 0.3, -0.2])), [3, -2, 1]
    points_raw = np.random.default_rng(0).uniform([-0.5, -0.4, 1.5], [0.5, 0.4, 2.5], (20, 3))
    points_world = points_raw @ T_world_raw[:3, :3].T + T_world_raw[:3, 3]
    shown, _ = rectified_points(rig, *[cv2.projectPoints(points_raw, np.zeros(3), np.zeros(3), rig.left.K, None)[0][:, 0]] * 2)
    rectification = Rectification.from_rig(rig)
    T = inverse(T_world_raw @ inverse(rectification.T_rectified_left))
    projected = (points_world @ T[:3, :3].T + T[:3, 3]) @ rectification.pair.P_left.T
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], shown, atol=1e-6)


def test_behind_a_flat_port_the_rectified_cameras_centre_moves_as_well() -> None:
    window = FlatWindow(0.05, 0.01, np.array([0.0, 0, 1]))
    rig = toed_in_rig(FlatPort(window, window, 2.0, 1.34))
    rectification = Rectification.from_rig(rig)
    left = CameraInWater(rig.left, window, rig.port)  # type: ignore[arg-type]
    points_raw = np.random.default_rng(0).uniform([-0.5, -0.4, 1.5], [0.5, 0.4, 2.5], (20, 3))
    shown, _ = rectified_points(rig, *[left.project_points(points_raw)] * 2)
    T = rectification.T_rectified_left
    projected = (points_raw @ T[:3, :3].T + T[:3, 3]) @ rectification.pair.P_left.T
    assert np.abs(T[:3, 3]).max() > 0.01
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], shown, atol=0.5)


def test_a_run_writes_down_how_rectification_turned_the_camera(make_dive: Callable[..., Dive], tmp_path: Path) -> None:
    dive = make_dive(1)
    rig = toed_in_rig(size=(176, 128))
    write_rig(rig, dive.root / "toed.yaml")
    jobs.run(dive.root / "L", dive.root / "R", dive.root / "toed.yaml", tmp_path / "out")
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    np.testing.assert_allclose(run["T_rectified_left"], Rectification.from_rig(rig).T_rectified_left, atol=1e-9)
    assert np.abs(np.subtract(run["T_rectified_left"], np.eye(4))).max() > 0.05


def acfr_text(names: tuple[str, ...], T_world_raw: NDArray[np.float64]) -> str:
    """Poses in east-north-up as ACFR writes them: north-east-down, Euler angles in radians."""
    rows = ["% STEREO_POSE_FILE VERSION 2", "-23.5", "152.0"]
    for i, (name, T) in enumerate(zip(names, T_world_raw, strict=True)):
        R, (north, east, down) = R_ENU_NED.T @ T[:3, :3], R_ENU_NED.T @ T[:3, 3]
        angles = np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])
        numbers = [i, i, -23.5, 152.0, north, east, down, *angles]
        rows.append(" ".join(f"{n:.9f}" for n in numbers) + f" {name}.png {name}_R.png 2 1 0")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(("poses_of", "true"), [("format", True), ("raw", True), ("rectified", False)])
def test_a_raw_cameras_navigation_gives_the_true_reef(tmp_path: Path, poses_of: str, true: bool) -> None:
    frames = ReefFrames(SurveySpec(pairs=6, lines=2, image_size=(240, 192)), noise_px=0.05)
    T = Rectification.from_rig(toed_in_rig()).T_rectified_left
    write_run(tmp_path, frames, frames.pair, T)
    poses = tmp_path / "stereo_pose_est.data"
    poses.write_text(acfr_text(frames.trajectory.names, frames.trajectory.T_world_camera @ T))
    config = RunConfig(mapping=MAPPING.model_copy(update={"poses_of": poses_of}))
    jobs.fuse(tmp_path, poses, config)
    position = read_cloud(tmp_path / "map" / "cloud.ply")["position"]
    error_m = np.median(np.abs(position[:, 2] - height_at(frames.reef, position)))
    assert error_m < 0.01 if true else error_m > 0.03
