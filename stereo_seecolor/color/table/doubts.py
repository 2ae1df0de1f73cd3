"""Warnings for moment tables that do not determine the water."""

import numpy as np

from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.water.limits import SHARE

LEAST_RELIEF = 1.15
"""Ratio of far to near (95 to 5 %) below which attenuation and scene cannot be distinguished."""

LEAST_PIXELS = 100


def doubts(table: MomentTable, shared: bool) -> tuple[str, ...]:
    """Return warnings why a table (not empty) does not determine its water. shared: it is that
    of all frames of the dive.
    """
    number = int(table.pixels.sum())
    if number < LEAST_PIXELS:
        return (f"only {number} pixels with a known range: the water is a guess",)
    if (table.counts[:, :, 0].sum(axis=1) == number).all():
        return ("the frame is black where the range is known: the water is a guess",)
    if table.counts[:, :, -1].sum() > 0.5 * 3 * number:
        return ("the frame is overexposed where the range is known: the water is a guess",)
    near, far = relief_m(table)
    if far < LEAST_RELIEF * near:
        return (
            f"no relief (ranges {near:.2f} to {far:.2f} m): they do not determine the water"
            f"{'' if shared else SHARE}",
        )
    return ()


def relief_m(table: MomentTable) -> tuple[float, float]:
    """Return the 5th and 95th percentile of the ranges, meters."""
    fraction = np.cumsum(table.pixels) / max(int(table.pixels.sum()), 1)
    near, far = (table.range_m[int(np.searchsorted(fraction, at))] for at in (0.05, 0.95))
    return float(near), float(far)
