"""Files of bags: MCAP, ROS 1 and SQLite, record by record."""

import contextlib
import sqlite3
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from stereo_seecolor.extras.streams.bags.source import (
    PLAIN,
    ByteSource,
    Channel,
    Chunk,
    Cut,
    MemorySource,
    Message,
    Place,
    decompress,
)

# MCAP files, record by record; no summary and no index are needed (https://mcap.dev/spec).

MCAP_MAGIC = b"\x89MCAP0\r\n"
MAX_DECLARATION_BYTES = 1 << 22
"""Schemas and channels hold definitions of messages: some kB."""

_FOOTER, _SCHEMA, _CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK, _DATA_END = (
    0x02,
    0x03,
    0x04,
    0x05,
    0x06,
    0x0F,
)
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")


class _McapRecord(NamedTuple):
    kind: int
    start: int
    size: int


@dataclass
class _Declared:
    """What the file has said so far of its schemas and channels."""

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)


def walk_mcap(source: ByteSource, problems: list[str]) -> Iterator[Message]:
    """Iterate over the messages in the order of the file, as far as it can be read. What is wrong
    with it is added to ``problems``.
    """
    declared, closed = _Declared(), False
    try:
        for record in _records_mcap(source, len(MCAP_MAGIC)):
            if record.kind == _MCAP_CHUNK:
                try:
                    yield from _of_chunk_mcap(source, record, declared)
                except Cut as cut:
                    problems.append(str(cut))
            elif record.kind == _DATA_END:
                closed = True
                break
            else:
                yield from _found_mcap(source, record, declared, None)
    except Cut as cut:
        problems.append(str(cut))
    else:
        problems += (
            [] if closed else ["was not closed by its recorder; it is read without an index"]
        )


def _of_chunk_mcap(
    source: ByteSource, record: _McapRecord, declared: _Declared
) -> Iterator[Message]:
    _, _, plain_size, _ = _CHUNK_HEAD.unpack(source.bytes_at(record.start, _CHUNK_HEAD.size))
    compression, start = _text(source, record.start + _CHUNK_HEAD.size)
    (size,) = struct.unpack("<Q", source.bytes_at(start, 8))
    start, available = start + 8, min(size, source.size - start - 8)
    if compression in PLAIN:
        for inner in _records_mcap(source, start, start + available):
            yield from _found_mcap(source, inner, declared, None)
        return
    chunk = Chunk(start, available, compression, plain_size)
    plain = MemorySource(decompress(source.bytes_at(start, available), chunk))
    for inner in _records_mcap(plain, 0):
        yield from _found_mcap(plain, inner, declared, chunk)


def _records_mcap(source: ByteSource, start: int, end: int | None = None) -> Iterator[_McapRecord]:
    """Every record from ``start``; a chunk that the file's end cuts is still given."""
    end = source.size if end is None else end
    while start < end and source.bytes_at(start, min(8, end - start)) != MCAP_MAGIC:
        kind, size = struct.unpack("<BQ", source.bytes_at(start, 9))
        start += 9
        if start + size > source.size and kind != _MCAP_CHUNK:
            raise Cut(f"ends at byte {source.size}, in the middle of a record")
        yield _McapRecord(kind, start, size)
        start += size
    if start > source.size:
        raise Cut(f"ends at byte {source.size}, in the middle of a record")


def _found_mcap(
    source: ByteSource, record: _McapRecord, declared: _Declared, chunk: Chunk | None
) -> Iterator[Message]:
    start = record.start
    if record.kind == _SCHEMA:
        declared.schemas[_short(source, start)] = _text(source, start + 2)[0]
    elif record.kind == _CHANNEL:
        topic, next_start = _text(source, start + 4)
        msgtype = declared.schemas.get(_short(source, start + 2), "")
        msgtype = msgtype if "/msg/" in msgtype else msgtype.replace("/", "/msg/", 1)
        declared.channels[_short(source, start)] = Channel(
            topic, msgtype, _text(source, next_start)[0]
        )
    elif record.kind == _MCAP_MESSAGE and record.size >= _MESSAGE_HEAD.size:
        number, _, time_ns, _ = _MESSAGE_HEAD.unpack(source.bytes_at(start, _MESSAGE_HEAD.size))
        place = Place(start + _MESSAGE_HEAD.size, record.size - _MESSAGE_HEAD.size, chunk)
        if channel := declared.channels.get(number):
            yield Message(
                channel,
                time_ns,
                place,
                lambda most: source.bytes_at(place.start, min(most, place.size)),
            )


def _short(source: ByteSource, start: int) -> int:
    return int.from_bytes(source.bytes_at(start, 2), "little")


def _text(source: ByteSource, start: int) -> tuple[str, int]:
    """A string, and where the next field begins."""
    size = int.from_bytes(source.bytes_at(start, 4), "little")
    if size > MAX_DECLARATION_BYTES:
        raise Cut(f"is damaged at byte {start}")
    return source.bytes_at(start + 4, size).decode(errors="replace"), start + 4 + size


# ROS 1 bags, format 2.0, record by record; no index is needed
# (http://wiki.ros.org/Bags/Format/2.0).

ROS1_MAGIC = b"#ROSBAG V2.0\n"
MAX_HEADER_BYTES = 1 << 16
"""A record's header holds some short fields; a connection's data hold the definition of its
messages, and are not read here.
"""

_ROS1_MESSAGE, _BAG, _ROS1_CHUNK, _CONNECTION = b"\x02", b"\x03", b"\x05", b"\x07"


class _Ros1Record(NamedTuple):
    """Fields of its header; where its data lie."""

    fields: dict[bytes, bytes]
    start: int
    size: int


