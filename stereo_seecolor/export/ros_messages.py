"""A frame's products as ROS 2 messages, made and serialized without ROS."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.records import Map

PACKAGES = {"Header": "std_msgs", "Time": "builtin_interfaces", "TFMessage": "tf2_msgs"} | dict.fromkeys(
    ("TransformStamped", "Transform", "Vector3", "Quaternion"), "geometry_msgs"
)
"""The package of a type; the others are in sensor_msgs."""

FLOAT32 = 7
"""sensor_msgs/PointField.FLOAT32."""

LEFT_FRAME, MAP_FRAME = "stereo_left", "map"


def type_name(name: str) -> str:
    """``Image`` as ROS 2 writes it: ``sensor_msgs/msg/Image``."""
    return f"{PACKAGES.get(name, 'sensor_msgs')}/msg/{name}"


def make(name: str, *values: Any) -> Any:
    """A message of that type from its fields in their order. Raises DeviceError if rosbags is missing."""
    return _store().types[type_name(name)](*values)


def serialized(name: str, message: Any) -> bytes:
    """The message as CDR, little-endian."""
    return bytes(_store().serialize_cdr(message, type_name(name)))


def definition(name: str) -> str:
    """The type's definition with those of all types in it, as MCAP's encoding ros2msg wants it."""
    text, _ = _store().generate_msgdef(type_name(name), ros_version=2)
    return str(text)


def header(stamp_ns: int, frame: str) -> Any:
    """stamp_ns: nanoseconds since 1970."""
    return make("Header", make("Time", *divmod(stamp_ns, 10**9)), frame)


def compressed_image(stamp_ns: int, content: bytes, suffix: str) -> Any:
    """content: of a JPEG or PNG file."""
    return make("CompressedImage", header(stamp_ns, LEFT_FRAME), suffix.lstrip(".").replace("jpg", "jpeg"), _bytes(content))


def float_image(stamp_ns: int, values: Map) -> Any:
    """(H, W) float32 as encoding 32FC1, NaN unknown."""
    height, width = values.shape
    return make("Image", header(stamp_ns, LEFT_FRAME), height, width, "32FC1", 0, 4 * width, _bytes(values.astype("<f4").tobytes()))


def camera_info(stamp_ns: int, geometry: RectifiedPair) -> Any:
    """The pinhole of the corrected images, which have no distortion."""
    width, height = geometry.image_size
    K = geometry.P_left
    P = np.column_stack([K, np.zeros(3)])
    roi = make("RegionOfInterest", 0, 0, 0, 0, False)
    matrices = (np.zeros(5), K.ravel(), np.eye(3).ravel(), P.ravel())
    return make("CameraInfo", header(stamp_ns, LEFT_FRAME), height, width, "plumb_bob", *matrices, 0, 0, roi)


def points(stamp_ns: int, xyz_m: NDArray[np.float32], color: NDArray[np.uint8]) -> Any:
    """xyz_m: (N, 3) in the left camera's axes. color: (N, 3) RGB, packed into one float as PCL does."""
    fields = [make("PointField", name, 4 * i, FLOAT32, 1) for i, name in enumerate(("x", "y", "z", "rgb"))]
    packed = np.column_stack([xyz_m.astype("<f4").view(np.uint8), color[:, ::-1], np.zeros(len(color), np.uint8)])
    count = len(xyz_m)
    return make(
        "PointCloud2", header(stamp_ns, LEFT_FRAME), 1, count, fields, False, 16, 16 * count, _bytes(packed.tobytes()), True
    )


def transforms(stamp_ns: int, T_map_camera: NDArray[np.float64], quaternion: NDArray[np.float64]) -> Any:
    """T_map_camera: (4, 4). quaternion: (4,) x, y, z, w of the same rotation."""
    translation = make("Vector3", *map(float, T_map_camera[:3, 3]))
    transform = make("Transform", translation, make("Quaternion", *map(float, quaternion)))
    return make("TFMessage", [make("TransformStamped", header(stamp_ns, MAP_FRAME), LEFT_FRAME, transform)])


def _bytes(content: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(content, np.uint8)


@lru_cache
def _store() -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise DeviceError("MCAP needs a library that is missing (rosbags): pip install -c constraints.txt '.[bags]'") from error
    return get_typestore(Stores.ROS2_HUMBLE)
