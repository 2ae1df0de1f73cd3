"""Corrected pairs as ROS 2 messages in an MCAP file, one pair at a time.

Profile ros2, messages in CDR, schemas ros2msg (https://mcap.dev/spec/registry). Topics are named as
those of image_pipeline.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.errors import OutputError, library_for
from stereo_seecolor.extras.streams import ros_messages as ros
from stereo_seecolor.files.atomic import output_errors
from stereo_seecolor.records import Map
from stereo_seecolor.version import __version__

TOPICS = {
    "/stereo/left/image_rect_color/compressed": "CompressedImage",
    "/stereo/left/camera_info": "CameraInfo",
    "/stereo/right/camera_info": "CameraInfo",
    "/stereo/range/image_rect": "Image",
    "/stereo/disparity": "DisparityImage",
    "/stereo/points2": "PointCloud2",
    "/tf": "TFMessage",
}
LIBRARY = "stereo-seecolor"
"""Begins the library's name in a recording's header, by which this program's are known."""
HEADER_AT = 17
"""Bytes before the header's first string: signature, 8; the record's kind, 1; length, 8."""
POINT_STEP_PX = 2
"""Every second pixel of every second row becomes a point: 16 bytes each, 5 MB a frame of
1280x1024.
"""


@dataclass(frozen=True, eq=False)
class RecordedPair:
    """A corrected pair.

    stamp_ns: since 1970. picture: content and suffix of the corrected image's file. color: (H, W,
    3) uint8, the same pixels.
    range_m: measured, NaN unknown. T_map_camera: (4, 4), None where the pose is not known.
    """

    stamp_ns: int
    picture: tuple[bytes, str]
    color: NDArray[np.uint8]
    range_m: Map
    T_map_camera: NDArray[np.float64] | None = None


class McapRecording:
    """A file that grows by a pair at a time, as a context manager; until it is closed it has no
    index, and can be read without.

    compression: of its chunks. Raises OutputError if the file is there already or cannot be
    written, DeviceError if a library is missing.
    """

    def __init__(
        self, path: Path, geometry: RectifiedPair, compression: Literal["zstd", "lz4"] = "zstd"
    ) -> None:
        with library_for("MCAP", "bags"):
            from mcap.writer import CompressionType, Writer
        ros.definition("Image")  # a library that is missing is found before the file is made
        self._path, self._geometry, self._count = path, geometry, 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("xb")
        except FileExistsError as error:
            raise OutputError(
                f"{path}: already exists, and is not overwritten: give another name"
            ) from error
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
        self._writer = Writer(self._file, compression=CompressionType[compression.upper()])
        self._writer.start(profile="ros2", library=f"{LIBRARY} {__version__}")
        self._channels = {topic: self._channel(topic, name) for topic, name in TOPICS.items()}

    def add(self, pair: RecordedPair) -> None:
        """Write a pair's messages. Raises OutputError if the disk is full."""
        with output_errors(self._path):
            for topic, message in messages(pair, self._geometry):
                content = ros.serialize(TOPICS[topic], message)
                self._writer.add_message(
                    self._channels[topic], pair.stamp_ns, content, pair.stamp_ns, self._count
                )
        self._count += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with output_errors(self._path), self._file:
            self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, topic: str, name: str) -> int:
        schema = self._writer.register_schema(
            ros.type_name(name), "ros2msg", ros.definition(name).encode()
        )
        return int(self._writer.register_channel(topic, "cdr", schema))


def is_recording(path: Path) -> bool:
    """Whether this program recorded a file: by its header, an MCAP file's first record."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        begin = file.read(256)
    profile_end = HEADER_AT + 4 + int.from_bytes(begin[HEADER_AT : HEADER_AT + 4], "little")
    return begin.startswith(b"\x89MCAP0\r\n\x01") and begin[profile_end + 4 :].startswith(
        f"{LIBRARY} ".encode()
    )


def messages(pair: RecordedPair, geometry: RectifiedPair) -> Iterator[tuple[str, Any]]:
    """Make a pair's messages, (topic, message), one by one: each may have megabytes."""
    stamp_ns = pair.stamp_ns
    made: tuple[Callable[[], Any], ...] = (
        lambda: ros.compressed_image(stamp_ns, *pair.picture),
        lambda: ros.camera_info(stamp_ns, geometry, "left"),
        lambda: ros.camera_info(stamp_ns, geometry, "right"),
        lambda: ros.float_image(stamp_ns, pair.range_m),
        lambda: ros.disparity_image(stamp_ns, geometry, pair.range_m),
        lambda: ros.points(stamp_ns, *_points(geometry, pair.range_m, pair.color)),
    )
    for topic, make in zip(TOPICS, made, strict=False):
        yield topic, make()
    if pair.T_map_camera is not None:
        yield "/tf", ros.transforms(stamp_ns, pair.T_map_camera)


def _points(
    geometry: RectifiedPair, range_m: Map, color: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """(N, 3) meters in the left camera's axes, and colors, of some pixels with a measured range."""
    part = np.s_[::POINT_STEP_PX, ::POINT_STEP_PX]
    known = np.isfinite(range_m[part])
    points = geometry.rays[part][known] * range_m[part][known, None]
    return points.astype(np.float32), color[part][known]
