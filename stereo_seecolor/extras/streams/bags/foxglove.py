"""Images as Foxglove's own messages, in MCAP files that no ROS wrote: protobuf and JSON.

Source: Foxglove, *Message schemas* (CompressedVideo, CompressedImage).
"""

import base64
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

from calibration.bounded_text import load_json

FOXGLOVE_VIDEO, FOXGLOVE_IMAGE = "foxglove.CompressedVideo", "foxglove.CompressedImage"
_FIELDS = {
    FOXGLOVE_VIDEO: {2: "frame_id", 3: "data", 4: "format"},
    FOXGLOVE_IMAGE: {2: "data", 3: "format", 4: "frame_id"},
}
"""Type -> number of a field in protobuf -> its name. The time is field 1 of both."""
_VARINT, _FIXED_64, _BYTES, _FIXED_32 = 0, 1, 2, 5
"""Wire types of protobuf."""


def parse_foxglove(content: bytes, msgtype: str, encoding: str) -> Any:
    """A message, its fields as attributes; data is bytes. encoding: protobuf or json.

    Raises ValueError where it is damaged.
    """
    if encoding == "json":
        fields = load_json(content)
        return SimpleNamespace(
            frame_id=str(fields.get("frame_id", "")),
            format=str(fields.get("format", "")),
            data=base64.b64decode(fields["data"]),
        )
    found: dict[str, bytes] = {}
    for number, value in _protobuf(content):
        name = _FIELDS[msgtype].get(number)
        if name and isinstance(value, bytes):
            found[name] = value
    return SimpleNamespace(
        frame_id=found.get("frame_id", b"").decode(),
        format=found.get("format", b"").decode(),
        data=found.get("data", b""),
    )


def foxglove_stamp_ns(content: bytes, encoding: str) -> int:
    """The time of a message, or of its first bytes in protobuf; 0 where there is none."""
    try:
        if encoding == "json":
            time = load_json(content)["timestamp"]
            return int(time["sec"]) * 10**9 + int(time["nsec"])
        number, time = next(_protobuf(content))
        if number != 1 or not isinstance(time, bytes):
            return 0
        parts = dict(_protobuf(time))
        return int(parts.get(1, 0)) * 10**9 + int(parts.get(2, 0))
    except (ValueError, TypeError, KeyError, StopIteration):
        return 0


def _protobuf(content: bytes) -> Iterator[tuple[int, int | bytes]]:
    """The fields of a message, each with its number. Raises ValueError where they are cut."""
    at = 0
    while at < len(content):
        key, at = _varint(content, at)
        number, kind = key >> 3, key & 7
        if kind == _VARINT:
            value, at = _varint(content, at)
            yield number, value
            continue
        if kind == _BYTES:
            size, at = _varint(content, at)
        elif kind in (_FIXED_64, _FIXED_32):
            size = 8 if kind == _FIXED_64 else 4
        else:
            raise ValueError(f"field {number} is of no type of protobuf")
        if at + size > len(content):
            raise ValueError(f"ends in field {number}")
        yield number, content[at : at + size]
        at += size


def _varint(content: bytes, at: int) -> tuple[int, int]:
    """A number of 7 bits a byte, the least first, and where the next begins."""
    value = 0
    for i, byte in enumerate(content[at : at + 10]):
        value |= (byte & 0x7F) << (7 * i)
        if byte < 0x80:
            return value, at + i + 1
    raise ValueError("ends in a number")
