"""The constant difference of two never synchronized cameras' clocks, from time stamps."""

from collections.abc import Sequence

import numpy as np

from stereo_seecolor.records import Array

LEAST_PAIRS, FITTING = 3, 0.8
"""Fewer fit some difference by chance; and fraction of the images of the side that has fewer."""
MORE_TRIED, MOST_TRIED = 3, 100
"""So many images may be missing at the start of either side, beside those that the other side has
more; and at most.
"""
NEAR = 5.0
"""Tolerances from a first difference, which one pair gives with its own error, within which others
improve it.
"""
DRIFT_PAIRS = 4
"""Pairs needed to speak of drift between the medians of the first and last quarter."""

DRIFT_S = 1e-3
"""Movement of one clock against the other worth a note, seconds; less is rounding of ms."""


def clock_offset_s(
    left_s: Sequence[float], right_s: Sequence[float], tolerance_s: float
) -> float | None:
    """Estimate how far the right clock is ahead of the left one, from all time stamps of both
    sides, sorted; None if no difference fits.

    The difference at which the most stamps have a partner within the tolerance. Of a steady rhythm
    several differences fit; that which leaves the fewest images without a partner is taken, and the
    images must confirm it.
    """
    left, right = np.asarray(left_s), np.asarray(right_s)
    fewer = min(left.size, right.size)
    if fewer < LEAST_PAIRS:
        return None
    tried = min(abs(left.size - right.size) + MORE_TRIED, MOST_TRIED)
    by_one_pair = (*(right[:tried] - left[0]), *(right[0] - left[1:tried]))
    shifts = [_improved(left, right, shift, NEAR * tolerance_s) for shift in by_one_pair]
    counts = [
        np.count_nonzero(np.abs(_to_nearest(left + shift, right)) <= tolerance_s)
        for shift in shifts
    ]
    best = int(np.argmax(counts))
    return None if counts[best] < max(LEAST_PAIRS, FITTING * fewer) else shifts[best]


def _improved(left: Array, right: Array, shift_s: float, near_s: float) -> float:
    off_s = _to_nearest(left + shift_s, right)
    return float(shift_s + np.median(off_s[np.abs(off_s) <= near_s]))


def _to_nearest(times_s: Array, others_s: Array) -> Array:
    """(n,) from each time to the nearest of the others, sorted; positive where that is later."""
    after = np.clip(np.searchsorted(others_s, times_s), 1, others_s.size - 1)
    before = others_s[after - 1] - times_s
    behind = others_s[after] - times_s
    return np.where(np.abs(before) < np.abs(behind), before, behind)


def drift_notes(offsets_s: Sequence[float]) -> tuple[str, ...]:
    """Say so if two cameras' clocks move against each other: few pairs are still near enough then.

    offsets_s: what the right clock is ahead, of each pair in the order of the dive.
    """
    if len(offsets_s) < DRIFT_PAIRS:
        return ()
    quarter = len(offsets_s) // 4
    first = sorted(offsets_s[:quarter])[quarter // 2]
    last = sorted(offsets_s[-quarter:])[quarter // 2]
    if abs(last - first) < DRIFT_S:
        return ()
    return (
        f"the right clock drifted by {1000 * (last - first):+.1f} ms relative to the left one "
        "from first to last pair",
    )
