"""Bags of a small dive, written by rosbags in every format that is read."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from calibration.formats import load_rig, ros
from calibration.formats.reading.document import load_document

STORES = {".bag": get_typestore(Stores.ROS1_NOETIC)} | dict.fromkeys(
    (".db3", ".mcap"), get_typestore(Stores.ROS2_HUMBLE)
)
STORES[".bag"].register(
    get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
)
VIDEO, PACKET = "foxglove_msgs/msg/CompressedVideo", "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
for _suffix, _store in ((".bag", STORES[".bag"]), (".mcap", STORES[".mcap"])):
    _store.register(
        get_types_from_msg(
            "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format", VIDEO
        )
    )
    _first = (
        "uint8[] data\nint32 img_width\nint32 img_height\nstring encoding\nuint64 pts\nuint8 flags"
    )
    _now = (
        "int32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\nbool is_bigendian\n"
        "uint8[] data"
    )
    _store.register(
        get_types_from_msg(
            f"std_msgs/Header header\n{_first if _suffix == '.bag' else _now}", PACKET
        )
    )
START_NS, STEP_NS = 1_700_000_000_123_456_789, 250_000_000
LEFT, RIGHT = "/stereo/left", "/stereo/right"


class Sent(NamedTuple):
    """A message to be written. fields: of its type, without the header. arrival_ns: when it was
    recorded. frame: of its header.
    """

    topic: str
    type: str
    stamp_ns: int
    fields: dict[str, Any]
    arrival_ns: int = 0
    frame: str = "camera"


def write_bag(path: Path, messages: Iterable[Sent], compression: Sequence[Any] = ()) -> Path:
    """Write messages; the format is that of the suffix. compression: for the writer. Returns the
    file.
    """
    suffix = path.suffix
    store, is_ros1 = STORES[suffix], suffix == ".bag"
    plugin = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
    folder = path.with_name(path.name.replace(".", "_"))
    bag = Writer1(path) if is_ros1 else Writer2(folder, version=9, storage_plugin=plugin)
    if compression:
        bag.set_compression(*compression)
    with bag:
        known = {}
        for sent in messages:
            if sent.topic not in known:
                known[sent.topic] = bag.add_connection(sent.topic, sent.type, typestore=store)
            message = _message(store, sent, is_ros1)
            content = (
                store.serialize_ros1(message, sent.type)
                if is_ros1
                else store.serialize_cdr(message, sent.type)
            )
            bag.write(known[sent.topic], sent.arrival_ns or sent.stamp_ns, content)
    return path if is_ros1 else next(folder.glob(f"*{suffix}"))


def _message(store: Any, sent: Sent, is_ros1: bool) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](*divmod(sent.stamp_ns, 10**9))
    header = store.types["std_msgs/msg/Header"](
        **({"seq": 0} if is_ros1 else {}), stamp=time, frame_id=sent.frame
    )
    fields = {**({} if sent.type.endswith("TFMessage") else {"header": header}), **sent.fields}
    if sent.type == VIDEO:
        fields = {"timestamp": time, "frame_id": sent.frame, **sent.fields}
    if sent.type.endswith("CameraInfo"):
        roi = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        fields |= {"binning_x": 0, "binning_y": 0, "roi": roi}
        fields = {
            name.upper() if is_ros1 and name in "dkrp" else name: value
            for name, value in fields.items()
        }
    return store.types[sent.type](**fields)


def raw(topic: str, stamp_ns: int, pixels: np.ndarray, encoding: str, arrival_ns: int = 0) -> Sent:
    """A sensor_msgs/Image; every row is followed by 4 bytes that belong to no pixel."""
    rows = np.ascontiguousarray(pixels).reshape(len(pixels), -1).view(np.uint8)
    padded = np.pad(rows, ((0, 0), (0, 4)))
    size = {"height": pixels.shape[0], "width": pixels.shape[1], "step": padded.shape[1]}
    fields = {**size, "encoding": encoding, "is_bigendian": 0, "data": padded.ravel()}
    return Sent(topic, "sensor_msgs/msg/Image", stamp_ns, fields, arrival_ns)


def compressed(
    topic: str, stamp_ns: int, content: bytes, format: str = "rgb8; png compressed bgr8"
) -> Sent:
    return Sent(
        topic,
        "sensor_msgs/msg/CompressedImage",
        stamp_ns,
        {"format": format, "data": np.frombuffer(content, np.uint8)},
    )


def coded_picture(
    suffix: str, kind: str, topic: str, stamp_ns: int, content: bytes, arrival_ns: int = 0
) -> Sent:
    """A picture of a video in H.264. kind: VIDEO, PACKET, or else a CompressedImage."""
    data = np.frombuffer(content, np.uint8)
    if kind == VIDEO:
        return Sent(topic, VIDEO, stamp_ns, {"data": data, "format": "h264"}, arrival_ns)
    if kind == PACKET:
        size = ("img_width", "img_height") if suffix == ".bag" else ("width", "height")
        fields = {**dict.fromkeys(size, 0), "encoding": "h264;yuv420p;bgr8;bgr8", "pts": 0}
        order = {} if suffix == ".bag" else {"is_bigendian": False}
        return Sent(
            topic, PACKET, stamp_ns, {**fields, "flags": 0, **order, "data": data}, arrival_ns
        )
    fields = {"format": "h264", "data": data}
    return Sent(topic, "sensor_msgs/msg/CompressedImage", stamp_ns, fields, arrival_ns)


def make(suffix: str, name: str, *values):
    return STORES[suffix].types[f"geometry_msgs/msg/{name}"](*values)


def static_transform(suffix: str, parent: str, child: str, position, turn: Rotation) -> Sent:
    types = STORES[suffix].types
    stamp = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](
        **({"seq": 0} if suffix == ".bag" else {}), stamp=stamp, frame_id=parent
    )
    move = make(
        suffix,
        "Transform",
        make(suffix, "Vector3", *map(float, position)),
        make(suffix, "Quaternion", *turn.as_quat()),
    )
    return Sent(
        "/tf_static",
        "tf2_msgs/msg/TFMessage",
        START_NS,
        {"transforms": [make(suffix, "TransformStamped", header, child, move)]},
    )


def camera_infos(calib: Path, stamp_ns: int = START_NS) -> list[Sent]:
    """Both camera_info messages of a rig."""
    files = calib.with_name("ros_left.yaml"), calib.with_name("ros_right.yaml")
    ros.write(load_rig(calib), *files)
    return [
        _camera_info(f"{camera}/camera_info", load_document(file).content, stamp_ns)
        for camera, file in zip((LEFT, RIGHT), files, strict=True)
    ]


def _camera_info(topic: str, content: Any, stamp_ns: int) -> Sent:
    names = {
        "k": "camera_matrix",
        "d": "distortion_coefficients",
        "r": "rectification_matrix",
        "p": "projection_matrix",
    }
    matrices = {
        key: np.array(content[name]["data"], np.float64).ravel() for key, name in names.items()
    }
    size = {"height": content["image_height"], "width": content["image_width"]}
    return Sent(
        topic,
        "sensor_msgs/msg/CameraInfo",
        stamp_ns,
        {**size, "distortion_model": content["distortion_model"], **matrices},
    )


def dive_messages(root: Path, sides: str = "LR", suffix: str = "/image_raw") -> list[Sent]:
    """The images of a dive's two folders, which are named by their stamps, in color or gray; the
    right ones arrive 30 ms late.
    """
    sent = []
    for side, camera in zip(sides, (LEFT, RIGHT), strict=True):
        for path in sorted((root / side).glob("*.png")):
            pixels = cv2.imread(str(path), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
            encoding = ("bgr" if pixels.ndim == 3 else "mono") + (
                "8" if pixels.dtype == np.uint8 else "16"
            )
            late_ns = 30_000_000 * (camera == RIGHT)
            stamp_ns = stamp_of(path)
            sent.append(raw(f"{camera}{suffix}", stamp_ns, pixels, encoding, stamp_ns + late_ns))
    return sorted(sent, key=lambda message: message.arrival_ns)


def stamp_of(path: Path) -> int:
    seconds, nanoseconds = path.stem.split("-")
    return int(seconds) * 10**9 + int(nanoseconds)


def name_by_stamps(root: Path) -> None:
    """Rename the files of a dive's two folders by the stamps that their messages have."""
    for side in "LR":
        for i, path in enumerate(sorted((root / side).glob("*.png"))):
            seconds, nanoseconds = divmod(START_NS + i * STEP_NS, 10**9)
            path.rename(path.with_name(f"{seconds:010d}-{nanoseconds:09d}.png"))
