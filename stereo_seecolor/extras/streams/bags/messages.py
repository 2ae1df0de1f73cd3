"""Messages of bags: image messages as the image files that the rest of the program reads,
camera_info as a calibration, and static transforms.
"""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import CalibrationError, StereoRig
from calibration.formats import ros
from calibration.formats.reading.section import Section
from stereo_seecolor.errors import InputError, library_for
from stereo_seecolor.extras.streams.bags.bag import (
    COMPRESSED_IMAGES,
    TRANSFORMS,
    VIDEOS,
    Entry,
)
from stereo_seecolor.extras.streams.bags.foxglove import parse_foxglove
from stereo_seecolor.files.image_headers import JPEG_SIGNATURE, PNG_SIGNATURE
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.images import BAYER_CODES

CHANNELS = {
    "mono8": 1, "8UC1": 1, "mono16": 1, "16UC1": 1,
    "rgb8": 3, "bgr8": 3, "8UC3": 3, "rgb16": 3, "bgr16": 3, "16UC3": 3,
    "rgba8": 4, "bgra8": 4, "8UC4": 4,
}  # fmt: skip
"""Encoding of sensor_msgs/Image -> channels. 8UC3 is OpenCV's own order, blue first."""

BAYER = {
    f"bayer_{pattern}{bits}": code for pattern, code in BAYER_CODES.items() for bits in (8, 16)
}
PACKED = {
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuyv": cv2.COLOR_YUV2RGB_YUY2,
}
FIRST_PACKET = f"{VIDEOS[-1]}1"
"""FFMPEGPacket as ROS 1 has it, and ROS 2 had it at first."""
_VIDEO_FIELDS = {
    VIDEOS[0]: (
        "builtin_interfaces/Time timestamp",
        "string frame_id",
        "uint8[] data",
        "string format",
    ),
    VIDEOS[-1]: (
        "std_msgs/Header header",
        "int32 width",
        "int32 height",
        "string encoding",
        "uint64 pts",
        "uint8 flags",
        "bool is_bigendian",
        "uint8[] data",
    ),
    FIRST_PACKET: (
        "std_msgs/Header header",
        "uint8[] data",
        "int32 img_width",
        "int32 img_height",
        "string encoding",
        "uint64 pts",
        "uint8 flags",
    ),
}
"""Type that rosbags does not know -> its fields (Foxglove's, ffmpeg_image_transport's)."""
DEPTH_HEADER_BYTES = 12
"""What compressed_depth_image_transport writes before the PNG: an int and two floats."""

_BLUE_FIRST = ("bgr", "8UC3", "16UC3", "8UC4")


def decode(entry: Entry) -> Any:
    """The message with attributes. Raises InputError if damaged, DeviceError without rosbags."""
    content, (_, msgtype, encoding) = entry.payload(), entry.channel
    with library_for("a bag", "bags"):
        try:
            if encoding in ("protobuf", "json"):
                return parse_foxglove(content, msgtype, encoding)
            if msgtype == VIDEOS[-1]:
                return _packet(content, encoding)
            return _deserialized(content, msgtype, encoding)
        except ImportError:
            raise
        except Exception as error:  # rosbags has many ways to fail on damaged bytes
            raise InputError(
                f"{entry.path}: {entry.channel.topic}: a message of it is damaged ({error})"
            ) from error


def _packet(content: bytes, encoding: str) -> Any:
    """An FFMPEGPacket, whose fields have another order since 2023."""
    try:
        return _deserialized(content, VIDEOS[-1], encoding)
    except ImportError:
        raise
    except Exception:  # rosbags has many ways to fail on other bytes than it expects
        return _deserialized(content, FIRST_PACKET, encoding)


def _deserialized(content: bytes, msgtype: str, encoding: str) -> Any:
    if encoding == "ros1":
        return store("ros1").deserialize_ros1(content, msgtype)
    return store("cdr").deserialize_cdr(content, msgtype)


def coding(message: Any) -> str:
    """How a message of a video or a compressed image states that it is coded: ``h264``,
    ``rgb8; jpeg compressed bgr8``.
    """
    return str(getattr(message, "format", "") or getattr(message, "encoding", ""))


def frame_of(message: Any) -> str:
    """The frame of a message's header, or of a message without one."""
    return str(message.header.frame_id if hasattr(message, "header") else message.frame_id)


def image_suffix(entry: Entry) -> str:
    """The suffix of the image file that the message becomes."""
    if entry.channel.msgtype not in COMPRESSED_IMAGES:
        return ".tif"
    return ".png" if _compressed(decode(entry)).startswith(PNG_SIGNATURE) else ".jpg"


