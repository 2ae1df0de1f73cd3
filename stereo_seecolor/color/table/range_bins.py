"""The bins of a moment table: by range, 32 per octave, and by value.

A range bin is the leading bits of the float32 number: from 1/8 m to 32 m, 1.6 to 3.1 % wide, the
same for every frame of every run, so that tables can be added.
"""

import numpy as np
from numpy.typing import NDArray

RANGE_BINS = 256
VALUE_BINS = {8: 256, 16: 4096}
"""Value bins by bit depth; 16 bits are counted with 12, the precision of a sensor."""

NEAREST_M = 0.125
"""Near edge of the first bin; the last ends at 32 m. Other ranges count in these two."""

LOW_BITS = 18
"""A range bin is a float32 range's bits above those of NEAREST_M, shifted by this many."""


def range_bits(range_m: NDArray[np.floating]) -> NDArray[np.int32]:
    """Return the bits of the ranges of a map as float32, row after row, (H*W,) int32."""
    return np.ascontiguousarray(range_m, dtype=np.float32).reshape(-1).view(np.int32)


def range_edges_m() -> NDArray[np.float64]:
    """Return the (257,) edges of the range bins, meters."""
    first = np.float32(NEAREST_M).view(np.int32)
    bits = first + (np.arange(RANGE_BINS + 1, dtype=np.int32) << LOW_BITS)
    return bits.astype(np.int32).view(np.float32).astype(np.float64)


def bin_values(bit_depth: int) -> NDArray[np.float64]:
    """The fraction of full scale of each value bin (V,): v/255, or of 16 values of 65535."""
    if bit_depth == 8:
        return np.arange(256) / 255.0
    return np.asarray((np.arange(4096) * 16 + 7.5) / 65535.0)
