"""The track in a bag: odometry or poses, with the camera's place from the static transforms or the
settings.
"""

import numpy as np
import pytest
from bag_writers import (
    LEFT,
    RIGHT,
    START_NS,
    STEP_NS,
    STORES,
    Sent,
    make,
    raw,
    static_transform,
    write_bag,
)
from scipy.spatial.transform import Rotation

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory

FORMATS = (".bag", ".mcap", ".db3")
TURN = Rotation.from_euler("ZYX", [30, 5, -3], degrees=True)
"""The vehicle's, forward left up, against east north up."""

OPTICAL = Rotation.from_matrix([[0, -1, 0], [-1, 0, 0], [0, 0, -1]])
"""A camera that looks down with the top of its image to the bow: its x to starboard, its y to the
stern.
"""


def pose(suffix: str, position, turn: Rotation):
    return make(
        suffix,
        "Pose",
        make(suffix, "Point", *map(float, position)),
        make(suffix, "Quaternion", *turn.as_quat()),
    )


def odometry(suffix: str, number: int) -> Sent:
    zero = make(suffix, "Vector3", 0.0, 0.0, 0.0)
    twist = make(suffix, "TwistWithCovariance", make(suffix, "Twist", zero, zero), np.zeros(36))
    with_covariance = make(
        suffix, "PoseWithCovariance", pose(suffix, (number, 2.0, -10.0), TURN), np.zeros(36)
    )
    fields = {"child_frame_id": "base_link", "pose": with_covariance, "twist": twist}
    return Sent("/odom", "nav_msgs/msg/Odometry", START_NS + number * STEP_NS, fields)


def images() -> list[Sent]:
    pixels = np.zeros((8, 8, 3), np.uint8)
    # stamped with the frame "camera"
    return [raw(f"{camera}/image_raw", START_NS, pixels, "rgb8") for camera in (LEFT, RIGHT)]


@pytest.mark.parametrize("suffix", FORMATS)
def test_odometry_and_static_transforms_place_the_left_camera(suffix, tmp_path) -> None:
    rig = Rotation.from_euler("xyz", [0, 0, 10], degrees=True)
    statics = [
        static_transform(suffix, "base_link", "rig", (0.5, 0.1, -0.2), rig),
        static_transform(
            suffix, "camera", "rig", (0, 0, 0), OPTICAL.inv()
        ),  # written the other way around
    ]
    found = read_trajectory(
        write_bag(
            tmp_path / f"b{suffix}", [*images(), *statics, *(odometry(suffix, i) for i in range(4))]
        )
    )
    assert (found.camera, found.up, len(found.names)) == ("raw", "z", 4)
    np.testing.assert_allclose(
        found.timestamps_s[1] - found.timestamps_s[0], STEP_NS / 1e9, atol=1e-6
    )
    np.testing.assert_allclose(
        found.T_world_camera[2, :3, 3], np.array([2, 2, -10]) + TURN.apply((0.5, 0.1, -0.2))
    )
    np.testing.assert_allclose(
        found.T_world_camera[2, :3, :3], (TURN * rig * OPTICAL).as_matrix(), atol=1e-12
    )


def test_without_transforms_the_settings_say_where_the_camera_sits(tmp_path) -> None:
    bag = write_bag(tmp_path / "b.bag", [*images(), odometry(".bag", 1)])
    found = read_trajectory(bag, MountConfig(xyz_m=(0.4, 0.3, 0.1)))
    np.testing.assert_allclose(
        found.T_world_camera[0, :3, 3], np.array([1, 2, -10]) + TURN.apply((0.4, -0.3, -0.1))
    )
    np.testing.assert_allclose(
        found.T_world_camera[0, :3, :3], (TURN * OPTICAL).as_matrix(), atol=1e-12
    )


def test_poses_without_odometry_do_too(tmp_path) -> None:
    stamped = Sent(
        "/pose",
        "geometry_msgs/msg/PoseStamped",
        START_NS,
        {"pose": pose(".mcap", (1, 2, -3), TURN)},
    )
    found = read_trajectory(write_bag(tmp_path / "b.mcap", [stamped]))
    np.testing.assert_allclose(found.T_world_camera[0, :3, 3], (1, 2, -3))


def body_header(suffix: str, stamp_ns: int):
    types = STORES[suffix].types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    return types["std_msgs/msg/Header"](
        **({"seq": 0} if suffix == ".bag" else {}), stamp=stamp, frame_id="body"
    )


def quaternion(suffix: str, turn: Rotation):
    return make(suffix, "Quaternion", *turn.as_quat())


