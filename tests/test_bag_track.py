"""The track in a bag: odometry or poses, with the camera's place from the static transforms or the settings."""

import numpy as np
import pytest
from bag_writers import LEFT, RIGHT, START_NS, STEP_NS, STORES, Sent, raw, write_bag
from scipy.spatial.transform import Rotation

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import read_trajectory

FORMATS = (".bag", ".mcap", ".db3")
TURN = Rotation.from_euler("ZYX", [30, 5, -3], degrees=True)
"""The vehicle's, forward left up, against east north up."""

OPTICAL = Rotation.from_matrix([[0, -1, 0], [-1, 0, 0], [0, 0, -1]])
"""A camera that looks down with the top of its image to the bow: its x to starboard, its y to the stern."""


def make(suffix: str, name: str, *values):
    return STORES[suffix].types[f"geometry_msgs/msg/{name}"](*values)


def pose(suffix: str, position, turn: Rotation):
    return make(suffix, "Pose", make(suffix, "Point", *map(float, position)), make(suffix, "Quaternion", *turn.as_quat()))


def odometry(suffix: str, number: int) -> Sent:
    zero = make(suffix, "Vector3", 0.0, 0.0, 0.0)
    twist = make(suffix, "TwistWithCovariance", make(suffix, "Twist", zero, zero), np.zeros(36))
    with_covariance = make(suffix, "PoseWithCovariance", pose(suffix, (number, 2.0, -10.0), TURN), np.zeros(36))
    fields = {"child_frame_id": "base_link", "pose": with_covariance, "twist": twist}
    return Sent("/odom", "nav_msgs/msg/Odometry", START_NS + number * STEP_NS, fields)


def static_transform(suffix: str, parent: str, child: str, position, turn: Rotation) -> Sent:
    types = STORES[suffix].types
    stamp = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](**({"seq": 0} if suffix == ".bag" else {}), stamp=stamp, frame_id=parent)
    move = make(suffix, "Transform", make(suffix, "Vector3", *map(float, position)), make(suffix, "Quaternion", *turn.as_quat()))
    return Sent(
        "/tf_static", "tf2_msgs/msg/TFMessage", START_NS, {"transforms": [make(suffix, "TransformStamped", header, child, move)]}
    )


def images() -> list[Sent]:
    pixels = np.zeros((8, 8, 3), np.uint8)
    return [raw(f"{camera}/image_raw", START_NS, pixels, "rgb8") for camera in (LEFT, RIGHT)]  # stamped with the frame "camera"


@pytest.mark.parametrize("suffix", FORMATS)
def test_odometry_and_static_transforms_place_the_left_camera(suffix, tmp_path) -> None:
    rig = Rotation.from_euler("xyz", [0, 0, 10], degrees=True)
    statics = [
        static_transform(suffix, "base_link", "rig", (0.5, 0.1, -0.2), rig),
        static_transform(suffix, "camera", "rig", (0, 0, 0), OPTICAL.inv()),  # written the other way around
    ]
    found = read_trajectory(write_bag(tmp_path / f"b{suffix}", [*images(), *statics, *(odometry(suffix, i) for i in range(4))]))
    assert (found.camera, found.up, len(found.names)) == ("raw", "z", 4)
    np.testing.assert_allclose(found.timestamps_s[1] - found.timestamps_s[0], STEP_NS / 1e9, atol=1e-6)
    np.testing.assert_allclose(found.T_world_camera[2, :3, 3], np.array([2, 2, -10]) + TURN.apply((0.5, 0.1, -0.2)))
    np.testing.assert_allclose(found.T_world_camera[2, :3, :3], (TURN * rig * OPTICAL).as_matrix(), atol=1e-12)


def test_without_transforms_the_settings_say_where_the_camera_sits(tmp_path) -> None:
    bag = write_bag(tmp_path / "b.bag", [*images(), odometry(".bag", 1)])
    found = read_trajectory(bag, MountConfig(surge_m=0.4, sway_m=0.3, heave_m=0.1))
    np.testing.assert_allclose(found.T_world_camera[0, :3, 3], np.array([1, 2, -10]) + TURN.apply((0.4, -0.3, -0.1)))
    np.testing.assert_allclose(found.T_world_camera[0, :3, :3], (TURN * OPTICAL).as_matrix(), atol=1e-12)


def test_poses_without_odometry_do_too(tmp_path) -> None:
    stamped = Sent("/pose", "geometry_msgs/msg/PoseStamped", START_NS, {"pose": pose(".mcap", (1, 2, -3), TURN)})
    found = read_trajectory(write_bag(tmp_path / "b.mcap", [stamped]))
    np.testing.assert_allclose(found.T_world_camera[0, :3, 3], (1, 2, -3))


def test_a_bag_without_a_track_says_so(tmp_path) -> None:
    with pytest.raises(InputError, match=r"b.bag: holds no track: no topic of the types nav_msgs/msg/Odometry"):
        read_trajectory(write_bag(tmp_path / "b.bag", images()))
