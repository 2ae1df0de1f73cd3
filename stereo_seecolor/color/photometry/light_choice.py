"""Which terms of the light a dive determines: each is used only where patches left out of the fit agree better with it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_prior import LightPrior
from stereo_seecolor.color.photometry.light_solver import Solution, Use, Window, explained, solve
from stereo_seecolor.robust_statistics import ROBUST_DEVIATION

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChoiceSettings:
    """When a term is worth using."""

    better: float = 0.02
    """Fraction by which it must lower the spread between views of patches left out; chance lowers it by less than 1 %."""
    visible: float = 0.003
    """Least by which it must lower it, natural logarithm: less is not seen, even side by side."""
    offset: float = 0.03
    """Offsets between frames (rms, logarithm) that are worth a gain for each frame, which may then hardly change the spread,"""
    offset_left: float = 0.8
    """if at most this fraction of them is left."""
    least_patches: int = 300
    """Left out and seen by two frames or more: fewer judge nothing."""


SETTINGS = ChoiceSettings()


@dataclass(frozen=True)
class Spread:
    """How views of patches left out differ, natural logarithm.

    between_views: robust standard deviation of the difference of two views.
    between_frames: rms of the medians of pairs of frames, weighted by their sightings.
    """

    between_views: float
    between_frames: float


@dataclass(frozen=True, eq=False)
class Choice:
    """A solution with the terms that help; what was there before and what is left, both on patches left out of a fit.

    judging: number of these patches.
    """

    use: Use
    solution: Solution
    before: Spread
    after: Spread
    judging: int

    @property
    def judged(self) -> bool:
        """Whether these were enough for any term to be used."""
        return self.judging >= SETTINGS.least_patches


def choose(windows: Sequence[Window], values: Sequence[Array], allowed: Use, frames: int, priors: Sequence[LightPrior]) -> Choice:
    """Begin with nothing, and add the term that lowers the spread most, as long as one lowers it enough. values: as ``solve``'s.

    Of several priors that of most evidence is taken; a narrow one only where it leaves no more between views than the best other.
    """
    fit, judge = ([window.part(held) for window in windows] for held in (False, True))
    fitted, judged = ([value[window.held == held] for window, value in zip(windows, values, strict=True)] for held in (False, True))
    judging = sum(len(np.unique(window.patch)) for window in judge)

    def score(use: Use) -> Spread:
        return spread_left(judge, judged, _best(fit, fitted, use, frames, priors))

    use, before = Use(), score(Use())
    now = before
    while judging >= SETTINGS.least_patches:
        steps = [step for step in _next(use) if all(map(_at_most, step, allowed))]
        scored = [(score(step), step) for step in steps]
        worth = [(spread.between_views, step, spread) for spread, step in scored if _worth(spread, now)]
        if not worth:
            break
        _, use, now = min(worth)
    return Choice(use, _best(windows, values, use, frames, priors), before, now, judging)


def _best(windows: Sequence[Window], values: Sequence[Array], use: Use, frames: int, priors: Sequence[LightPrior]) -> Solution:
    if not use.pattern:
        return solve(windows, values, use, frames, priors[0])
    wide, narrow = ([solve(windows, values, use, frames, prior) for prior in priors if prior.narrow == so] for so in (False, True))
    best = min(wide, key=lambda solution: solution.misfit)
    most = spread_left(windows, values, best).between_views
    fitting = [solution for solution in narrow if spread_left(windows, values, solution).between_views <= most]
    return min((best, *fitting), key=lambda solution: solution.misfit)


def spread_left(windows: Sequence[Window], values: Sequence[Array], solution: Solution) -> Spread:
    """Differences between each view of a patch and the one before it, once the solution is taken out."""
    differences, pairs = [], []
    for window, value in zip(windows, values, strict=True):
        left = value - explained(window, solution)
        again = np.flatnonzero(np.diff(window.patch) == 0)
        differences.append(left[again + 1] - left[again])
        pairs.append(np.stack([window.frame[again], window.frame[again + 1]], axis=1))
    difference, pair = np.concatenate(differences), np.concatenate(pairs)
    if not len(difference):
        return Spread(0.0, 0.0)
    kind, index, number = np.unique(pair, axis=0, return_inverse=True, return_counts=True)
    squares = [float((np.median(difference[index.ravel() == k], axis=0) ** 2).mean()) for k in range(len(kind))]
    size = np.sqrt(((difference - np.median(difference, axis=0)) ** 2).mean(axis=1))
    return Spread(ROBUST_DEVIATION * float(np.median(size)), float(np.sqrt(np.average(squares, weights=number))))


def _next(use: Use) -> list[Use]:
    """A term more, in each way that makes sense."""
    steps = []
    if not use.pattern:
        steps.append(use._replace(pattern=True))
    elif not use.ranged:
        steps.append(use._replace(ranged=True))
    if not use.gains:
        steps.append(use._replace(gains=True))
    return steps


def _at_most(used: bool, allowed: bool) -> bool:
    return allowed or not used


def _worth(new: Spread, old: Spread) -> bool:
    lowered = old.between_views - new.between_views
    evener = lowered > max(SETTINGS.better * old.between_views, SETTINGS.visible)
    steadier = old.between_frames > SETTINGS.offset and new.between_frames < SETTINGS.offset_left * old.between_frames
    return evener or (steadier and new.between_views <= old.between_views)
