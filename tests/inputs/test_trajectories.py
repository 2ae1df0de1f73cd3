"""Conventions of trajectory formats, each on a case small enough to check by hand."""

import json
from pathlib import Path
from typing import Literal

import numpy as np
import pyproj
import pytest

from stereo_seecolor.config import MappingConfig, MountConfig
from stereo_seecolor.earth import north_east_from_degrees
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory, rectified_trajectory
from stereo_seecolor.records import GeoOrigin

# A camera that looks down with the top of its image to the north: right is east, down (in the
# image) is south.
NORTH_UP = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
# The same with the top to the east: right is south, image-down is west.
EAST_UP = np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])

OPLAB = (
    "relative_path,northing [m],easting [m],depth [m],roll [deg],pitch [deg],heading "
    "[deg],altitude [m],timestamp [s],latitude [deg],longitude [deg]\n"
)
ACFR_HEAD = "% STEREO_POSE_FILE VERSION 2\n%\nORIGIN_LATITUDE -23.5\nORIGIN_LONGITUDE 152.0\n"


def write(tmp_path: Path, text: str, name: str = "trajectory.txt") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def test_tum_is_camera_to_world_with_w_last(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    trajectory = read_trajectory(
        write(tmp_path, f"# time x y z qx qy qz qw\n10.5 1 2 3 0 0 {half} {half}\n")
    )
    # 90 degrees about z: the camera's x axis becomes the world's y axis
    np.testing.assert_allclose(
        trajectory.T_world_camera[0] @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-12
    )
    assert trajectory.timestamps_s.tolist() == [10.5]
    assert trajectory.up == "z"


def test_tum_that_starts_at_identity_does_not_know_up(tmp_path: Path) -> None:
    assert read_trajectory(write(tmp_path, "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")).up == "unknown"


@pytest.mark.parametrize(
    ("poses_of", "turned"), [("format", False), ("rectified", False), ("raw", True)]
)
def test_whose_poses_a_file_holds_can_be_said(
    tmp_path: Path, poses_of: Literal["format", "raw", "rectified"], turned: bool
) -> None:
    path = write(tmp_path, "0 1 2 3 0 0 0 1\n")
    T_rectified_left = np.eye(4)
    T_rectified_left[:3, :3], T_rectified_left[:3, 3] = EAST_UP, [0.0, 0, -0.02]
    pose = rectified_trajectory(
        path, MappingConfig(poses_of=poses_of), T_rectified_left
    ).T_world_camera[0]
    as_written = read_trajectory(path).T_world_camera[0]
    np.testing.assert_allclose(pose @ T_rectified_left if turned else pose, as_written, atol=1e-12)


def test_kitti_rows_are_camera_to_world(tmp_path: Path) -> None:
    path = write(tmp_path, "1 0 0 0 0 1 0 0 0 0 1 0\n0 -1 0 5 1 0 0 6 0 0 1 7\n")
    trajectory = read_trajectory(path)
    np.testing.assert_allclose(trajectory.T_world_camera[1] @ [1, 0, 0, 1], [5, 7, 7, 1])
    assert np.isnan(trajectory.timestamps_s).all()
    write(tmp_path, "0.0\n0.5\n", "times.txt")
    assert read_trajectory(path).timestamps_s.tolist() == [0.0, 0.5]


def test_tartanair_is_north_east_down_without_times(tmp_path: Path) -> None:
    trajectory = read_trajectory(write(tmp_path, "1 2 3 0 0 0 1\n4 5 6 0 0 0 1\n", "pose_left.txt"))
    # north 1, east 2, down 3; the camera looks north: its z axis is the map's y axis, its x axis
    # east, its y axis down
    T = trajectory.T_world_camera[0]
    np.testing.assert_allclose(T[:3, 3], [2, 1, -3])
    np.testing.assert_allclose(T[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    assert np.isnan(trajectory.timestamps_s).all()
    assert trajectory.up == "z"


def test_seven_numbers_without_a_quaternion_are_no_trajectory(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is rows of 7 columns without names"):
        read_trajectory(write(tmp_path, "1790000000 1 2 3 10 20 30\n"))


def test_transforms_of_nerf_have_the_axes_of_opengl(tmp_path: Path) -> None:
    # with an object's scale, as Blender leaves it
    matrix = [[2.0, 0, 0, 5], [0, 2, 0, 6], [0, 0, 2, 7], [0, 0, 0, 1]]
    text = json.dumps(
        {
            "camera_angle_x": 0.9,
            "frames": [{"file_path": "./render/0001_L", "transform_matrix": matrix}],
        },
        indent=1,
    )
    trajectory = read_trajectory(write(tmp_path, text, "transforms.json"))
    np.testing.assert_allclose(
        trajectory.T_world_camera[0], [[1, 0, 0, 5], [0, -1, 0, 6], [0, 0, -1, 7], [0, 0, 0, 1]]
    )
    assert trajectory.names == ("./render/0001_L",)
    assert trajectory.up == "unknown"


@pytest.mark.parametrize(
    "frames",
    [[], [{"file_path": "a"}], [{"file_path": "a", "transform_matrix": [[1, 0], [0, 1]]}], 5],
)
def test_transforms_without_poses_are_refused(tmp_path: Path, frames: object) -> None:
    text = json.dumps({"is": "transform_matrix", "frames": frames})
    with pytest.raises(InputError, match="transform_matrix"):
        read_trajectory(write(tmp_path, text, "transforms.json"))


def test_colmap_is_world_to_camera_with_w_first(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    header = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
    text = f"{header}1 {half} 0 0 {half} 1 2 3 1 left/a 1.png\n\n2 1 0 0 0 0 0 0 1 b.png\n1 2 3\n"
    trajectory = read_trajectory(write(tmp_path, text, "images.txt"))
    assert trajectory.names == ("left/a 1.png", "b.png")
    # x_camera = R x_world + t with R 90 degrees about z: the camera center is -R^T t = (-2, 1, -3)
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [-2, 1, -3], atol=1e-12)


def test_poses_of_the_right_camera_are_left_out_of_a_file_of_both(tmp_path: Path) -> None:
    rows = [
        f"{i} 1 0 0 0 {x} 0 0 1 {side}/{i:04d}.png\n0 0 -1\n"
        for i in range(3)
        for side, x in (("left", 0), ("right", -0.1))
    ]
    (tmp_path / "images.txt").write_text(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n" + "".join(rows)
    )
    trajectory = read_trajectory(tmp_path / "images.txt")
    assert trajectory.names == ("left/0000.png", "left/0001.png", "left/0002.png")
    assert not trajectory.T_world_camera[:, 0, 3].any()


def test_oplab_is_north_east_down_with_the_vehicles_heading(tmp_path: Path) -> None:
    rows = "a/1.png,10,20,5,0,0,0,2,100,50,-10\na/2.png,10,21,5,0,0,90,None,101,50,-10\n"
    trajectory = read_trajectory(
        write(tmp_path, OPLAB + rows, "auv_ekf_LC.csv"), MountConfig(xyz_m=(1, 0, 0))
    )
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [20, 10, -5])
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, :3], NORTH_UP, atol=1e-12)
    np.testing.assert_allclose(trajectory.T_world_camera[1, :3, :3], EAST_UP, atol=1e-12)
    # northing is the camera's, latitude the vehicle's, 1 m behind it: the origin lies 9 m south, 20
    # m west of the vehicle
    assert trajectory.origin is not None
    meters = north_east_from_degrees([50], [-10], trajectory.origin)[0]
    np.testing.assert_allclose(meters, [9, 20], atol=1e-3)


def test_oplab_mount_turns_the_camera(tmp_path: Path) -> None:
    path = write(tmp_path, "#" + OPLAB + "1.png,0,0,5,0,0,0,2,100,50,-10\n")
    trajectory = read_trajectory(path, MountConfig(rpy_deg=(0, 0, 0)))
    # no yaw: the image's right is the bow, north
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 0], [0, 1, 0], atol=1e-12)


