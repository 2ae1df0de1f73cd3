"""A bag's files read once: the topics, and the place of each message that matters."""

import os
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags import sqlite_file
from stereo_seecolor.extras.streams.bags.decompression import ZSTD_MAGIC, decompress
from stereo_seecolor.extras.streams.bags.foxglove import (
    FOXGLOVE_IMAGE,
    FOXGLOVE_VIDEO,
    foxglove_stamp_ns,
)
from stereo_seecolor.extras.streams.bags.mcap_file import MCAP_MAGIC, walk_mcap
from stereo_seecolor.extras.streams.bags.ros1_file import ROS1_MAGIC, walk_ros1
from stereo_seecolor.extras.streams.bags.source import (
    Channel,
    Chunk,
    Cut,
    FileSource,
    Message,
    Place,
)
from stereo_seecolor.extras.streams.bags.sqlite_file import SQLITE_MAGIC, walk_sqlite
from stereo_seecolor.files.names import natural_key
from stereo_seecolor.files.whole_files import special_kind

SUFFIXES = frozenset({".bag", ".active", ".db3", ".mcap"})
"""``.bag.active``: what ROS 1 calls a bag that is being recorded, or was when the power went."""

IMAGE, COMPRESSED, CAMERA_INFO = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
)
IMAGES = (IMAGE, COMPRESSED, FOXGLOVE_IMAGE)
"""Types whose messages are images by themselves."""
VIDEOS = (
    "foxglove_msgs/msg/CompressedVideo",
    FOXGLOVE_VIDEO,
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
)
"""Types whose messages are pictures of a video."""
COMPRESSED_IMAGES = (COMPRESSED, FOXGLOVE_IMAGE)
"""Types whose messages are either, by the format that they state."""
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
)
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
STATIC_TRANSFORMS = "/tf_static"
"""Where the mounts are; /tf, which moves, is counted only."""

FIX, IMU, PRESSURE = (
    "sensor_msgs/msg/NavSatFix",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/FluidPressure",
)

UNPACKED_BY = {
    ZSTD_MAGIC: "zstd -d",
    b"\x1f\x8b": "gunzip",
    b"\x04\x22\x4d\x18": "lz4 -d",
    b"BZh": "bunzip2",
    b"PK\x03\x04": "unzip",
}
"""First bytes of a compressed file -> the program that unpacks it."""

INDEXED = frozenset({*IMAGES, *VIDEOS, CAMERA_INFO, *POSES, FIX, IMU, PRESSURE})
"""Of these each message's place is kept, some hundred bytes; the others are counted."""

THINNED = frozenset({IMU, PRESSURE})
THINNED_NS = 20_000_000
"""Of fast sensors one message in 20 ms is kept: a vehicle turns little in that time."""

HEAD_BYTES = 32
CACHED_CHUNKS = 4
"""Chunks of 1 to 4 MB that are kept decompressed: neighboring messages share them."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A message of an indexed topic. stamp_ns: of its header, else of its recording, since 1970."""

    channel: Channel
    stamp_ns: int
    path: Path
    place: Place

    def payload(self) -> bytes:
        """The message as it was recorded. Raises InputError if it cannot be read any more,
        DeviceError without the library.
        """
        return payload(self.path, self.place)


@dataclass(frozen=True)
class Topic:
    """A topic of a bag. entries: messages by stamps, where indexed. count: of all messages."""

    name: str
    msgtype: str
    count: int
    first_ns: int
    last_ns: int
    entries: tuple[Entry, ...] = ()

    @property
    def rate_hz(self) -> float | None:
        """Messages a second, None for fewer than two."""
        return (
            (self.count - 1) * 1e9 / (self.last_ns - self.first_ns)
            if self.last_ns > self.first_ns
            else None
        )


@dataclass(frozen=True)
class Bag:
    """A bag. problems: what could not be read, a line each; unstamped: topics without times."""

    path: Path
    files: tuple[Path, ...]
    topics: tuple[Topic, ...]
    problems: tuple[str, ...]
    unstamped: tuple[str, ...] = ()

    def topic(self, name: str) -> Topic | None:
        """The topic of that name."""
        return next((topic for topic in self.topics if topic.name == name), None)


@dataclass
class _Gathered:
    count: int = 0
    first_ns: int = 1 << 63
    last_ns: int = 0
    kept_ns: int = -THINNED_NS
    entries: list[Entry] = field(default_factory=list)


def is_bag(path: Path) -> bool:
    """Tell whether a path is a bag's file, or a folder that holds some."""
    return (path.suffix.lower() in SUFFIXES and not path.is_dir()) or (
        path.is_dir() and any(_bag_files(path))
    )