def image_content(entry: Entry) -> bytes:
    """An image message as the content of an image file: JPEG and PNG as they are, raw pixels as an
    uncompressed TIFF.

    Raises InputError for what is not a picture, DeviceError without rosbags.
    """
    return message_content(
        decode(entry), entry.channel.msgtype, f"{entry.path}: {entry.channel.topic}"
    )


def message_content(message: Any, msgtype: str, where: str) -> bytes:
    """A decoded image message as content of an image file; where: for errors. Raises InputError."""
    if msgtype not in COMPRESSED_IMAGES:
        return encode_tiff(_pixels(message, where))
    content = _compressed(message)
    if not content.startswith((PNG_SIGNATURE, JPEG_SIGNATURE)):
        raise InputError(f"{where}: is compressed as {message.format!r}: JPEG and PNG are read")
    return content


def rig_of(left: Entry, right: Entry, T_right_left: NDArray[np.float64] | None = None) -> StereoRig:
    """The rig of two camera_info messages. T_right_left: (4, 4) from elsewhere, used where their
    projections hold no baseline.

    Raises CalibrationError, InputError, DeviceError.
    """
    sections = [
        Section(f"{entry.path}: {entry.channel.topic}", camera_info(decode(entry)))
        for entry in (left, right)
    ]
    try:
        if T_right_left is None:
            return ros.parse(*sections)
        return StereoRig(ros.parse_camera(sections[0]), ros.parse_camera(sections[1]), T_right_left)
    except CalibrationError as error:
        if str(left.path) in str(error):
            raise
        raise CalibrationError(f"{left.path}: camera_info: {error}; or give --calib") from error


def _compressed(message: Any) -> bytes:
    """The image file in a CompressedImage. compressedDepth, with or without the word png after it,
    puts 12 bytes before the file.

    Of depths in meters (32FC1) the file holds their inverse, coded by those: not read.
    """
    content, form = bytes(message.data), str(message.format)
    if "compressedDepth" not in form or form.startswith("32FC1"):
        return content
    return content[DEPTH_HEADER_BYTES:]


def _pixels(message: Any, where: str) -> NDArray[Any]:
    """The pixels of a sensor_msgs/Image, RGB or one channel; a mosaic is interpolated."""
    encoding, known = str(message.encoding), str(message.encoding) in CHANNELS | BAYER | PACKED
    if not known:
        raise InputError(
            f"{where}: pixels are encoded as {encoding!r}: one of "
            f"{', '.join((*CHANNELS, *BAYER, *PACKED))} is read"
        )
    channels = 2 if encoding in PACKED else CHANNELS.get(encoding, 1)
    type_ = np.dtype(np.uint16 if "16" in encoding else np.uint8).newbyteorder(
        ">" if message.is_bigendian else "<"
    )
    row, step = int(message.width) * channels * type_.itemsize, int(message.step)
    data = np.frombuffer(bytes(message.data), np.uint8)
    if not row or not message.height or step < row or data.size < step * message.height:
        raise InputError(
            f"{where}: an image of {message.width}x{message.height} px has {data.size} bytes in "
            f"rows of {step}, needs rows of {row}"
        )
    rows = np.ascontiguousarray(
        data[: step * message.height].reshape(message.height, step)[:, :row]
    )
    pixels = (
        rows.view(type_)
        .astype(type_.newbyteorder("="))
        .reshape(message.height, message.width, channels)
    )
    if encoding in BAYER or encoding in PACKED:
        return np.asarray(
            cv2.cvtColor(pixels[..., 0] if channels == 1 else pixels, (BAYER | PACKED)[encoding])
        )
    if channels == 1:
        return pixels[..., 0]
    return pixels[..., [2, 1, 0]] if encoding.startswith(_BLUE_FIRST) else pixels[..., :3]


def camera_info(message: Any) -> dict[str, Any]:
    """A sensor_msgs/CameraInfo as its dump in YAML; ROS 1 writes D, K, R, P, ROS 2 d, k, r, p."""
    content = {
        name.upper(): getattr(message, name, getattr(message, name.upper(), None)).tolist()  # type: ignore[union-attr]
        for name in "dkrp"
    }
    model = {"distortion_model": message.distortion_model} if message.distortion_model else {}
    return {**content, **model, "width": int(message.width), "height": int(message.height)}


@lru_cache
def store(encoding: str) -> Any:
    """Definitions of the standard messages, the same in all releases of ROS 1, and ROS 2."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    for name in TRANSFORMS:
        if name not in store.types:  # ROS 1 has them in packages that rosbags does not know
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    for name, fields in _VIDEO_FIELDS.items():
        store.register(get_types_from_msg("\n".join(fields), name))
    return store