def fix(suffix: str, number: int, status: int = 0) -> Sent:
    state = STORES[suffix].types["sensor_msgs/msg/NavSatStatus"](status, 1)
    place = {
        "latitude": -23.5 + 1e-5 * number,
        "longitude": 152.1 + 2e-5 * number,
        "altitude": 40.0 - number,
    }
    fields = {
        "header": body_header(suffix, START_NS + number * 10**9),
        "status": state,
        **place,
        "position_covariance": np.zeros(9),
        "position_covariance_type": 0,
    }
    return Sent("/gps/fix", "sensor_msgs/msg/NavSatFix", START_NS + number * 10**9, fields)


def imu(suffix: str, milliseconds: int, turn: Rotation, known: bool = True) -> Sent:
    zero, covariance = make(suffix, "Vector3", 0.0, 0.0, 0.0), np.zeros(9)
    first = covariance if known else np.full(9, -1.0)
    stamp_ns = START_NS + milliseconds * 1_000_000
    fields = {
        "header": body_header(suffix, stamp_ns),
        "orientation": quaternion(suffix, turn),
        "orientation_covariance": first,
    }
    fields |= {"angular_velocity": zero, "angular_velocity_covariance": covariance}
    fields |= {"linear_acceleration": zero, "linear_acceleration_covariance": covariance}
    return Sent("/imu", "sensor_msgs/msg/Imu", stamp_ns, fields)


def pressure(milliseconds: int, depth_m: float) -> Sent:
    fields = {"fluid_pressure": 101_325.0 + 1025.0 * 9.81 * depth_m, "variance": 0.0}
    return Sent(
        "/pressure", "sensor_msgs/msg/FluidPressure", START_NS + milliseconds * 1_000_000, fields
    )


@pytest.mark.parametrize("suffix", FORMATS)
def test_fixes_attitude_and_pressure_place_the_left_camera(suffix, tmp_path) -> None:
    """The vehicle yaws by 10 degrees a second; the IMU sends 200 messages a second, of which some
    are enough.
    """
    turns = {ms: Rotation.from_euler("z", ms / 100, degrees=True) for ms in range(-5, 3100, 5)}
    sent = [
        *(imu(suffix, ms, turn) for ms, turn in turns.items()),
        *(pressure(ms, 2 + ms / 1000) for ms in range(-100, 3200, 100)),
    ]
    sent += [*(fix(suffix, i) for i in range(4)), fix(suffix, 4, status=-1), *images()]
    found = read_trajectory(write_bag(tmp_path / f"b{suffix}", sent), MountConfig(xyz_m=(1, 0, 0)))
    assert (found.camera, found.up, len(found.names)) == ("raw", "z", 4)
    assert found.origin is not None and found.origin.depth_known
    assert (found.origin.latitude_deg, found.origin.longitude_deg) == pytest.approx((-23.5, 152.1))
    turn = Rotation.from_euler("z", 20, degrees=True)  # at two seconds
    np.testing.assert_allclose(
        found.T_world_camera[2, :3, :3], (turn * OPTICAL).as_matrix(), atol=1e-6
    )
    east_m, north_m = 4e-5 * 111_320 * np.cos(np.radians(23.5)), 2e-5 * 110_740
    np.testing.assert_allclose(
        found.T_world_camera[2, :3, 3] - turn.apply((1, 0, 0)), (east_m, north_m, -4), atol=0.02
    )


def test_fixes_alone_give_heights_and_need_an_attitude(tmp_path) -> None:
    turns = [imu(".mcap", ms, TURN) for ms in range(-100, 2200, 100)]
    found = read_trajectory(
        write_bag(tmp_path / "a.mcap", [*turns, *(fix(".mcap", i) for i in range(3))])
    )
    np.testing.assert_allclose(found.T_world_camera[:, 2, 3], (0, -1, -2), atol=1e-9)
    assert found.origin is not None and not found.origin.depth_known
    np.testing.assert_allclose(
        found.T_world_camera[0, :3, :3], (TURN * OPTICAL).as_matrix(), atol=1e-9
    )
    unknown = [imu(".mcap", ms, TURN, known=False) for ms in (0, 100)]
    for name, sent in (("b", []), ("c", unknown)):
        with pytest.raises(InputError, match="contains satellite fixes but no attitude"):
            read_trajectory(write_bag(tmp_path / f"{name}.mcap", [fix(".mcap", 0), *sent]))


def test_a_fix_without_an_attitude_near_has_no_pose(tmp_path) -> None:
    turns = [imu(".mcap", ms, TURN) for ms in (-20, 20)]
    found = read_trajectory(
        write_bag(tmp_path / "a.mcap", [*turns, fix(".mcap", 0), fix(".mcap", 3)])
    )
    assert np.isfinite(found.T_world_camera).all(axis=(1, 2)).tolist() == [True, False]


def test_a_bag_without_a_track_says_so(tmp_path) -> None:
    with pytest.raises(
        InputError, match=r"b.bag: holds no track: no topic of the types nav_msgs/msg/Odometry"
    ):
        read_trajectory(write_bag(tmp_path / "b.bag", images()))