def test_a_vehicle_that_rolls_to_starboard_looks_to_port(tmp_path: Path) -> None:
    trajectory = read_trajectory(write(tmp_path, OPLAB + "1.png,0,0,5,10,0,0,2,100,50,-10\n"))
    # heading north, starboard (east) side down: the optical axis swings to the west
    axis = trajectory.T_world_camera[0, :3, 2]
    np.testing.assert_allclose(
        axis, [-np.sin(np.radians(10)), 0, -np.cos(np.radians(10))], atol=1e-12
    )


def test_acfr_angles_are_the_cameras_own(tmp_path: Path) -> None:
    quarter = np.pi / 2
    rows = f"1 100.5 -23.5 152.0 1 2 3 0 0 {quarter} L1.png R1.png 2.0 1.5 0\n"
    trajectory = read_trajectory(write(tmp_path, ACFR_HEAD + rows, "stereo_pose_est.data"))
    # yaw 90 degrees in north-east-down: the image's right is east, so its top is north
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, :3], NORTH_UP, atol=1e-12)
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [2, 1, -3])
    assert trajectory.origin == GeoOrigin(-23.5, 152.0)
    assert trajectory.names == ("L1.png",)


IMOS = (
    "year,month,day,hour,minute,second,{},depth,latitude,longitude,roll,pitch,heading,altitude,"
    "leftimage,rightimage\n"
)


