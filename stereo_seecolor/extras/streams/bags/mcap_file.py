"""MCAP files, record by record; no summary and no index are needed (https://mcap.dev/spec)."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
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

MCAP_MAGIC = b"\x89MCAP0\r\n"
MAX_DECLARATION_BYTES = 1 << 22
"""Schemas and channels hold definitions of messages: some kB."""

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = (0x02, 0x03, 0x04, 0x05, 0x06, 0x0F)
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")


class _McapRecord(NamedTuple):
    kind: int
    start: int
    size: int


@dataclass
class _Declared:
    """The schemas and channels that were read so far."""

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)


def walk_mcap(source: ByteSource, problems: list[str]) -> Iterator[Message]:
    """The messages in the file's order, as far as it can be read; ``problems`` gets the rest."""
    declared, closed = _Declared(), False
    try:
        for record in _records(source, len(MCAP_MAGIC)):
            if record.kind == _CHUNK:
                try:
                    yield from _of_chunk(source, record, declared)
                except Cut as cut:
                    problems.append(str(cut))
            elif record.kind == _DATA_END:
                closed = True
                break
            else:
                yield from _found(source, record, declared, None)
    except Cut as cut:
        problems.append(str(cut))
    else:
        problems += (
            [] if closed else ["was not closed by its recorder; it is read without an index"]
        )


def _of_chunk(source: ByteSource, record: _McapRecord, declared: _Declared) -> Iterator[Message]:
    _, _, plain_size, _ = _CHUNK_HEAD.unpack(source.bytes_at(record.start, _CHUNK_HEAD.size))
    compression, start = _text(source, record.start + _CHUNK_HEAD.size)
    (size,) = struct.unpack("<Q", source.bytes_at(start, 8))
    start, available = start + 8, min(size, source.size - start - 8)
    if compression in PLAIN:
        for inner in _records(source, start, start + available):
            yield from _found(source, inner, declared, None)
        return
    chunk = Chunk(start, available, compression, plain_size)
    plain = MemorySource(decompress(source.bytes_at(start, available), chunk))
    for inner in _records(plain, 0):
        yield from _found(plain, inner, declared, chunk)


def _records(source: ByteSource, start: int, end: int | None = None) -> Iterator[_McapRecord]:
    """Every record from ``start``; a chunk that the file's end cuts is still given."""
    end = source.size if end is None else end
    while start < end and source.bytes_at(start, min(8, end - start)) != MCAP_MAGIC:
        kind, size = struct.unpack("<BQ", source.bytes_at(start, 9))
        start += 9
        if start + size > source.size and kind != _CHUNK:
            raise ended(source.size)
        yield _McapRecord(kind, start, size)
        start += size
    if start > source.size:
        raise ended(source.size)


def _found(
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
    elif record.kind == _MESSAGE and record.size >= _MESSAGE_HEAD.size:
        number, _, time_ns, _ = _MESSAGE_HEAD.unpack(source.bytes_at(start, _MESSAGE_HEAD.size))
        place = Place(start + _MESSAGE_HEAD.size, record.size - _MESSAGE_HEAD.size, chunk)
        if channel := declared.channels.get(number):
            yield Message.found(source, channel, time_ns, place)


def _short(source: ByteSource, start: int) -> int:
    return int.from_bytes(source.bytes_at(start, 2), "little")


def _text(source: ByteSource, start: int) -> tuple[str, int]:
    """A string, and where the next field begins."""
    size = int.from_bytes(source.bytes_at(start, 4), "little")
    if size > MAX_DECLARATION_BYTES:
        raise Cut(f"is damaged at byte {start}")
    return source.bytes_at(start + 4, size).decode(errors="replace"), start + 4 + size
