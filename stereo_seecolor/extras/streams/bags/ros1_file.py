"""ROS 1 bags 2.0, record by record; no index is needed (http://wiki.ros.org/Bags/Format/2.0)."""

import struct
from collections.abc import Iterator
from typing import NamedTuple

from stereo_seecolor.extras.streams.bags.decompression import PLAIN, decompress
from stereo_seecolor.extras.streams.bags.source import (
    ByteSource,
    Channel,
    Chunk,
    Cut,
    MemorySource,
    Message,
    Place,
    ended,
)

ROS1_MAGIC = b"#ROSBAG V2.0\n"
MAX_HEADER_BYTES = 1 << 16
"""A record's header holds some short fields; a connection's data hold the definition of its
messages, and are not read here.
"""

_MESSAGE, _BAG, _CHUNK, _CONNECTION = b"\x02", b"\x03", b"\x05", b"\x07"


class _Ros1Record(NamedTuple):
    """Fields of its header; where its data lie."""

    fields: dict[bytes, bytes]
    start: int
    size: int


def walk_ros1(source: ByteSource, problems: list[str]) -> Iterator[Message]:
    """The messages in the file's order, as far as it can be read; ``problems`` gets the rest."""
    channels: dict[bytes, Channel] = {}
    try:
        for record in _records(source, len(ROS1_MAGIC)):
            kind = record.fields.get(b"op", b"")
            if kind == _BAG and not any(record.fields.get(b"index_pos", b"")):
                problems.append("was not closed by its recorder; it is read without an index")
            if kind != _CHUNK:
                yield from _found(source, record, channels, None)
                continue
            try:
                yield from _of_chunk(source, record, channels)
            except Cut as cut:
                problems.append(str(cut))
    except Cut as cut:
        problems.append(str(cut))


def _of_chunk(
    source: ByteSource, record: _Ros1Record, channels: dict[bytes, Channel]
) -> Iterator[Message]:
    compression = record.fields.get(b"compression", b"").decode(errors="replace")
    available = min(record.size, source.size - record.start)
    if compression in PLAIN:
        for inner in _records(source, record.start, record.start + available):
            yield from _found(source, inner, channels, None)
        return
    chunk = Chunk(record.start, available, compression, _number(record.fields, b"size"))
    plain = MemorySource(decompress(source.bytes_at(chunk.start, chunk.size), chunk))
    for inner in _records(plain, 0):
        yield from _found(plain, inner, channels, chunk)


def _records(source: ByteSource, start: int, end: int | None = None) -> Iterator[_Ros1Record]:
    """Every record from ``start``; a chunk that the file's end cuts is still given."""
    end = source.size if end is None else end
    while start < end:
        (header_size,) = struct.unpack("<I", source.bytes_at(start, 4))
        if header_size > MAX_HEADER_BYTES:
            raise Cut(f"is damaged at byte {start}")
        fields = _fields(source.bytes_at(start + 4, header_size), start)
        (size,) = struct.unpack("<I", source.bytes_at(start + 4 + header_size, 4))
        start += 8 + header_size
        if start + size > source.size and fields.get(b"op") != _CHUNK:
            raise ended(source.size)
        yield _Ros1Record(fields, start, size)
        start += size
    if start > source.size:
        raise ended(source.size)


def _found(
    source: ByteSource, record: _Ros1Record, channels: dict[bytes, Channel], chunk: Chunk | None
) -> Iterator[Message]:
    kind, connection = record.fields.get(b"op", b""), record.fields.get(b"conn", b"")
    if kind == _CONNECTION:
        described = _fields(source.bytes_at(record.start, record.size), record.start)
        topic = record.fields.get(b"topic", b"").decode(errors="replace")
        name = described.get(b"type", b"").decode(errors="replace")
        channels[connection] = Channel(topic, name.replace("/", "/msg/", 1), "ros1")
    elif kind == _MESSAGE and connection in channels:
        seconds, nanoseconds = struct.unpack(
            "<II", record.fields.get(b"time", bytes(8))[:8].ljust(8, b"\0")
        )
        place = Place(record.start, record.size, chunk)
        time_ns = seconds * 10**9 + nanoseconds
        yield Message.found(source, channels[connection], time_ns, place)


def _fields(content: bytes, where: int) -> dict[bytes, bytes]:
    fields, start = {}, 0
    while start + 4 <= len(content):
        (size,) = struct.unpack_from("<I", content, start)
        name, equals, value = content[start + 4 : start + 4 + size].partition(b"=")
        if not equals or start + 4 + size > len(content):
            raise Cut(f"is damaged at byte {where}")
        fields[name] = value
        start += 4 + size
    return fields


def _number(fields: dict[bytes, bytes], name: bytes) -> int:
    return int.from_bytes(fields.get(name, b"")[:8], "little")
