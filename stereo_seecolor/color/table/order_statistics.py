"""What the robust fit sees of a moment table: how dark and how bright each channel is at each range, as quantiles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import InputEncoding, decode
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.compiled import compiled

SHARES = np.array([0.003, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999])
"""Quantiles, from what is nearly in shadow to the brightest things, which are the likeliest to be white."""

MOST_GROUPS = 20
CLIPPED = 0.99
"""From this share of full scale on, an encoded value does not say how bright it was."""


@dataclass(frozen=True, eq=False)
class OrderStatistics:
    """What is seen at each range.

    range_m (G,): mean range of each group of pixels, meters, near to far. pixels (G,): how many. light (3, G, 9): quantiles, linear
    light. clipped (3, G, 9): True where a quantile is at full scale, and the light may have been anything above.
    """

    range_m: NDArray[np.float64]
    pixels: NDArray[np.float64]
    light: NDArray[np.float64]
    clipped: NDArray[np.bool_]


def summarize(table: MomentTable, encoding: InputEncoding) -> OrderStatistics:
    """Groups of neighboring levels of about equal numbers of pixels, and each group's quantiles; the table must not be empty."""
    pixels, range_m = table.pixels, table.range_m
    group = _groups(pixels)
    number = int(group.max()) + 1
    occupied = group >= 0
    size = np.bincount(group[occupied], weights=pixels[occupied], minlength=number)
    mean_range_m = np.bincount(group[occupied], weights=(pixels * range_m)[occupied], minlength=number) / size
    values = _quantiles(table.counts, group, number, SHARES)
    full = 2.0**table.bit_depth - 1
    step, first = (1.0, 0.0) if table.bit_depth == 8 else (16.0, 7.5)
    encoded = np.clip((values * step + first) / full, 0, 1)
    return OrderStatistics(mean_range_m, size.astype(np.float64), decode(encoded, encoding), encoded >= CLIPPED)


def _groups(pixels: NDArray[np.int64]) -> NDArray[np.int64]:
    """(256,) the group of each level, -1 where it is empty: cut where the running sum passes equal parts."""
    middle = (np.cumsum(pixels) - 0.5 * pixels) / pixels.sum()
    part = np.floor(middle * MOST_GROUPS).astype(np.int64)
    occupied = pixels > 0
    group = np.full(pixels.size, -1, dtype=np.int64)
    group[occupied] = np.unique(part[occupied], return_inverse=True)[1]
    return group


@compiled
def _quantiles(counts, group, number, shares):  # type: ignore[no-untyped-def]  # pragma: no cover
    channels, levels, bins = counts.shape
    out = np.zeros((channels, number, shares.size))
    merged = np.zeros(bins, np.int64)
    for c in range(channels):
        level = 0
        for g in range(number):
            merged[:] = 0
            while level < levels and group[level] <= g:
                if group[level] == g:
                    merged += counts[c, level]
                level += 1
            total = merged.sum()
            below, value = 0, 0
            for k in range(shares.size):
                wanted = shares[k] * total
                while below + merged[value] < wanted:
                    below += merged[value]
                    value += 1
                out[c, g, k] = value - 0.5 + (wanted - below) / merged[value]  # spread evenly inside a bin
    return out