@pytest.mark.parametrize("names", ["northing,easting", "local_north,local_east"])
def test_imos_tracks_are_poses_of_acfr(tmp_path: Path, names: str) -> None:
    """The camera's own angles in radians, also below remarks."""
    quarter = np.pi / 2
    row = f"2026,10,16,12,0,1.5,111,0,3,-23.499,152.0,0,0,{quarter},2.0,L1.png,R1.png\n"
    for remarks in ("", "NOTE: a dive\nOrigin\n\n"):
        trajectory = read_trajectory(write(tmp_path, remarks + IMOS.format(names) + row, "a.csv"))
        np.testing.assert_allclose(trajectory.T_world_camera[0, :3, :3], NORTH_UP, atol=1e-12)
        np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [0, 111, -3])
        assert trajectory.names == ("L1.png",) and trajectory.camera == "raw"
        assert trajectory.timestamps_s.tolist() == [1792152001.5]
        assert trajectory.origin is not None
        assert trajectory.origin.latitude_deg == pytest.approx(-23.5, abs=1e-5)
        assert trajectory.origin.longitude_deg == 152
    degrees = IMOS.format(names) + row.replace(str(quarter), "90")
    with pytest.raises(InputError, match="angles are radians, but its angles reach 90"):
        read_trajectory(write(tmp_path, degrees, "a.csv"))


@pytest.mark.parametrize("points", [0, 1, 4, 5, 6])
def test_colmap_is_known_whatever_the_number_of_points_of_its_last_image(
    tmp_path: Path, points: int
) -> None:
    text = "1 1 0 0 0 1 2 3 1 a.png\n" + " ".join("10.5 20.5 -1" for _ in range(points)) + "\n"
    trajectory = read_trajectory(write(tmp_path, text, "images.txt"))
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [-1, -2, -3])


@pytest.mark.parametrize("columns", [13, 15])
def test_acfr_poses_are_known_without_a_header(tmp_path: Path, columns: int) -> None:
    degrees = "-23.5 152.0 " if columns == 15 else ""
    trajectory = read_trajectory(
        write(tmp_path, f"1 100.5 {degrees}1 2 3 0 0 0 L1.png R1.png 2.0 1.5 0\n")
    )
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [2, 1, -3])


def test_orca_depth_of_zero_is_unknown(tmp_path: Path) -> None:
    text = (
        "image_name,image_path,timestamp_utc,latitude,longitude,heading_deg,depth_m\n"
        "a.jpg,x/a.jpg,2022-08-01T12:00:00Z,20,-156,0,8\nb.jpg,x/b.jpg,2022-08-01T12:00:01Z,20.0001,-156,90,0\n"
    )
    trajectory = read_trajectory(write(tmp_path, text, "processed_images.csv"))
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [0, 0, -8])
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, :3], NORTH_UP, atol=1e-12)
    assert np.isnan(trajectory.T_world_camera[1, 2, 3])
    assert np.diff(trajectory.timestamps_s).tolist() == [1.0]


