"""Ranges and their standard errors as whole numbers, for the page."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Map


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


def range_codes(range_m: Map, std_m: Map) -> tuple[NDArray[np.int32], float]:
    """Codes of ranges (H, W), NaN where unknown, with standard errors (H, W); and their step, per
    meter: a range is 1 / (code * step), a code of 0 is unknown. The step is coarser if the standard
    errors allow it, or the nearest range requires it.
    """
    nearest_m = float(np.min(range_m, where=range_m > 0, initial=np.inf))
    some = np.s_[:: RANGE_CODE.std_block_px, :: RANGE_CODE.std_block_px]
    inverse_std = std_m[some] / range_m[some] ** 2
    usual = inverse_std[np.isfinite(inverse_std)]
    allowed = RANGE_CODE.of_std * float(np.median(usual)) if usual.size else 0.0
    step = max(RANGE_CODE.step_per_m, allowed, 1 / (65535 * nearest_m))
    codes = np.zeros(range_m.shape)
    np.divide(1 / step, range_m, out=codes, where=range_m > 0)
    return np.rint(codes).astype(np.int32), step


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
    """The (lower) median of the known values of each block of 4x4 pixels; NaN without any."""
    step = RANGE_CODE.std_block_px
    height, width = range_std_m.shape
    rows, columns = -(-height // step), -(-width // step)
    padded = np.full((rows * step, columns * step), np.nan, np.float32)
    padded[:height, :width] = np.where(np.isfinite(range_std_m), range_std_m, np.float32(np.nan))
    blocks = padded.reshape(rows, step, columns, step).swapaxes(1, 2).reshape(rows, columns, -1)
    blocks = np.sort(blocks, axis=-1)  # NaN last
    known = np.isfinite(blocks).astype(np.float32) @ np.ones(step**2, np.float32)
    middle = np.maximum((known.astype(np.int64) - 1) // 2, 0)
    return np.take_along_axis(blocks, middle[..., None], axis=-1)[..., 0]
