"""Single pairs of a dive that are not of its rig, by the numbers of all pairs."""

from collections.abc import Mapping, Sequence

import numpy as np

from calibration import Rectification
from calibration.robust_statistics import ROBUST_DEVIATION
from calibration.verification.changes import changes_of
from stereo_seecolor.checks.change_texts import odd_line
from stereo_seecolor.checks.changes import DiveChange, look_at_all
from stereo_seecolor.checks.sample import consecutive_intervals, evenly_spaced
from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.pairing import Pair

AROUND = 5
"""Pairs on either side with which a measured pair is compared."""
LEAST_OFF = {"coverage": 0.02, "median_range_m": 0.03, "vertical_px": 0.2}
"""Deviations that are usual in any dive: fraction, logarithm, pixels."""
STANDS_OUT = 4.0
"""Of these, or of the usual deviations of a dive, from which on a pair has a look."""
MOST_SUSPECTS = 8
"""Pairs that have one: each takes an eighth of a full check."""


def odd_among(
    rectification: Rectification,
    pairs: Sequence[Pair],
    images: InputConfig,
    facts: Sequence[Mapping[str, float]],
) -> DiveChange:
    """Look at the pairs of a dive that was measured whose numbers stand out, and at some that do
    not. facts: of each pair (``dive.frames.range_facts``).

    Single odd pairs of a long dive are not among those that ``find_change`` compares.
    """
    suspects = _standing_out(facts)
    if not suspects:
        return DiveChange()
    usual = [place for place in range(len(pairs)) if place not in suspects]
    compared = sorted({*suspects, *evenly_spaced(usual, 2 * len(suspects) + 2)})
    changes = changes_of(look_at_all(rectification, [pairs[i] for i in compared], images))
    odd = [compared[number] for number in changes.odd if compared[number] in suspects]
    lines = [
        odd_line(pairs[first].name, pairs[last].name) for first, last in consecutive_intervals(odd)
    ]
    return DiveChange("; ".join(lines), frozenset(pairs[place].name for place in odd))


def _standing_out(facts: Sequence[Mapping[str, float]]) -> list[int]:
    """Places of the pairs, MOST_SUSPECTS at most, that differ the most from their neighbors."""
    far = np.zeros(len(facts))
    for name in ("coverage", "median_range_m", "vertical_px"):
        unknown = 0.0 if name == "vertical_px" else np.nan
        values = np.array([one.get(name, unknown) for one in facts])
        values = np.log(values) if name == "median_range_m" else values
        around = np.array(
            [np.nanmedian(values[max(0, i - AROUND) : i + AROUND + 1]) for i in range(len(values))]
            if np.isfinite(values).any()
            else values
        )
        off = np.abs(values - around)
        usual = ROBUST_DEVIATION * float(np.nanmedian(off)) if np.isfinite(off).any() else 0.0
        far = np.fmax(far, off / max(usual, LEAST_OFF[name]))
    most = np.argsort(far)[::-1][:MOST_SUSPECTS]
    return sorted(int(place) for place in most if far[place] > STANDS_OUT)