def open_bag(path: Path) -> Bag:
    """Walk a bag: a file (.bag, .bag.active, .db3, .mcap), or a folder of one that was split.

    Raises InputError if it is missing, no bag, or holds no message that can be read; DeviceError if
    a library is missing.
    """
    files = files_of(path)
    problems: list[str] = []
    unstamped: Counter[str] = Counter()
    gathered: dict[tuple[str, str], _Gathered] = {}
    for file in files:
        read_problems: list[str] = []
        for message in _messages(file, read_problems):
            topic = gathered.setdefault(
                (message.channel.topic, message.channel.msgtype), _Gathered()
            )
            topic.count += 1
            topic.first_ns, topic.last_ns = (
                min(topic.first_ns, message.time_ns),
                max(topic.last_ns, message.time_ns),
            )
            if message.channel.msgtype in INDEXED or message.channel.topic == STATIC_TRANSFORMS:
                stamp_ns = _stamp_ns(message, file)
                if (
                    message.channel.msgtype in THINNED
                    and 0 <= stamp_ns - topic.kept_ns < THINNED_NS
                ):
                    continue
                topic.kept_ns = stamp_ns
                unstamped[message.channel.topic] += not stamp_ns
                topic.entries.append(
                    Entry(message.channel, stamp_ns or message.time_ns, file, message.place)
                )
        problems += [f"{file}: {problem}" for problem in dict.fromkeys(read_problems)]
    if not gathered:
        raise InputError(problems[0] if problems else f"{path}: holds no messages")
    topics = [_topic(name, msgtype, found) for (name, msgtype), found in sorted(gathered.items())]
    return Bag(path, tuple(files), tuple(topics), tuple(problems), tuple(sorted(+unstamped)))


def _topic(name: str, msgtype: str, gathered: _Gathered) -> Topic:
    entries = tuple(sorted(gathered.entries, key=lambda entry: entry.stamp_ns))
    return Topic(name, msgtype, gathered.count, gathered.first_ns, gathered.last_ns, entries)


def payload(path: Path, place: Place) -> bytes:
    """A message's bytes. Raises InputError if they cannot be read, DeviceError."""
    try:
        if path.suffix.lower() == ".db3":
            content = sqlite_file.read(path, place.start)
        elif place.chunk:
            content = _plain_chunk(path, place.chunk)[place.start : place.start + place.size]
        else:
            with FileSource(path) as source:
                content = source.bytes_at(place.start, place.size)
        return decompress_message(content)
    except (OSError, Cut, sqlite3.Error, KeyError) as error:
        raise InputError(
            f"{path}: a message of it cannot be read: {error}: copy the bag again from the vehicle"
        ) from error


def decompress_message(content: bytes) -> bytes:
    """A message; some ROS 2 recorders compress each by itself."""
    if not content.startswith(ZSTD_MAGIC):
        return content
    return decompress(content, Chunk(0, len(content), "zstd", 1 << 29))


@lru_cache(CACHED_CHUNKS)
def _plain_chunk(path: Path, chunk: Chunk) -> bytes:
    with FileSource(path) as source:
        return decompress(source.bytes_at(chunk.start, chunk.size), chunk)


def _messages(path: Path, problems: list[str]) -> Iterator[Message]:
    """All messages of one file, told by its first bytes and not by its name."""
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a bag")
        with FileSource(path) as source:
            begin = source.bytes_at(0, min(source.size, len(SQLITE_MAGIC)))
            if begin.startswith(ROS1_MAGIC):
                yield from walk_ros1(source, problems)
            elif begin.startswith(MCAP_MAGIC):
                yield from walk_mcap(source, problems)
            elif begin == SQLITE_MAGIC:
                yield from walk_sqlite(path, problems)
            elif tool := next(
                (tool for magic, tool in UNPACKED_BY.items() if begin.startswith(magic)), None
            ):
                problems.append(
                    f"is compressed as a whole: unpack it first with {tool} {path.name}"
                )
            else:
                problems.append(
                    "is empty"
                    if not begin
                    else "is not a ROS bag: it does not begin like .bag (2.0), .db3 or .mcap"
                )
    except OSError as error:
        problems.append(f"cannot be read: {error.strerror or error}")


def _stamp_ns(message: Message, path: Path) -> int:
    """The time in a message's header, nanoseconds; 0 where there is none. ROS 1 and CDR have it at
    the same place, but for a ROS 1 message that begins with it.
    """
    channel = message.channel
    try:
        head = message.head(message.place.size if channel.encoding == "json" else HEAD_BYTES)
        if head.startswith(ZSTD_MAGIC):
            head = payload(path, message.place)
    except (Cut, InputError):
        return 0
    if channel.encoding in ("protobuf", "json"):
        return foxglove_stamp_ns(head, channel.encoding)
    big_endian = channel.encoding == "cdr" and len(head) > 1 and not head[1] & 1
    if len(head) < 12:
        return 0
    start = 0 if (channel.encoding, channel.msgtype) == ("ros1", VIDEOS[0]) else 4
    seconds, nanoseconds = struct.unpack_from(">II" if big_endian else "<II", head, start)
    return int(seconds * 10**9 + nanoseconds) if nanoseconds < 10**9 else 0


def files_of(path: Path) -> Sequence[Path]:
    """The files of a bag, in their order. Raises InputError."""
    if not path.exists():
        raise InputError(f"{path}: the bag does not exist")
    if not path.is_dir():
        return [path]
    found = sorted(_bag_files(path), key=lambda file: natural_key(file.name))
    if not found:
        zipped = next(iter(sorted(path.glob("*.zst*"))), None)
        hint = f"; {zipped.name} is compressed as a whole: unpack it with zstd -d" if zipped else ""
        raise InputError(f"{path}: holds no bag ({', '.join(sorted(SUFFIXES))}){hint}")
    return found


def _bag_files(folder: Path) -> Iterator[Path]:
    with os.scandir(folder) as entries:
        yield from (Path(entry.path) for entry in entries if _is_named_bag(entry.name))


def _is_named_bag(name: str) -> bool:
    return Path(name).suffix.lower() in SUFFIXES and not name.startswith(".")
