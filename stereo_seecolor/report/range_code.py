"""Ranges and heights for the page: whole numbers, predicted and packed into scripts."""

import string
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.files.deflate import deflated as compress
from stereo_seecolor.records import Map
from stereo_seecolor.report.prediction import UNKNOWN, predicted


@dataclass(frozen=True)
class RangeCode:
    """Settings of the code."""

    # half a step is 0.095 mm at 1 m, a tenth of a range's standard error; and no finer than
    step_per_m: float = 1.9e-4
    # this part of it as a frame states it: what rounding adds is 4 % of its square; with a whole
    # one, the page's areas differ from those of ``measure`` in the fourth digit
    of_std: float = 0.7
    std_floor_m: float = 1e-5  # no stereo measures better
    std_steps_per_octave: int = 12  # 3 % of the standard error; 8 bits reach 24 m
    std_block_px: int = 4  # standard errors vary slowly


RANGE_CODE = RangeCode()
LARGE = 15
"""Errors of predictions from which on they do not fit into half a byte."""
DIGITS = np.frombuffer(
    f"{string.digits}{string.ascii_uppercase}{string.ascii_lowercase}!#$%&()*+-;<=>?@^_`{{|}}~".encode(),
    np.uint8,
)
"""Of base85, by their value (RFC 1924)."""


@dataclass(frozen=True, eq=False)
class CodedRanges:
    """A coded range map. step_per_m: of the codes. planes: (2, H, W) uint8, low and high bytes of
    the prediction's errors.
    known: (H, W) bool.
    """

    step_per_m: float
    planes: NDArray[np.uint8]
    known: NDArray[np.bool_]

    @classmethod
    def of(cls, range_m: Map, std_m: Map) -> "CodedRanges":
        """Code ranges (H, W), NaN where unknown, with standard errors (H, W); the step is coarser
        if these allow it, or the nearest range requires it.
        """
        known = range_m > 0
        nearest_m = float(np.min(range_m, where=known, initial=np.inf))
        some = np.s_[:: RANGE_CODE.std_block_px, :: RANGE_CODE.std_block_px]
        inverse_std = std_m[some] / range_m[some] ** 2
        usual = inverse_std[np.isfinite(inverse_std)]
        allowed = RANGE_CODE.of_std * float(np.median(usual)) if usual.size else 0.0
        step = max(RANGE_CODE.step_per_m, allowed, 1 / (65535 * nearest_m))
        codes = np.empty(range_m.shape, np.int32)
        _code(range_m, step, codes)
        return cls(step, predicted(codes), known)

    @property
    def packed(self) -> bytes:
        """The errors for a script: two to a byte, the first in its lower half, since most are below
        15; for each of 15 and more, which stand as 15, its low byte at the end, then its high
        bytes. Deflate takes at least a bit for a byte: with one to a byte it took a fifth more.
        """
        low, high = self.planes.reshape(2, -1)
        large = (low >= LARGE) | (high > 0)
        halves = np.where(large, np.uint8(LARGE), low)
        halves = np.append(halves, np.zeros(halves.size % 2, np.uint8))
        pairs = halves[::2] | halves[1::2] << 4
        return bytes(np.concatenate([pairs, low[large], high[large]]))

    def range_m(self) -> Map:
        """The decoded ranges, NaN where unknown, as the page's program decodes them."""
        folded = self.planes[0] | (self.planes[1].astype(np.uint16) << 8)
        errors = (folded >> 1) ^ -(folded & 1)
        codes = errors.cumsum(axis=1, dtype=np.uint16).cumsum(axis=0, dtype=np.uint16)
        with np.errstate(divide="ignore"):
            return np.where(self.known, 1 / (codes * self.step_per_m), np.nan).astype(np.float32)


@compiled
def _code(range_m, step, codes):  # type: ignore[no-untyped-def]
    """Fill ``codes`` with those of ranges."""
    height, width = range_m.shape
    for row in range(height):
        for column in range(width):
            meters = range_m[row, column]
            codes[row, column] = np.int32(np.rint(1 / (meters * step))) if meters > 0 else UNKNOWN


def std_codes(range_std_m: Map) -> NDArray[np.uint8]:
    """(ceil(H/4), ceil(W/4)) of standard errors (H, W): 0 unknown, else logarithmic steps of each
    block's median.
    """
    blocks = std_blocks(range_std_m)
    known = np.isfinite(blocks)
    octaves = np.log2(
        np.maximum(np.where(known, blocks, 1), RANGE_CODE.std_floor_m) / RANGE_CODE.std_floor_m
    )
    codes = 1 + np.rint(octaves * RANGE_CODE.std_steps_per_octave)
    return np.where(known, np.clip(codes, 1, 255), 0).astype(np.uint8)


def std_from_codes(codes: NDArray[np.uint8]) -> Map:
    """The standard errors of ``std_codes`` in meters, NaN where unknown."""
    values = RANGE_CODE.std_floor_m * 2 ** (
        (codes.astype(np.float64) - 1) / RANGE_CODE.std_steps_per_octave
    )
    return np.where(codes > 0, values, np.nan).astype(np.float32)


def std_blocks(range_std_m: Map) -> Map:
    """The median of the known values of each block of 4x4 pixels (the lower of two middle ones);
    NaN where there is none.
    """
    step = RANGE_CODE.std_block_px
    height, width = range_std_m.shape
    rows, columns = -(-height // step), -(-width // step)
    padded = np.full((rows * step, columns * step), np.nan, np.float32)
    padded[:height, :width] = np.where(np.isfinite(range_std_m), range_std_m, np.float32(np.nan))
    blocks = padded.reshape(rows, step, columns, step).swapaxes(1, 2).reshape(rows, columns, -1)
    blocks = np.sort(blocks, axis=-1)  # NaN last
    middle = np.maximum((np.isfinite(blocks).sum(axis=-1) - 1) // 2, 0)
    return np.take_along_axis(blocks, middle[..., None], axis=-1)[..., 0]


def deflated(values: NDArray[Any] | bytes, repeats: bool = False) -> bytes:
    """Deflated bytes, with zlib's header. repeats: see ``files.encode.deflated``."""
    if isinstance(values, bytes):
        return compress(values, repeats)
    return compress(np.ascontiguousarray(values).data.cast("B"), repeats)


def text(content: bytes) -> str:
    """Bytes as base85 (``base64.b85decode`` reads it), for a script: its characters need no
    escaping, and it takes a sixteenth less than base64.
    """
    # as base64.b85encode, which takes 80 ms of a frame where this takes 4
    unused = -len(content) % 4
    words = np.frombuffer(content + bytes(unused), ">u4").astype(np.uint32)
    digits = np.empty((len(words), 5), np.uint8)
    for place in range(4, -1, -1):
        words, digits[:, place] = np.divmod(words, np.uint32(85))
    return DIGITS[digits].tobytes()[: digits.size - unused].decode("ascii")
