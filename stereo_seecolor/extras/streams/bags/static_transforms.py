"""The static transforms of a bag: where one frame of the vehicle lies in another."""

from collections import deque
from typing import Any

import numpy as np

from calibration.transforms import inverse, rigid_transform, rotation_from_quaternion
from stereo_seecolor.extras.streams.bags.bag import TRANSFORMS, Bag
from stereo_seecolor.extras.streams.bags.messages import decode
from stereo_seecolor.records import Array

Frames = dict[str, list[tuple[str, Array]]]
"""Frame -> its neighbors, each with (4, 4) from the neighbor's axes to this frame's."""


def static_frames(bag: Bag) -> Frames:
    """All frames that /tf_static connects. Raises InputError for a damaged message."""
    frames: Frames = {}
    for topic in bag.topics:
        for entry in topic.entries if topic.msgtype in TRANSFORMS else ():
            for item in decode(entry).transforms:
                parent, child, move = (
                    item.header.frame_id.lstrip("/"),
                    item.child_frame_id.lstrip("/"),
                    item.transform,
                )
                t = move.translation
                T = rigid_transform(rotation_from_quaternion(xyzw(move.rotation)), (t.x, t.y, t.z))
                frames.setdefault(parent, []).append((child, T))
                frames.setdefault(child, []).append((parent, inverse(T)))
    return frames


def between(frames: Frames, start: str, end: str) -> Array | None:
    """(4, 4) from ``end`` axes to ``start`` axes, over fewest transforms; None without a way."""
    start, end = start.lstrip("/"), end.lstrip("/")
    waiting, known = deque([start]), {start: np.eye(4)}
    while waiting:
        at = waiting.popleft()
        if at == end:
            return known[at]
        for neighbor, T in frames.get(at, []):
            if neighbor not in known:
                known[neighbor] = known[at] @ T
                waiting.append(neighbor)
    return None


def xyzw(quaternion: Any) -> tuple[float, float, float, float]:
    """The components of a geometry_msgs/Quaternion."""
    return quaternion.x, quaternion.y, quaternion.z, quaternion.w
