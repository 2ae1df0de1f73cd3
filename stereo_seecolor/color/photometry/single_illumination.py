"""Tests whether parts of a dive that share no spot have the same light.

Between frames that show the same spots, gains and shading follow changes of light. Lines without
common spots are connected only by the pattern: if lamps were switched on between them, the pattern
and fall-off of the lamps of one line would be removed from the other, too.
"""

from collections.abc import Sequence

import numpy as np

from stereo_seecolor.color.photometry.light_choice import Candidate
from stereo_seecolor.color.photometry.light_solver import Equations, Window, solve

EVIDENCE = 10.0
"""For each additional light, twice the natural logarithm: very strong (Kass and Raftery 1995).
Lamps switched on between two lines: 69 to 116 on five synthetic dives; one light throughout: at
most 4 on 21, at most 5 on 12 ways to divide a real dive.
"""


def is_single_illumination(
    windows: Sequence[Window], candidates: Sequence[Candidate], frames: int
) -> bool:
    """Whether one light explains all windows as well as one for each part that shares no spot.

    candidates: tested for all together, and for each part. frames: number of frames.
    """
    parts = _parts(windows, frames)
    if len(parts) == 1:
        return True

    def misfit(part: Sequence[Window]) -> float:
        equations = Equations.of(part, frames)
        return min(solve(equations, *candidate).misfit for candidate in candidates)

    return misfit(windows) - sum(map(misfit, parts)) < EVIDENCE * (len(parts) - 1)


def _parts(windows: Sequence[Window], frames: int) -> list[list[Window]]:
    """The windows of each part of the dive that no spot links to another."""
    part = np.arange(frames)
    for window in windows:
        linked = np.isin(part, part[np.unique(window.frame)])
        part[linked] = part[linked].min()
    parts: dict[int, list[Window]] = {}
    for window in windows:
        parts.setdefault(int(part[window.frame[0]]), []).append(window)
    return [parts[one] for one in sorted(parts)]
