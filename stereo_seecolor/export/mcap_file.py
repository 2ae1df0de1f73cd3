"""One MCAP file with ROS 2 messages: corrected images, ranges, points and the track, stamped as the inputs were.

Profile ros2, messages in CDR, schemas ros2msg (https://mcap.dev/spec/registry). Topics are named as those of image_pipeline.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import DeviceError
from stereo_seecolor.export import ros_messages as ros
from stereo_seecolor.export.images import READABLE
from stereo_seecolor.export.posed_run import PosedRun
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.version import __version__

FILE = "dive.mcap"
TOPICS = {
    "/stereo/left/image_rect_color/compressed": "CompressedImage",
    "/stereo/left/camera_info": "CameraInfo",
    "/stereo/range/image_rect": "Image",
    "/stereo/points2": "PointCloud2",
    "/tf": "TFMessage",
}
POINT_STEP_PX = 2
"""Every second pixel of every second row becomes a point: 16 bytes each, 5 MB a frame of 1280x1024."""

_STAMP = re.compile(r"(?<!\d)(\d{10})-(\d{9})(?!\d)")
COUNTED_STEP_NS = 10**9
"""Frames without a time are stamped a second apart."""


def write(posed: PosedRun, folder: Path) -> None:
    """``dive.mcap``. Raises DeviceError if a library is missing, InputError if a frame is damaged."""
    try:
        from mcap.writer import CompressionType, Writer
    except ImportError as error:
        raise DeviceError("MCAP needs a library that is missing (mcap): pip install -c constraints.txt '.[bags]'") from error
    quaternions = _quaternions(posed.T_map_camera[:, :3, :3])
    with (folder / FILE).open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library=f"stereo-seecolor {__version__}")
        channels = {topic: _channel(writer, topic, name) for topic, name in TOPICS.items()}
        for i, frame in enumerate(posed.frames):
            stamp_ns = stamp_of(frame, i)
            pose = ros.transforms(stamp_ns, posed.T_map_camera[i], quaternions[i])
            messages = [*_messages(posed, frame, stamp_ns), pose]
            for (topic, name), message in zip(TOPICS.items(), messages, strict=True):
                writer.add_message(channels[topic], stamp_ns, ros.serialized(name, message), stamp_ns, i)
        writer.finish()  # type: ignore[no-untyped-call]


def stamp_of(frame: FinishedFrame, number: int) -> int:
    """Nanoseconds since 1970: exact where the name holds them, as those of bags do; of frames without time, a count of seconds."""
    if found := _STAMP.search(frame.name):
        return int(found[1]) * 10**9 + int(found[2])
    return (number + 1) * COUNTED_STEP_NS if frame.timestamp_s is None else round(frame.timestamp_s * 1e9)


def _messages(posed: PosedRun, frame: FinishedFrame, stamp_ns: int) -> list[Any]:
    color, range_m = eight_bit(frame.read("corrected")), frame.measured_range_m()
    content, suffix = _image_file(frame, color)
    return [
        ros.compressed_image(stamp_ns, content, suffix),
        ros.camera_info(stamp_ns, posed.geometry),
        ros.float_image(stamp_ns, range_m),
        ros.points(stamp_ns, *_points(posed, range_m, color)),
    ]


def _image_file(frame: FinishedFrame, color: NDArray[np.uint8]) -> tuple[bytes, str]:
    source = frame.products["corrected"]
    if source.suffix in READABLE and frame.read("corrected").dtype == np.uint8:
        return source.read_bytes(), source.suffix
    return bytes(encode_image(color, "png")), ".png"


def _points(posed: PosedRun, range_m: NDArray[np.float32], color: NDArray[np.uint8]) -> tuple[NDArray[Any], NDArray[np.uint8]]:
    """(N, 3) meters in the left camera's axes, and their colors, of a part of the pixels with a measured range."""
    g = posed.geometry
    depth_m = g.depth_from_range(range_m)[::POINT_STEP_PX, ::POINT_STEP_PX]
    y_px, x_px = (POINT_STEP_PX * index for index in np.nonzero(np.isfinite(depth_m)))
    z_m = depth_m[np.isfinite(depth_m)]
    xyz_m = np.column_stack([(x_px - g.cx_left_px) / g.focal_px * z_m, (y_px - g.cy_px) / g.focal_px * z_m, z_m])
    return xyz_m.astype(np.float32), color[y_px, x_px]


def _quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotations).as_quat())


def _channel(writer: Any, topic: str, name: str) -> int:
    schema = writer.register_schema(ros.type_name(name), "ros2msg", ros.definition(name).encode())
    return int(writer.register_channel(topic, "cdr", schema))
