"""A frame's products as ROS 2 messages, made and serialized without ROS."""

from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.rig import quarter_turn
from calibration.transforms import quaternion
from stereo_seecolor.errors import library_for
from stereo_seecolor.records import Map

PACKAGES = {
    "Header": "std_msgs",
    "Time": "builtin_interfaces",
    "TFMessage": "tf2_msgs",
    "DisparityImage": "stereo_msgs",
} | dict.fromkeys(("TransformStamped", "Transform", "Vector3", "Quaternion"), "geometry_msgs")
"""The package of a type; the others are in sensor_msgs."""

FLOAT32 = 7
"""sensor_msgs/PointField.FLOAT32."""

UNKNOWN_DISPARITY, DISPARITY_STEP = np.float32(-1.0), 1 / 16
"""Below min_disparity, which is 0; and the step stated for sub-pixel matching."""

LEFT_FRAME, MAP_FRAME = "stereo_left", "map"


def type_name(name: str) -> str:
    """``Image`` as ROS 2 writes it: ``sensor_msgs/msg/Image``."""
    return f"{PACKAGES.get(name, 'sensor_msgs')}/msg/{name}"


def make(name: str, *values: Any) -> Any:
    """A message of that type from its fields in order. Raises DeviceError without rosbags."""
    return _store().types[type_name(name)](*values)


def serialize(name: str, message: Any) -> bytes:
    """The message as CDR, little-endian."""
    return bytes(_store().serialize_cdr(message, type_name(name)))


def definition(name: str) -> str:
    """The type's definition with those of all types in it, as MCAP's encoding ros2msg wants it."""
    text, _ = _store().generate_msgdef(type_name(name), ros_version=2)
    return str(text)


def header(stamp_ns: int, frame: str) -> Any:
    """Make a header. stamp_ns: nanoseconds since 1970."""
    return make("Header", make("Time", *divmod(stamp_ns, 10**9)), frame)


def compressed_image(stamp_ns: int, content: bytes, suffix: str) -> Any:
    """Make a compressed image. content: of a JPEG or PNG file."""
    return make(
        "CompressedImage",
        header(stamp_ns, LEFT_FRAME),
        suffix.lstrip(".").replace("jpg", "jpeg"),
        _bytes(content),
    )


def float_image(stamp_ns: int, values: Map) -> Any:
    """Make an image of (H, W) float32 in encoding 32FC1, NaN unknown."""
    height, width = values.shape
    return make(
        "Image",
        header(stamp_ns, LEFT_FRAME),
        height,
        width,
        "32FC1",
        0,
        4 * width,
        _bytes(values.astype("<f4").tobytes()),
    )


def camera_info(stamp_ns: int, geometry: RectifiedPair, side: Literal["left", "right"]) -> Any:
    """The pinhole of the rectified images, without distortion; the right P holds the baseline."""
    width, height = geometry.image_size
    K, place_m = geometry.P_left, np.zeros(3)
    if side == "right":
        K[0, 2] = geometry.cx_right_px
        place_m = quarter_turn(-geometry.quarter_turns) @ [-geometry.baseline_m, 0.0, 0.0]
    P = np.column_stack([K, K @ place_m])
    roi = make("RegionOfInterest", 0, 0, 0, 0, False)
    matrices = (np.zeros(5), K.ravel(), np.eye(3).ravel(), P.ravel())
    return make(
        "CameraInfo", header(stamp_ns, LEFT_FRAME), height, width, "plumb_bob", *matrices, 0, 0, roi
    )


def disparity_image(stamp_ns: int, geometry: RectifiedPair, range_m: Map) -> Any:
    """stereo_msgs/DisparityImage: Z = f T / d, whatever the principal points; less than
    min_disparity is unknown.
    """
    height, width = range_m.shape
    disparity = np.float32(geometry.focal_px * geometry.baseline_m) * geometry.ray_length / range_m
    known = np.isfinite(disparity)
    largest = float(disparity.max(where=known, initial=0.0))
    image = float_image(stamp_ns, np.where(known, disparity, UNKNOWN_DISPARITY).astype(np.float32))
    window = make("RegionOfInterest", 0, 0, height, width, False)
    camera = geometry.focal_px, geometry.baseline_m
    return make(
        "DisparityImage",
        header(stamp_ns, LEFT_FRAME),
        image,
        *camera,
        window,
        0.0,
        largest,
        DISPARITY_STEP,
    )


def points(stamp_ns: int, xyz_m: NDArray[np.float32], color: NDArray[np.uint8]) -> Any:
    """Make a point cloud. xyz_m: (N, 3) in the left camera's axes. color: (N, 3) RGB, packed into
    one float as PCL does.
    """
    fields = [
        make("PointField", name, 4 * i, FLOAT32, 1) for i, name in enumerate(("x", "y", "z", "rgb"))
    ]
    packed = np.column_stack(
        [xyz_m.astype("<f4").view(np.uint8), color[:, ::-1], np.zeros(len(color), np.uint8)]
    )
    count = len(xyz_m)
    return make(
        "PointCloud2",
        header(stamp_ns, LEFT_FRAME),
        1,
        count,
        fields,
        False,
        16,
        16 * count,
        _bytes(packed.tobytes()),
        True,
    )


def transforms(stamp_ns: int, T_map_camera: NDArray[np.float64]) -> Any:
    """T_map_camera: (4, 4)."""
    translation = make("Vector3", *map(float, T_map_camera[:3, 3]))
    turn = make("Quaternion", *map(float, quaternion(T_map_camera[:3, :3])))
    transform = make("Transform", translation, turn)
    return make(
        "TFMessage", [make("TransformStamped", header(stamp_ns, MAP_FRAME), LEFT_FRAME, transform)]
    )


def _bytes(content: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(content, np.uint8)


@lru_cache
def _store() -> Any:
    with library_for("MCAP", "bags"):
        from rosbags.typesys import Stores, get_typestore
    return get_typestore(Stores.ROS2_HUMBLE)
