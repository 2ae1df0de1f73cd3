"""Bytes of a bag by their offset, in its file or in a decompressed chunk of it; and the messages
found in them.
"""

import bz2
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self

from stereo_seecolor.errors import DeviceError


class Cut(ValueError):  # no error for users: the walk of a file ends here
    """The file ends, or stops making sense, at a byte."""


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
    """A compressed part of the file: its data, how they are compressed, and how large they are said
    to be.
    """

    start: int
    size: int
    compression: str
    plain_size: int


class Message(NamedTuple):
    """A message that was found: when it was recorded, where it lies, and a way to its first
    bytes.
    """

    channel: Channel
    time_ns: int
    place: Place
    head: Callable[[int], bytes]


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
            raise Cut(f"ends at byte {self.size}, in the middle of a record")
        self._file.seek(start)
        return self._file.read(size)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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


# Decompression of bags' chunks, to at most the size that a bag may hold.

MAX_CHUNK_BYTES = 1 << 29
"""Recorders cut chunks at 1 to 4 MB or after one message; a raw image of 150 million pixels has 450
MB. More is damage.
"""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
PLAIN = ("", "none")


def decompress(content: bytes, chunk: Chunk) -> bytes:
    """The content of a chunk; of one that was cut short, as much as it holds. Raises Cut if it is
    damaged, DeviceError.
    """
    if chunk.plain_size > MAX_CHUNK_BYTES:
        raise Cut(f"claims a chunk of {chunk.plain_size / 1e6:.0f} MB at byte {chunk.start}")
    try:
        found: bytes = decompressor(chunk.compression).decompress(content, chunk.plain_size)
    except DeviceError:
        raise
    except Exception as error:  # each library raises errors of its own
        raise Cut(f"holds a damaged chunk at byte {chunk.start} ({error})") from error
    return found


def decompressor(compression: str) -> Any:
    """Choose the function that decompresses one chunk. Raises Cut for an unknown compression,
    DeviceError if its library is missing.
    """
    try:
        if compression == "bz2":
            return bz2.BZ2Decompressor()
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return LZ4FrameDecompressor()
        if compression == "zstd":
            from zstandard import ZstdDecompressor

            return _Zstd(ZstdDecompressor())
    except ImportError as error:
        raise DeviceError(
            f"bags need a library that is missing ({error.name}): pip install -c constraints.txt "
            "'.[bags]'"
        ) from error
    raise Cut(f"uses the compression {compression!r}, which is not supported")


class _Zstd:
    """zstandard with the call of the other libraries."""

    def __init__(self, library: Any) -> None:
        self._library = library

    def decompress(self, content: bytes, most: int) -> bytes:
        with self._library.stream_reader(content, read_across_frames=False) as reader:
            found: bytes = reader.read(most)
        return found
