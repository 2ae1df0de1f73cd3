"""Tests whether parts of a dive that share no spot have the same light.

Between frames that show the same spots, gains and shading follow changes of light. Lines without
common spots are connected only by the pattern: if lamps were switched on between them, the pattern
and fall-off of the lamps of one line would be removed from the other, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_choice import Candidate
from stereo_seecolor.color.photometry.light_solver import Equations, Window, solve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OneLightSettings:
    """Condition for separate lights."""

    evidence: float = 10.0
    """For each additional light, twice the natural logarithm: very strong (Kass and Raftery 1995).
    Lamps switched on between two lines: 69 to 116 on five synthetic dives; one light throughout: at
    most 4 on 21, at most 5 on 12 ways to divide a real dive.
    """


SETTINGS = OneLightSettings()


def is_single_illumination(
    windows: Sequence[Window], values: Sequence[Array], candidates: Sequence[Candidate], frames: int
) -> bool:
    """Whether one light explains all windows about as well as one for each part that shares no
    spot.

    values, frames: as in ``Equations``. candidates: tested for all together, and for each part.
    """
    parts = _parts(windows, frames)
    if len(parts) == 1:
        return True

    def misfit(part: Sequence[int]) -> float:
        held, seen = [windows[number] for number in part], [values[number] for number in part]
        equations = Equations.of(held, seen, frames)
        return min(solve(equations, *candidate).misfit for candidate in candidates)

    together = misfit(range(len(windows)))
    return together - sum(misfit(part) for part in parts) < SETTINGS.evidence * (len(parts) - 1)


def _parts(windows: Sequence[Window], frames: int) -> list[list[int]]:
    """The windows, by number, of each part of the dive that no spot links to another."""
    part = np.arange(frames)
    for window in windows:
        linked = np.isin(part, part[np.unique(window.frame)])
        part[linked] = part[linked].min()
    of_windows = np.array([part[window.frame[0]] for window in windows])
    return [np.flatnonzero(of_windows == one).tolist() for one in np.unique(of_windows)]
