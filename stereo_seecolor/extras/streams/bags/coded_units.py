"""What a message of H.264 or H.265 holds, by the units of its byte stream (Annex B): a picture, a
keyframe, and in H.264 whether a picture that it builds on is missing.

Sources: ITU-T H.264, 7.3 (sequence parameter sets, slice headers) and 7.4.3 (frame_num); ITU-T
H.265, 7.4.2.2 (types of units).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

H264, H265 = "h264", "hevc"
"""The names that FFmpeg has for them."""
NAMES = {H264: ("264", "avc"), H265: ("265", "hevc")}
"""Codec -> what its name in messages holds: ``h264``, ``libx264``, ``H.265``, ``hevc_nvenc``."""

START = b"\0\0\1"
"""Begins a unit."""
_SLICES = {H264: (1, 5), H265: range(32)}
_KEYS = {H264: (5,), H265: range(16, 24)}
_PARAMETERS = {H264: (7, 8), H265: (32, 33, 34)}
"""Codec -> types of units: of slices, of slices of keyframes, of parameter sets."""
_H264_SEQUENCE = 7
"""The parameter set of H.264 that says how pictures are numbered."""
_H265_LEADING = (8, 9)
"""Slices that are skipped where decoding begins at the keyframe before them (RASL)."""
_CHROMA_PROFILES = (100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135)
_HEAD_BYTES = 64
"""More than the fields of a head that are read here ever take."""


def codec_of(form: str) -> str:
    """The codec of a message by the name that it states; "" for another one."""
    form = form.lower()
    return next(
        (codec for codec, names in NAMES.items() if any(name in form for name in names)), ""
    )


@dataclass(frozen=True)
class Coded:
    """What a message holds. is_leading: it builds on pictures before the last keyframe, and no
    other one on it. is_lost: a picture that it builds on never came. parameters: of a keyframe, the
    units without which no decoder begins with it, which some encoders send once.
    """

    is_picture: bool
    is_key: bool = False
    is_leading: bool = False
    is_lost: bool = False
    parameters: bytes = b""


class Units:
    """Looks at the messages of one topic, in the order of sending. codec: H264 or H265."""

    def __init__(self, codec: str) -> None:
        self._codec = codec
        self._parameters = b""
        self._numbering: tuple[int, int] | None = None  # bits, and bits before it in a slice
        self._last = 0
        self._after_picture = False

    def look(self, data: bytes) -> Coded:
        """What the next message holds."""
        for unit in _units(data):
            kind = unit[0] >> 1 & 0x3F if self._codec == H265 else unit[0] & 0x1F
            if kind in _PARAMETERS[self._codec]:
                self._parameters = (b"" if self._after_picture else self._parameters) + START + unit
                self._after_picture = False
                if kind == _H264_SEQUENCE:
                    self._numbering = _numbering(unit)
            elif kind in _SLICES[self._codec]:
                self._after_picture = True
                is_key = kind in _KEYS[self._codec]
                return Coded(
                    True,
                    is_key,
                    self._codec == H265 and kind in _H265_LEADING,
                    self._codec == H264 and self._is_lost(unit, is_key),
                    self._parameters if is_key else b"",
                )
        return Coded(False)

    def _is_lost(self, unit: bytes, is_key: bool) -> bool:
        """True where the number of the picture leaves out one that others build on."""
        if self._numbering is None:
            return False
        bits, colors = self._numbering
        try:
            head = _Bits(unit)
            for _ in ("first_mb_in_slice", "slice_type", "pic_parameter_set_id"):
                head.golomb()
            head.number(colors)
            number = head.number(bits)
        except ValueError:
            return False
        ahead = (number - self._last) % (1 << bits)
        if unit[0] & 0x60:  # others may build on it
            self._last = number
        return not is_key and ahead > 1


def _units(data: bytes) -> Iterator[bytes]:
    """The units of a message."""
    starts = [found.end() for found in re.finditer(START, data)]
    for start, end in pairwise([*starts, len(data) + len(START)]):
        if unit := data[start : end - len(START)].rstrip(b"\0"):
            yield unit


def _numbering(unit: bytes) -> tuple[int, int] | None:
    """Of a sequence parameter set: the bits of frame_num, and those of colour_plane_id before it.
    None where pictures may be left out on purpose, or the set is of a kind that is not read.
    """
    try:
        head, colors = _Bits(unit), 0
        profile = head.number(24) >> 16
        head.golomb()
        if profile in _CHROMA_PROFILES:
            if head.golomb() == 3:
                colors = 2 * head.number(1)
            head.golomb()
            head.golomb()
            if head.number(2) & 1:  # scaling matrices
                return None
        bits = head.golomb() + 4
        order = head.golomb()
        if order == 0:
            head.golomb()
        elif order == 1:
            head.number(1)
            for _ in range(2):
                head.golomb()
            for _ in range(head.golomb()):
                head.golomb()
        head.golomb()
        return None if head.number(1) or bits > 16 else (bits, colors)
    except ValueError:
        return None


class _Bits:
    """The bits of a unit after its first byte. Raises ValueError beyond its end."""

    def __init__(self, unit: bytes) -> None:
        plain = unit[1:_HEAD_BYTES].replace(b"\0\0\3", b"\0\0")
        self._bits = f"{int.from_bytes(plain):0{8 * len(plain)}b}" if plain else ""
        self._at = 0

    def number(self, bits: int) -> int:
        """A number of so many bits."""
        self._at += bits
        if self._at > len(self._bits):
            raise ValueError("ends in its head")
        return int(self._bits[self._at - bits : self._at] or "0", 2)

    def golomb(self) -> int:
        """A number in Exp-Golomb code (H.264, 9.1)."""
        zeros = self._bits.find("1", self._at) - self._at
        if zeros < 0:
            raise ValueError("ends in its head")
        self._at += zeros
        return self.number(zeros + 1) - 1
