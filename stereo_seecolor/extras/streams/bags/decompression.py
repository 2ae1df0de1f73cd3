"""Decompression of bags' chunks, to at most the size that a bag may hold."""

import bz2
from typing import Any

from stereo_seecolor.errors import DeviceError, library_for
from stereo_seecolor.extras.streams.bags.source import Chunk, Cut

MAX_CHUNK_BYTES = 1 << 29
"""Recorders cut chunks at 1 to 4 MB or after one message; a raw image of 150 million pixels has 450
MB. More is damage.
"""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
PLAIN = ("", "none")


def decompress(content: bytes, chunk: Chunk) -> bytes:
    """The content of a chunk, as far as it is there. Raises Cut if damaged, DeviceError."""
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
    with library_for("a bag", "bags"):
        if compression == "bz2":
            return bz2.BZ2Decompressor()
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return LZ4FrameDecompressor()
        if compression == "zstd":
            from zstandard import ZstdDecompressor

            return _Zstd(ZstdDecompressor())
    raise Cut(f"uses the compression {compression!r}, which is not supported")


class _Zstd:
    """zstandard with the call of the other libraries."""

    def __init__(self, library: Any) -> None:
        self._library = library

    def decompress(self, content: bytes, most: int) -> bytes:
        with self._library.stream_reader(content, read_across_frames=False) as reader:
            found: bytes = reader.read(most)
        return found
