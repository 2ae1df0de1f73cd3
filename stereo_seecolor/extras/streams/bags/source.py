"""Bytes of a bag by offset, in its file or a decompressed chunk; and the messages in them."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol, Self


class Cut(ValueError):  # no error for users: the walk of a file ends here
    """The file ends, or stops making sense, at a byte."""


def ended(size: int) -> Cut:
    """A file of so many bytes that ends in the middle of a record."""
    return Cut(f"ends at byte {size}, in the middle of a record")


class Channel(NamedTuple):
    """A topic as a bag's file declares it. msgtype: as ROS 2 writes it, ``sensor_msgs/msg/Image``.
    encoding: ros1 or cdr.
    """

    topic: str
    msgtype: str
    encoding: str


class Place(NamedTuple):
    """The place of a message: ``size`` bytes from ``start``, in the file, or in the chunk that
    ``chunk`` finds (None = the file).
    """

    start: int
    size: int
    chunk: "Chunk | None" = None


class Chunk(NamedTuple):
    """A compressed part of the file: its data, how they are compressed, and their stated size."""

    start: int
    size: int
    compression: str
    plain_size: int


class Message(NamedTuple):
    """A message that was found: when it was recorded, where, and a way to its first bytes."""

    channel: Channel
    time_ns: int
    place: Place
    head: Callable[[int], bytes]

    @classmethod
    def found(cls, source: "ByteSource", channel: Channel, time_ns: int, place: Place) -> "Message":
        """The message at a place of a source."""
        return cls(
            channel,
            time_ns,
            place,
            lambda most: source.bytes_at(place.start, min(most, place.size)),
        )


class ByteSource(Protocol):
    """A sequence of bytes, read by offset."""

    @property
    def size(self) -> int:
        """Number of bytes."""

    def bytes_at(self, start: int, size: int) -> bytes:
        """Exactly so many bytes. Raises Cut if there are fewer."""


class FileSource:
    """A bag's file, as a context manager. Raises OSError."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        self.size = os.fstat(self._file.fileno()).st_size

    def bytes_at(self, start: int, size: int) -> bytes:
        """Exactly so many bytes. Raises Cut if there are fewer."""
        if size < 0 or start + size > self.size:
            raise ended(self.size)
        self._file.seek(start)
        return self._file.read(size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


@dataclass(frozen=True)
class MemorySource:
    """The content of a chunk."""

    content: bytes

    @property
    def size(self) -> int:
        """The number of bytes."""
        return len(self.content)

    def bytes_at(self, start: int, size: int) -> bytes:
        """Exactly so many bytes. Raises Cut if there are fewer."""
        if size < 0 or start + size > len(self.content):
            raise Cut("holds a chunk that ends in the middle of a record")
        return self.content[start : start + size]
