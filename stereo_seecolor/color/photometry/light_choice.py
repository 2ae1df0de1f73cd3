"""Chooses the terms of light that improve the agreement of views of left-out patches."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.robust_statistics import deviation_about_zero
from stereo_seecolor.color.photometry.light_prior import LightPrior
from stereo_seecolor.color.photometry.light_solver import (
    Equations,
    LightTerms,
    Solution,
    Window,
    explained,
    pattern_error,
    solve,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChoiceSettings:
    """Conditions for a term."""

    better: float = 0.02
    """Fraction by which it must lower the spread on patches left out; by chance less than 1 %."""
    visible: float = 0.003
    """Least reduction of the spread, natural logarithm: less is not visible, even side by side."""
    offset: float = 0.03
    """Least offsets between frames (rms, logarithm) for which each frame gets a gain,"""
    offset_left: float = 0.8
    """if at most this fraction of them remains."""
    sure: float = 2.0
    """Frames differ if their offset exceeds this number of standard errors."""
    robust_error: float = 1.17
    """Relative standard error of a robust deviation of Gaussian values, times root N."""
    least_patches: int = 300
    """Least patches left out that two frames or more show, for a comparison."""


SETTINGS = ChoiceSettings()


@dataclass(frozen=True)
class ViewDifferences:
    """Differences between views of patches left out of the fit, natural logarithm.

    between_views: robust standard deviation. between_frames: rms of the medians of pairs of frames,
    weighted by their observations. by_chance: standard error of such a median, if all differences
    were independent.
    """

    between_views: float
    between_frames: float
    by_chance: float


@dataclass(frozen=True, eq=False)
class Choice:
    """solution: with the terms that help. before, after: spread without and with them, on patches
    left out; judging: their number. error: ``pattern_error``; 0 without a pattern.
    """

    use: LightTerms
    solution: Solution
    before: ViewDifferences
    after: ViewDifferences
    judging: int
    error: float

    @property
    def judged(self) -> bool:
        """Whether there are enough patches for a comparison."""
        return self.judging >= SETTINGS.least_patches

    def without_pattern(self, windows: Sequence[Window]) -> "Choice":
        """The choice without its pattern, with the gains that were solved beside it."""
        solution = replace(self.solution, coefficients=np.zeros_like(self.solution.coefficients))
        use = self.use._replace(pattern=False, ranged=False)
        after = spread_left([window.part(held=True) for window in windows], solution)
        return replace(self, use=use, solution=solution, after=after, error=0.0)


class Candidate(NamedTuple):
    """A set of terms, and the prior of their coefficients."""

    use: LightTerms
    prior: LightPrior


def choose(windows: Sequence[Window], candidates: Sequence[Candidate], frames: int) -> Choice:
    """Choose the candidate with the most evidence among those that lower the spread on patches left
    out enough, and are within one standard error of the least spread (Breiman et al. 1984,
    "Classification and regression trees").

    Shading, and gains of frames whose differences caustics explain, also need more evidence than
    the same terms without them: patches left out lie under the same caustics as those of the fit.
    candidates: the first has no terms. frames: number of frames.
    """
    judge = [window.part(held=True) for window in windows]
    judging = sum(len(np.unique(window.patch)) for window in judge)

    @cache
    def every() -> Equations:
        return Equations.of(windows, frames)

    @cache
    def whole(candidate: Candidate) -> Solution:
        return solve(every(), *candidate)

    def evident(candidate: Candidate) -> bool:
        use = candidate.use
        if not use.gains or (frames_differ and not use.shading):
            return True
        without = use._replace(shading=False) if use.shading else use._replace(gains=False)
        return whole(candidate).misfit < whole(candidate._replace(use=without)).misfit

    enough = judging >= SETTINGS.least_patches
    nothing, *others = candidates if enough else candidates[:1]
    fit = Equations.of([window.part(held=False) for window in windows], frames)
    before, *spreads = [
        spread_left(judge, solve(fit, *candidate)) for candidate in (nothing, *others)
    ]
    del fit  # those of all observations take twice the memory
    frames_differ = before.between_frames > SETTINGS.sure * before.by_chance * np.sqrt(
        nothing.prior.alike.views
    )
    chance = 1 + SETTINGS.robust_error * float(np.sqrt(nothing.prior.alike.views / max(judging, 1)))
    tried = zip(others, spreads, strict=True)
    worth = [one for one in tried if _worth(one[1], before, chance) and evident(one[0])]
    most = chance * min((spread.between_views for _, spread in worth), default=0.0)
    good = [(candidate, spread) for candidate, spread in worth if spread.between_views <= most] or [
        (nothing, before)
    ]
    solved = [(whole(one), one.use, spread) for one, spread in good]
    solution, use, after = min(solved, key=lambda found: found[0].misfit)
    error = pattern_error(solution, [other for other, *_ in solved]) if use.pattern else 0.0
    return Choice(use, solution, before, after, judging, error)


def spread_left(windows: Sequence[Window], solution: Solution) -> ViewDifferences:
    """The spread of differences between consecutive views of a patch, the solution removed."""
    frames = 1 + max(int(window.frame.max(initial=0)) for window in windows)
    differences, pairs = [], []
    for window in windows:
        left = window.values - explained(window, solution)
        again = np.flatnonzero(np.diff(window.patch) == 0)
        differences.append(left[again + 1] - left[again])
        pairs.append(window.frame[again] * frames + window.frame[again + 1])
    difference, pair = np.concatenate(differences), np.concatenate(pairs)
    if not len(difference):
        return ViewDifferences(0.0, 0.0, 0.0)
    number = np.unique(pair, return_counts=True)[1]
    of_pairs = np.split(difference[np.argsort(pair, kind="stable")], np.cumsum(number)[:-1])
    squares = [float((np.median(several, axis=0) ** 2).mean()) for several in of_pairs]
    size = np.sqrt(((difference - np.median(difference, axis=0)) ** 2).mean(axis=1))
    between_views = deviation_about_zero(size)
    between_frames = float(np.sqrt(np.average(squares, weights=number)))
    return ViewDifferences(
        between_views, between_frames, between_views * float(np.sqrt(len(number) / len(difference)))
    )


def _worth(new: ViewDifferences, old: ViewDifferences, chance: float) -> bool:
    """chance: factor by which the spread between views may grow without being worse."""
    lowered = old.between_views - new.between_views
    evener = lowered > max(SETTINGS.better * old.between_views, SETTINGS.visible)
    steadier = (
        old.between_frames > SETTINGS.offset
        and new.between_frames < SETTINGS.offset_left * old.between_frames
    )
    return evener or (steadier and new.between_views <= chance * old.between_views)