@pytest.mark.parametrize(
    "text",
    [
        "DATE,TIME,LATITUDE,LONGITUDE,DEPTH,ALTITUDE,HEADING,PITCH,ROLL\n02/01/2020,00:00:01.5,45,5,100,2,90,0,0\n",
        "##date_dd/MM/yyyy,time,latitude,longitude,depth,heading,pitch,roll\n2020/01/02,00:00:01.5,45,5,100,90,0,0\n",
        "dive1;02/01/2020;00:00:01.5;src;img;a.jpg;45;5;100;2;90;0;0;1;0;0\n",
    ],
)
def test_matisse_variants_agree(tmp_path: Path, text: str) -> None:
    trajectory = read_trajectory(write(tmp_path, text, "nav.csv"))
    assert trajectory.timestamps_s.tolist() == [1577923201.5]
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [0, 0, -100])
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, :3], EAST_UP, atol=1e-12)


def test_dim2_gives_roll_before_pitch(tmp_path: Path) -> None:
    path = write(
        tmp_path, "d;02/01/2020;00:00:01;s;img;a.jpg;45;5;100;2;0;10;0;1;0;0\n", "nav.dim2"
    )
    np.testing.assert_allclose(
        read_trajectory(path).T_world_camera[0, 0, 2], -np.sin(np.radians(10)), atol=1e-12
    )


def test_degrees_agree_with_a_map_projection() -> None:
    origin = GeoOrigin(-23.5, 152.0)
    project = pyproj.Proj(
        proj="tmerc", lat_0=origin.latitude_deg, lon_0=origin.longitude_deg, k=1, ellps="WGS84"
    )
    latitude, longitude = -23.5 + np.array([0.004, -0.002]), 152.0 + np.array([0.003, 0.004])
    east, north = project(longitude, latitude)
    np.testing.assert_allclose(
        north_east_from_degrees(latitude, longitude, origin), np.stack([north, east], -1), atol=1e-3
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello\n", "not a trajectory of a known format"),
        ("# only a comment\n", "not a trajectory of a known format"),
        ("", "is empty"),
        ("0 0 0 0 0 0 0 1\n1 2 3\n", "line 2: a TUM pose has 8 numbers"),
        ("nan nan nan nan nan nan nan nan\n", "no finite pose"),
        ("1 0 0 0 0 1 0 0 0 0 1 x\n", "line 1: expected numbers"),
        (b"\xff\xfe\x00", "is not text"),
        ("0 0 0 1e300 0 0 0 1\n", "line 1: 1e\\+300 is neither a position nor a time"),
        ("0 0 0 inf 0 0 0 1\n", "line 1: inf is neither"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, text: str | bytes, message: str) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message):
        read_trajectory(path)


def test_a_zero_quaternion_is_no_pose(tmp_path: Path) -> None:
    trajectory = read_trajectory(write(tmp_path, "0 0 0 1 1 0 0 0\n1 0 0 1 0 0 0 0\n"))
    assert np.isfinite(trajectory.T_world_camera).all(axis=(1, 2)).tolist() == [True, False]


EUROC = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z [], v_RS_R_x [m s^-1]"
)


@pytest.mark.parametrize(
    "table",
    [
        f"{EUROC}\n1000500000000000000,1,2,3,0.5,-0.5,0.5,0.5,9\n",
        "timestamp,tx,ty,tz,qx,qy,qz,qw\n1000500000,1,2,3,-0.5,0.5,0.5,0.5\n",
        "1000500000000000000,1,2,3,-0.5,0.5,0.5,0.5\n",
        "1000500000.0, 1, 2, 3, -0.5, 0.5, 0.5, 0.5\n",
        "%time,field.header.seq,"
        + ",".join(f"field.pose.pose.position.{axis}" for axis in "xyz")
        + ","
        + ",".join(f"field.pose.pose.orientation.{part}" for part in "xyzw")
        + "\n1000500000000000000,7,1,2,3,-0.5,0.5,0.5,0.5\n",
    ],
)
def test_poses_in_tables_are_those_of_tum(tmp_path: Path, table: str) -> None:
    plain = read_trajectory(write(tmp_path, "1000500000 1 2 3 -0.5 0.5 0.5 0.5\n", "a.tum"))
    found = read_trajectory(write(tmp_path, table, "data.csv"))
    np.testing.assert_allclose(found.T_world_camera, plain.T_world_camera)
    np.testing.assert_allclose(found.timestamps_s, [1000500000.0])
