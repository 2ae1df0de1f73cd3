"""Metashape's exports: cameras as XML, reference as text."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_trajectories import EAST_UP, NORTH_UP, write

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory

GEOGRAPHIC = 'GEOGCS["WGS 84",DATUM["World Geodetic System 1984"]]'
LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0]]'
SCALE, TURN, SHIFT = (
    2.0,
    Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(),
    np.array([3.0, -4.0, 5.0]),
)


def numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def similarity(scale: float, R: np.ndarray, t: np.ndarray) -> str:
    parts = ("rotation", R), ("translation", t), ("scale", np.array(scale))
    return (
        "<transform>"
        + "".join(f"<{name}>{numbers(values)}</{name}>" for name, values in parts)
        + "</transform>"
    )


def cameras_xml(
    T_world: dict[str, np.ndarray], reference: str, *, in_component: bool = False
) -> str:
    """Cameras whose poses in the world are known, put into a chunk that is turned, moved and half
    as large.
    """
    cameras = []
    for i, (label, T) in enumerate(T_world.items()):
        chunk = np.eye(4)
        chunk[:3, :3], chunk[:3, 3] = TURN.T @ T[:3, :3], TURN.T @ (T[:3, 3] - SHIFT) / SCALE
        cameras.append(
            f'<camera id="{i}" component_id="0" '
            f'label="{label}">\n<transform>{numbers(chunk)}</transform>\n</camera>'
        )
    transform = similarity(SCALE, TURN, SHIFT)
    place = (
        f'<components>\n<component id="0">\n{transform}\n</component>\n</components>'
        if in_component
        else transform
    )
    lost = '<camera id="9" label="not aligned"/>'
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0">\n<chunk label="Chunk '
        f'1" enabled="true">\n{place}\n'
        f"<cameras>\n{''.join(cameras)}\n{lost}\n</cameras>\n<reference>{reference}</reference>\n</chunk>\n</document>\n"
    )


@pytest.mark.parametrize("in_component", [True, False])
def test_cameras_in_local_coordinates(tmp_path: Path, in_component: bool) -> None:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = EAST_UP, [1, 2, 3]
    trajectory = read_trajectory(
        write(tmp_path, cameras_xml({"a.png": T}, LOCAL, in_component=in_component), "cameras.xml")
    )
    np.testing.assert_allclose(trajectory.T_world_camera, [T], atol=1e-12)
    assert (trajectory.names, trajectory.up, trajectory.origin, trajectory.camera) == (
        ("a.png",),
        "z",
        None,
        "raw",
    )


def test_cameras_on_earth(tmp_path: Path) -> None:
    to_geocentric = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    at, east, north, up = (
        np.array(to_geocentric.transform(152.0 + d[0], -23.5 + d[1], -5.0 + d[2]))
        for d in ((0, 0, 0), (1e-6, 0, 0), (0, 1e-6, 0), (0, 0, 1))
    )
    axes = np.array([(end - at) / np.linalg.norm(end - at) for end in (east, north, up)])
    T = {label: np.eye(4) for label in "ab"}
    for label, moved in (("a", 0.0), ("b", 2.0)):
        T[label][:3, :3], T[label][:3, 3] = axes.T @ NORTH_UP, at + moved * axes[0]
    trajectory = read_trajectory(write(tmp_path, cameras_xml(T, GEOGRAPHIC), "cameras.xml"))
    np.testing.assert_allclose(
        trajectory.T_world_camera[:, :3, :3], [NORTH_UP, NORTH_UP], atol=1e-7
    )
    np.testing.assert_allclose(
        trajectory.T_world_camera[:, :3, 3], [[0, 0, -5], [2, 0, -5]], atol=1e-6
    )
    assert trajectory.origin is not None
    assert (trajectory.origin.latitude_deg, trajectory.origin.longitude_deg) == (
        pytest.approx(-23.5),
        pytest.approx(152.0),
    )


def test_cameras_without_a_transform_know_neither_scale_nor_up(tmp_path: Path) -> None:
    text = cameras_xml({"a": np.eye(4)}, "").replace(similarity(SCALE, TURN, SHIFT), "")
    assert read_trajectory(write(tmp_path, text, "cameras.xml")).up == "unknown"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("</document>", ""), "is not XML"),
        (("<document", "<!DOCTYPE x [<!ENTITY a 'b'>]>\n<document"), "defines entities"),
        (("<transform>", "<transform>7 "), "its transform needs 16 numbers"),
        (("<camera id=", "<cam id="), "is not XML"),
    ],
)
def test_bad_xml(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = cameras_xml({"a": np.eye(4)}, LOCAL).replace(*change)
    with pytest.raises(InputError, match=message):
        read_trajectory(write(tmp_path, text, "cameras.xml"))


def test_no_camera_is_aligned(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no aligned camera"):
        read_trajectory(write(tmp_path, cameras_xml({}, LOCAL), "cameras.xml"))


HEADER = "#Label,X/Longitude,Y/Latitude,Z/Altitude,Yaw,Pitch,Roll,Error_(m),X_est,Y_est,Z_est,Yaw_est,Pitch_est,Roll_est\n"  # noqa: E501


def test_reference_takes_what_was_estimated(tmp_path: Path) -> None:
    rows = "a.jpg,152,-23.5,-5,9,9,9,0.1,152.0,-23.5,-6,0,0,0\nb.jpg,,,,,,,,152.0,-23.5,-6,90,0,0\nc.jpg,,,,,,,,,,,,,\n"  # noqa: E501
    text = f"# CoordinateSystem: {GEOGRAPHIC}\n{HEADER}{rows}# Total Error,1,2\n"
    trajectory = read_trajectory(
        write(tmp_path, text, "reference.txt"), MountConfig(rpy_deg=(30, 0, 90))
    )
    assert trajectory.names == ("a.jpg", "b.jpg", "c.jpg")
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [0, 0, -6], atol=1e-9)
    np.testing.assert_allclose(
        trajectory.T_world_camera[:2, :3, :3], [NORTH_UP, EAST_UP], atol=1e-12
    )
    assert np.isnan(trajectory.T_world_camera[2, :3]).any()
    assert trajectory.origin is not None


def test_a_reference_without_angles_says_what_to_export(tmp_path: Path) -> None:
    text = "#Label,X/Longitude,Y/Latitude,Z/Altitude\na.jpg,145.5,-14.5,-5\n"
    with pytest.raises(InputError, match=r"without yaw, pitch, roll: export the cameras .*XML"):
        read_trajectory(write(tmp_path, text, "reference.csv"))


def test_reference_in_local_meters(tmp_path: Path) -> None:
    text = (
        "# CoordinateSystem: "
        f"{LOCAL}\n#Label,X/East,Y/North,Z/Altitude,Yaw,Pitch,Roll\na.jpg,1,2,-3,0,90,0\n"
    )
    trajectory = read_trajectory(write(tmp_path, text, "reference.txt"))
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 3], [1, 2, -3])
    # pitch 90: looks north
    np.testing.assert_allclose(trajectory.T_world_camera[0, :3, 2], [0, 1, 0], atol=1e-12)
    assert trajectory.origin is None


@pytest.mark.slow
@given(st.tuples(*[st.floats(-180, 180)] * 3))
def test_yaw_pitch_roll_are_metashapes(
    tmp_path_factory: pytest.TempPathFactory, angles: tuple[float, float, float]
) -> None:
    """Metashape's matrix is Rz(-yaw) Rx(pitch) Ry(roll), of a camera whose y points up in the image
    and z backward.
    """
    yaw, pitch, roll = angles
    text = (
        "# CoordinateSystem: "
        f"{LOCAL}\n#Label,X,Y,Z,Yaw,Pitch,Roll\na.jpg,0,0,0,{yaw},{pitch},{roll}\n"
    )
    found = read_trajectory(
        write(tmp_path_factory.mktemp("m"), text, "reference.txt")
    ).T_world_camera[0, :3, :3]
    expected = Rotation.from_euler("ZXY", [-yaw, pitch, roll], degrees=True).as_matrix() @ np.diag(
        [1.0, -1, -1]
    )
    np.testing.assert_allclose(found, expected, atol=1e-9)
