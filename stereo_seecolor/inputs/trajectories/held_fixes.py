"""Positions of a receiver that repeats each fix until the next one: a fix is measured once, at the
time of its first row, and positions are linear in time between two.
"""

from typing import NamedTuple

import numpy as np

from calibration.errors import counted
from stereo_seecolor.records import NEAR_FIX, Array

LEAST_HELD, HELD = 3, 0.5
"""Rows with one position, and the fraction of such, of a receiver that repeats its last fix."""
MAX_GAP_S = 10.0
"""Acoustic positions come every few seconds; further apart, what lies between is not known."""


class HeldFixes(NamedTuple):
    """positions: (N, K) in any unit, NaN where not known. fixes_s: times of the fixes, None
    where every row is one. notes: what a person should know.
    """

    positions: Array
    fixes_s: Array | None = None
    notes: tuple[str, ...] = ()


def between_fixes(times_s: Array, positions: Array) -> HeldFixes:
    """Positions (N, K) between the fixes at times (N,); as they are if none repeats."""
    known = np.flatnonzero(np.isfinite(times_s) & np.isfinite(positions).all(axis=1))
    if len(known) < 2 or (np.diff(times_s[known]) <= 0).any():
        return HeldFixes(positions)
    same = (np.diff(positions[known], axis=0) == 0).all(axis=1)
    first = np.flatnonzero(np.concatenate([[True], ~same]))
    rows = np.diff(np.append(first, len(known)))
    if len(first) < 2 or not (rows[:-1] >= LEAST_HELD).mean() >= HELD:
        return HeldFixes(positions)
    fixes_s, own_s = times_s[known[first]], times_s[known]
    found = positions.copy()
    for axis in range(positions.shape[1]):
        found[known, axis] = np.interp(own_s, fixes_s, positions[known[first], axis])
    gap_s = np.diff(fixes_s)
    of_gap_s = np.repeat(np.append(gap_s, gap_s[-1]), rows)
    part = (own_s - np.repeat(fixes_s, rows)) / of_gap_s  # of the way to the next fix
    is_last = np.repeat(np.arange(len(first)) == len(first) - 1, rows)
    is_between = (part > NEAR_FIX) & (part < 1 - NEAR_FIX) & (of_gap_s > MAX_GAP_S)
    found[known[np.where(is_last, part > NEAR_FIX, is_between)]] = np.nan
    note = (
        f"the positions repeat for up to {gap_s.max():.1f} s: each is one fix, at its first row, "
        "and after the last one nothing is known"
    )
    if too_long := int((gap_s > MAX_GAP_S).sum()):
        note += f", nor between {counted(too_long, 'pair')} of more than {MAX_GAP_S:g} s"
    return HeldFixes(found, fixes_s, (note,))