def walk_ros1(source: ByteSource, problems: list[str]) -> Iterator[Message]:
    """Iterate over the messages in the order of the file, as far as it can be read. What is wrong
    with it is added to ``problems``.
    """
    channels: dict[bytes, Channel] = {}
    try:
        for record in _records_ros1(source, len(ROS1_MAGIC)):
            kind = record.fields.get(b"op", b"")
            if kind == _BAG and not any(record.fields.get(b"index_pos", b"")):
                problems.append("was not closed by its recorder; it is read without an index")
            if kind != _ROS1_CHUNK:
                yield from _found_ros1(source, record, channels, None)
                continue
            try:
                yield from _of_chunk_ros1(source, record, channels)
            except Cut as cut:
                problems.append(str(cut))
    except Cut as cut:
        problems.append(str(cut))


def _of_chunk_ros1(
    source: ByteSource, record: _Ros1Record, channels: dict[bytes, Channel]
) -> Iterator[Message]:
    compression = record.fields.get(b"compression", b"").decode(errors="replace")
    available = min(record.size, source.size - record.start)
    if compression in PLAIN:
        for inner in _records_ros1(source, record.start, record.start + available):
            yield from _found_ros1(source, inner, channels, None)
        return
    chunk = Chunk(record.start, available, compression, _number(record.fields, b"size"))
    plain = MemorySource(decompress(source.bytes_at(chunk.start, chunk.size), chunk))
    for inner in _records_ros1(plain, 0):
        yield from _found_ros1(plain, inner, channels, chunk)


def _records_ros1(source: ByteSource, start: int, end: int | None = None) -> Iterator[_Ros1Record]:
    """Every record from ``start``; a chunk that the file's end cuts is still given."""
    end = source.size if end is None else end
    while start < end:
        (header_size,) = struct.unpack("<I", source.bytes_at(start, 4))
        if header_size > MAX_HEADER_BYTES:
            raise Cut(f"is damaged at byte {start}")
        fields = _fields(source.bytes_at(start + 4, header_size), start)
        (size,) = struct.unpack("<I", source.bytes_at(start + 4 + header_size, 4))
        start += 8 + header_size
        if start + size > source.size and fields.get(b"op") != _ROS1_CHUNK:
            raise Cut(f"ends at byte {source.size}, in the middle of a record")
        yield _Ros1Record(fields, start, size)
        start += size
    if start > source.size:
        raise Cut(f"ends at byte {source.size}, in the middle of a record")


def _found_ros1(
    source: ByteSource, record: _Ros1Record, channels: dict[bytes, Channel], chunk: Chunk | None
) -> Iterator[Message]:
    kind, connection = record.fields.get(b"op", b""), record.fields.get(b"conn", b"")
    if kind == _CONNECTION:
        described = _fields(source.bytes_at(record.start, record.size), record.start)
        topic = record.fields.get(b"topic", b"").decode(errors="replace")
        name = described.get(b"type", b"").decode(errors="replace")
        channels[connection] = Channel(topic, name.replace("/", "/msg/", 1), "ros1")
    elif kind == _ROS1_MESSAGE and connection in channels:
        seconds, nanoseconds = struct.unpack(
            "<II", record.fields.get(b"time", bytes(8))[:8].ljust(8, b"\0")
        )
        place = Place(record.start, record.size, chunk)
        time_ns = seconds * 10**9 + nanoseconds
        yield Message(
            channels[connection],
            time_ns,
            place,
            lambda most: source.bytes_at(place.start, min(most, place.size)),
        )


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


# ROS 2 bags in SQLite (.db3), row by row.

SQLITE_MAGIC = b"SQLite format 3\x00"
HEAD_BYTES = 64
"""Of each message so much is read while the file is walked: enough for a header's time."""


def connect(path: Path) -> sqlite3.Connection:
    """The file, opened for reading; nothing is written beside it. Raises sqlite3.Error.

    A recorder that was killed leaves a journal with the last messages, which only an ordinary
    connection reads. A file that was cut is read as far as it goes, which SQLite does only with
    writable_schema (nothing is written: the connection is for reading).
    """
    journal = path.with_name(f"{path.name}-wal").exists()
    database = sqlite3.connect(
        f"{path.absolute().as_uri()}?mode=ro{'' if journal else '&immutable=1'}", uri=True
    )
    database.execute("PRAGMA writable_schema = ON")
    return database


def walk_sqlite(path: Path, problems: list[str]) -> Iterator[Message]:
    """Iterate over the messages in the order of the file, as far as it can be read. What is wrong
    with it is added to ``problems``.

    place: its start is the number of the row.
    """
    try:
        with contextlib.closing(connect(path)) as database:
            channels = {
                number: Channel(str(topic), str(msgtype), str(encoding))
                for number, topic, msgtype, encoding in database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                )
            }
            rows = database.execute(
                "SELECT id, topic_id, timestamp, length(data), substr(data, 1, ?) FROM messages "
                "ORDER BY id",
                (HEAD_BYTES,),
            )
            for row, number, time_ns, size, head in rows:
                if number in channels and isinstance(head, bytes):
                    yield Message(channels[number], int(time_ns), Place(row, size), _first(head))
    except (sqlite3.Error, OverflowError, ValueError) as error:
        problems.append(f"cannot be read further: {error}")


def read(path: Path, row: int) -> bytes:
    """Read one message. Raises sqlite3.Error; KeyError where it is gone."""
    with contextlib.closing(connect(path)) as database:
        found = database.execute("SELECT data FROM messages WHERE id = ?", (row,)).fetchone()
    if found is None:
        raise KeyError(row)
    return bytes(found[0])


def _first(head: bytes) -> Callable[[int], bytes]:
    return lambda most: head[:most]
