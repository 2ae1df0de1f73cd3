"""Quantiles of the light of each channel at each range, from a moment table, for the robust fit."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import InputEncoding, decode
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_bins import RANGE_BINS
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb

FRACTIONS = np.array([0.003, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999])
"""Fractions of the quantiles: from nearly in shadow to the brightest, most likely white."""
PARTS = 20
"""Groups of the pixels of a frame by range: more hardly change a fit, and take time."""
BINS_PER_OCTAVE = RANGE_BINS // 8
"""Range bins of an octave; there are eight octaves."""
CLIPPED = 0.99
"""Fraction of full scale, encoded, from which on a value is a lower bound of the light."""
NOISE = 0.004
"""Standard deviation of an encoded value, fraction of full scale: 1 of 255, that of a camera with
little noise.
"""
MOST_NOISE = 0.95
"""Largest fraction of the slope of quantiles over those of a normal distribution that is noise."""
_DEVIATIONS = np.array([-2.748, -2.326, -1.645, -0.674, 0.0])
"""Quantiles of the normal distribution at the fractions up to a half."""


@dataclass(frozen=True, eq=False)
class RangeQuantiles:
    """Quantiles of the pixels of each group of neighboring ranges.

    range_m (G,): mean range of each group, meters, near to far. pixels (G,): their number. light
    (3, G, 9): quantiles, linear light, the dark ones corrected for noise. clipped (3, G, 9): True
    where a quantile is at full scale, a lower bound of the light.
    """

    range_m: NDArray[np.float64]
    pixels: NDArray[np.float64]
    light: NDArray[np.float64]
    clipped: NDArray[np.bool_]


def quantiles_by_range(table: MomentTable, encoding: InputEncoding) -> RangeQuantiles:
    """Compute quantiles of groups of range bins with about equal numbers of pixels; the table must
    not be empty.
    """
    first = _first_of_groups(table.pixels)
    size = np.add.reduceat(table.pixels, first).astype(np.float64)
    end = int(np.flatnonzero(table.pixels)[-1]) + 1
    # sums of slices: numpy's reduceat takes twice as long
    bounds = itertools.pairwise([*first.tolist(), end])
    values = _quantiles(np.stack([table.counts[:, a:b].sum(axis=1) for a, b in bounds], axis=1))
    full = 2.0**table.bit_depth - 1
    step, offset = (1.0, 0.0) if table.bit_depth == 8 else (16.0, 7.5)
    encoded = np.clip((values * step + offset) / full, 0, 1)
    mean_range_m = np.add.reduceat(table.pixels * table.range_m, first) / size
    light = (
        decode(_without_noise(encoded), encoding)
        if encoding != "linear"
        else decode_srgb(_without_noise(encode_srgb(encoded)))
    )
    return RangeQuantiles(mean_range_m, size, light, encoded >= CLIPPED)


def _without_noise(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, G, 9) sRGB quantiles, in which the effect of noise below the median is removed.

    Where a normal distribution has the slope s of its quantiles, that without the noise n has
    sqrt(s^2 - n^2) (variances add).
    """
    slope = np.diff(values[..., :5]) / np.diff(_DEVIATIONS)
    noise = np.minimum(NOISE, MOST_NOISE * slope)
    dark = values[..., :4] - _DEVIATIONS[:4] * (slope - np.sqrt(slope**2 - noise**2))
    below = np.minimum.accumulate(
        np.concatenate([dark, values[..., 4:5]], axis=-1)[..., ::-1], axis=-1
    )[..., ::-1]
    return np.concatenate([below[..., :4], values[..., 4:]], axis=-1)


def _first_of_groups(pixels: NDArray[np.int64]) -> NDArray[np.intp]:
    """(G,) the first occupied range bin of each group.

    Groups are cut where the running sum of pixels passes equal parts, and at each octave within a
    group: the few far pixels of a frame have little in common with nearer ones.
    """
    occupied = np.flatnonzero(pixels)
    below = np.cumsum(pixels)
    part = np.floor((below - 0.5 * pixels)[occupied] / below[-1] * PARTS)
    starts = np.diff(part, prepend=-1.0) > 0
    octave = (occupied - np.maximum.accumulate(np.where(starts, occupied, 0))) // BINS_PER_OCTAVE
    return np.asarray(occupied[starts | (np.diff(octave, prepend=0) > 0)])


def _quantiles(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """(3, G, 9) quantiles of counts (3, G, V), in value bins, within which pixels are even."""
    each = counts.reshape(-1, counts.shape[2])
    # over all groups, one after the other: so one search finds all
    below = np.cumsum(each).reshape(each.shape)
    start = below[:, -1:] - each.sum(axis=1, keepdims=True)
    wanted = FRACTIONS * (below[:, -1:] - start)
    at = np.searchsorted(below.ravel(), start + wanted)
    value = at - each.shape[1] * np.arange(len(each))[:, None]
    found = value + 0.5 - (below.ravel()[at] - start - wanted) / each.ravel()[at]
    return np.asarray(found.reshape(*counts.shape[:2], FRACTIONS.size), np.float64)
