"""The vehicle's own track in a bag: odometry or poses, and where the left camera sits by the static
transforms.

Axes are those of REP 103: the world z up; the vehicle x forward, y left, z up; optical frames x
right, y down, z forward.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.transforms import rigid_transform, rotation_from_quaternion
from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags.bag import FIX, POSES, Bag, Topic, open_bag
from stereo_seecolor.extras.streams.bags.fixes import fixed_track
from stereo_seecolor.extras.streams.bags.messages import decode, frame_of
from stereo_seecolor.extras.streams.bags.static_transforms import between, static_frames, xyzw
from stereo_seecolor.extras.streams.bags.topics import side_topics
from stereo_seecolor.inputs.trajectories.axes import mount_offset_m, mount_rotation
from stereo_seecolor.records import Array, Trajectory

MOST_POSES = 20_000
"""Of more every second is taken, or fewer: poses are interpolated, and take 0.1 ms each."""

FORWARD_LEFT_UP = np.diag([1.0, -1.0, -1.0])
"""From the vehicle's axes of MountConfig (forward, starboard, down) to those of ROS."""


def read_track(path: Path, mount: MountConfig) -> Trajectory:
    """The raw left camera's poses by the bag's longest odometry, or else its longest topic of
    poses, or else its satellite fixes.

    The camera sits where /tf_static says, else where ``mount`` does.
    Raises InputError if the bag holds no such topic, or one that is damaged; DeviceError if a
    library is missing.
    """
    bag = open_bag(path)
    topic = _track_topic(bag)
    if topic is None:
        return _by_fixes(bag, mount)
    entries = topic.entries[:: -(-len(topic.entries) // MOST_POSES)]
    messages = [decode(entry) for entry in entries]
    found = [_pose(message) for message in messages]
    rows = np.array(
        [(p.position.x, p.position.y, p.position.z, *xyzw(p.orientation)) for p in found]
    )
    T_world_body = rigid_transform(rotation_from_quaternion(rows[:, 3:]), rows[:, :3])
    T = T_world_body @ _body_from_camera(bag, getattr(messages[0], "child_frame_id", ""), mount)
    times_s = np.array([entry.stamp_ns / 1e9 for entry in entries])
    return replace(Trajectory(("",) * len(T), times_s, T), camera="raw")


def _by_fixes(bag: Bag, mount: MountConfig) -> Trajectory:
    """The camera's track by satellite fixes and attitude. Raises InputError without any."""
    track = fixed_track(bag)
    if track is None:
        raise InputError(
            f"{bag.path}: holds no track: no topic of the types {', '.join((*POSES, FIX))}"
        )
    T_imu_camera = _body_from_camera(bag, track.imu_frame, mount)
    T_imu_antenna = between(static_frames(bag), track.imu_frame, track.fix_frame)
    if T_imu_antenna is not None:
        T_imu_camera[:3, 3] -= T_imu_antenna[:3, 3]
    T = track.T_world_body @ T_imu_camera
    return Trajectory(("",) * len(T), track.times_s, T, origin=track.origin, camera="raw")


def _track_topic(bag: Bag) -> Topic | None:
    for msgtype in POSES:
        topics = [topic for topic in bag.topics if topic.msgtype == msgtype and topic.entries]
        if topics:
            return max(topics, key=lambda topic: topic.count)
    return None


def _pose(message: Any) -> Any:
    """The geometry_msgs/Pose inside Odometry, PoseWithCovarianceStamped or PoseStamped."""
    return message.pose.pose if hasattr(message.pose, "pose") else message.pose


def _body_from_camera(bag: Bag, body: str, mount: MountConfig) -> Array:
    """(4, 4) from the raw left camera's axes to the frame whose poses these are."""
    camera = _camera_frame(bag)
    if body and camera and body == camera:
        return np.eye(4)
    found = between(static_frames(bag), body, camera)
    if found is not None:
        return found
    return rigid_transform(
        FORWARD_LEFT_UP @ mount_rotation(mount), FORWARD_LEFT_UP @ mount_offset_m(mount)
    )


def _camera_frame(bag: Bag) -> str:
    """The frame that the left images are stamped with, "" where it is not known which they are."""
    try:
        return frame_of(decode(side_topics(bag, {}).left.entries[0])).lstrip("/")
    except InputError:
        return ""
