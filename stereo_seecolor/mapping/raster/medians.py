"""Medians of many columns of 8-bit values together, for vector instructions: each is found bit by bit."""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled

UNKNOWN = np.uint8(255)
"""Stands for a value that is not known: it is not less than any other."""


@compiled
def twice_medians(values: Any, known: Any, lower: Any, other: Any, counted: Any, twice: Any) -> None:
    """Write twice the median of each column's known values, a whole number.

    values: (n, m) uint8, UNKNOWN where not known. known: (m,) uint16, how many are; where none is, the median has no meaning.
    lower, other: (m,) uint8, and counted: (m,) uint16, room to work in. twice: (m,) int32, written.
    """
    _lower_medians(values, known, lower, other, counted)
    other[:], counted[:] = UNKNOWN, 0
    for row in values:
        for m in range(len(lower)):
            counted[m] += np.uint8(row[m] <= lower[m])
            other[m] = min(other[m], row[m] if row[m] > lower[m] else UNKNOWN)
    for m in range(len(lower)):  # of an even count the upper median is the next larger value, unless the lower one is there twice
        twice[m] = np.int32(lower[m]) + np.int32(lower[m] if 2 * counted[m] > known[m] else other[m])


@compiled
def _lower_medians(values: Any, known: Any, lower: Any, tried: Any, below: Any) -> None:
    """Write the largest number below which fewer than half of the values lie: of an even count, the smaller of the middle two."""
    lower[:] = 0
    for bit in (128, 64, 32, 16, 8, 4, 2, 1):
        for m in range(len(lower)):
            tried[m], below[m] = lower[m] | np.uint8(bit), 0
        for row in values:
            for m in range(len(lower)):
                below[m] += np.uint8(row[m] < tried[m])
        for m in range(len(lower)):
            lower[m] = tried[m] if 2 * below[m] < known[m] else lower[m]
