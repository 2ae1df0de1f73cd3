"""Chooses the terms of the light with which views of patches left out of the fit agree better."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_prior import Alike, LightPrior
from stereo_seecolor.color.photometry.light_solver import (
    LightTerms,
    Solution,
    Window,
    explained,
    pattern_error,
    solve,
)
from stereo_seecolor.color.photometry.observations import SeenWindow
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChoiceSettings:
    """When a term is worth using."""

    better: float = 0.02
    """Fraction by which it must lower the spread on patches left out; chance: less than 1 %."""
    visible: float = 0.003
    """Least by which it must lower it, natural logarithm: less is not seen, even side by side."""
    offset: float = 0.03
    """Offsets between frames (rms, logarithm) that are worth a gain for each frame,"""
    offset_left: float = 0.8
    """if at most this fraction of them is left."""
    sure: float = 2.0
    """Standard errors of a pair's offset, by its patches' scatter, beyond which frames differ."""
    robust_error: float = 1.17
    """Relative standard error of a robust deviation of Gaussian values, times root N."""
    least_patches: int = 300
    """Left out and seen by two frames or more: fewer judge nothing."""


LIGHT_CHOICE_SETTINGS = ChoiceSettings()


@dataclass(frozen=True)
class ViewDifferences:
    """Differences between views of patches left out of the fit, natural logarithm.

    between_views: robust standard deviation of the difference of two views.
    between_frames: rms of the medians of pairs of frames, weighted by their observations.
    by_chance: standard error of such a median, if each difference were a measurement of its own.
    """

    between_views: float
    between_frames: float
    by_chance: float


@dataclass(frozen=True, eq=False)
class Choice:
    """The solution with the terms that help. before, after: spread without and with them, on
    patches left out; judging: their number. error: ``pattern_error``; 0 without a pattern.
    """

    use: LightTerms
    solution: Solution
    before: ViewDifferences
    after: ViewDifferences
    judging: int
    error: float

    @property
    def judged(self) -> bool:
        """Whether these patches were enough to use any term."""
        return self.judging >= LIGHT_CHOICE_SETTINGS.least_patches


class Candidate(NamedTuple):
    """A set of terms, and the prior of their coefficients."""

    use: LightTerms
    prior: LightPrior


def choose(
    windows: Sequence[Window], values: Sequence[Array], candidates: Sequence[Candidate], frames: int
) -> Choice:
    """Choose the candidate with most evidence among those that lower the spread on patches left out
    enough.

    These are the candidates that are worth using (ChoiceSettings) and within one standard error of
    the least spread (Breiman et al. 1984, "Classification and regression trees"). Shading, and
    gains of frames that differ no more than caustics explain, also need more evidence than the same
    terms without them: patches left out lie under the same caustics as their neighbors in the fit.
    values: as in ``solve``. candidates: the first is no correction. frames: number of frames.
    """
    fit, judge = ([window.part(held) for window in windows] for held in (False, True))
    fitted, judged = (
        [value[window.held == held] for window, value in zip(windows, values, strict=True)]
        for held in (False, True)
    )
    judging = sum(len(np.unique(window.patch)) for window in judge)

    def left(candidate: Candidate) -> ViewDifferences:
        return spread_left(
            judge, judged, solve(fit, fitted, candidate.use, frames, candidate.prior)
        )

    @cache
    def whole(candidate: Candidate) -> Solution:
        return solve(windows, values, candidate.use, frames, candidate.prior)

    def evident(candidate: Candidate) -> bool:
        use = candidate.use
        if not use.gains or (frames_differ and not use.shading):
            return True
        without = use._replace(shading=False) if use.shading else use._replace(gains=False)
        return whole(candidate).misfit < whole(candidate._replace(use=without)).misfit

    nothing, *others = candidates
    before = left(nothing)
    frames_differ = before.between_frames > LIGHT_CHOICE_SETTINGS.sure * before.by_chance * np.sqrt(
        nothing.prior.alike.views
    )
    chance = 1 + LIGHT_CHOICE_SETTINGS.robust_error * float(
        np.sqrt(nothing.prior.alike.views / max(judging, 1))
    )
    enough = judging >= LIGHT_CHOICE_SETTINGS.least_patches
    tried = [(candidate, left(candidate)) for candidate in others if enough]
    worth = [one for one in tried if _worth(one[1], before, chance) and evident(one[0])]
    most = chance * min((spread.between_views for _, spread in worth), default=0.0)
    good = [(candidate, spread) for candidate, spread in worth if spread.between_views <= most] or [
        (nothing, before)
    ]
    solved = [(whole(one), one.use, spread) for one, spread in good]
    solution, use, after = min(solved, key=lambda found: found[0].misfit)
    error = pattern_error(solution, [other for other, *_ in solved]) if use.pattern else 0.0
    return Choice(use, solution, before, after, judging, error)


def spread_left(
    windows: Sequence[Window], values: Sequence[Array], solution: Solution
) -> ViewDifferences:
    """Spread of differences of each view of a patch from the one before, solution removed."""
    frames = 1 + max(int(window.frame.max(initial=0)) for window in windows)
    differences, pairs = [], []
    for window, value in zip(windows, values, strict=True):
        left = value - explained(window, solution)
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
    evener = lowered > max(
        LIGHT_CHOICE_SETTINGS.better * old.between_views, LIGHT_CHOICE_SETTINGS.visible
    )
    steadier = (
        old.between_frames > LIGHT_CHOICE_SETTINGS.offset
        and new.between_frames < LIGHT_CHOICE_SETTINGS.offset_left * old.between_frames
    )
    return evener or (steadier and new.between_views <= chance * old.between_views)


# Whether parts of a dive that share no spot were under one light, or under lights of their own.
#
# Between frames that show the same spots, gains and shading follow what changes. Lines that share
# none are tied by the pattern alone: where lamps were switched on between them, the pattern and
# the fall-off of one line's lamps would be taken out of the other, too.


@dataclass(frozen=True)
class OneLightSettings:
    """When one light is refused."""

    evidence: float = 10.0
    """For each light more, twice the natural logarithm: very strong (Kass and Raftery 1995). Lamps
    switched on between two lines:
    69 to 116 on five drawn dives; one light throughout: at most 4 on 21, at most 5 on 12 ways to
    part a real dive.
    """


ONE_LIGHT_SETTINGS = OneLightSettings()


def is_single_illumination(
    windows: Sequence[Window], values: Sequence[Array], candidates: Sequence[Candidate], frames: int
) -> bool:
    """Whether one light explains all windows about as well as one for each part that shares no
    spot.

    values, frames: as ``solve``'s. candidates: tried for all together, and for each part.
    """
    parts = _parts(windows, frames)
    if len(parts) == 1:
        return True

    def misfit(part: Sequence[int]) -> float:
        held, seen = [windows[number] for number in part], [values[number] for number in part]
        return min(
            solve(held, seen, candidate.use, frames, candidate.prior).misfit
            for candidate in candidates
        )

    together = misfit(range(len(windows)))
    return together - sum(misfit(part) for part in parts) < ONE_LIGHT_SETTINGS.evidence * (
        len(parts) - 1
    )


def _parts(windows: Sequence[Window], frames: int) -> list[list[int]]:
    """The windows, by number, of each part of the dive that no spot links to another."""
    part = np.arange(frames)
    for window in windows:
        linked = np.isin(part, part[np.unique(window.frame)])
        part[linked] = part[linked].min()
    of_windows = np.array([part[window.frame[0]] for window in windows])
    return [np.flatnonzero(of_windows == one).tolist() for one in np.unique(of_windows)]


# How far the reef moves through the image in a dive. If it moves little, a spot's own shading
# cannot be told from the lamps'.


@dataclass(frozen=True)
class CrossingSettings:
    """In sizes of the picture. Cross-validated on a real dive of 20 frames: patterns of parts of 2
    to 10 frames, applied to the frames outside.
    """

    correlated: float = 10.0
    """Observations that count as one: neighbors share a caustic and errors of range and pose."""
    whole: float = 1.5
    """Motion below which more observations count as one, in inverse proportion. Three neighboring
    frames cross 0.3: their pattern of luminance left 0.84 to 1.22 of the spread of other frames
    with 10 alike, with 50 it leaves 0.84 to 0.94.
    """
    color: float = 1.0
    """Least for a pattern of color: with less, other frames got worse (1.5 times at 0.3)."""


CROSSING_SETTINGS = CrossingSettings()


def pictures_crossed(windows: Sequence[SeenWindow], size: tuple[int, int]) -> float:
    """The reef's motion from each window's first frame to the nearest other, in image
    sizes.

    size: (width, height) of the images that the observations' pixels are of.
    """
    return float(sum(_shift(window, size) for window in windows))


def alike(crossed: float, windows: int) -> Alike:
    """How many observations tell the same. crossed: of ``pictures_crossed``. windows: number."""
    views = CROSSING_SETTINGS.correlated * max(
        1.0, CROSSING_SETTINGS.whole / max(crossed, 0.1 * CROSSING_SETTINGS.whole)
    )
    return Alike(views, max(windows / (1.0 + crossed), 1.0))


def _shift(window: SeenWindow, size: tuple[int, int]) -> float:
    """Median motion of a window's patches, in image sizes."""
    nearest, seen = 1 + int(np.argmin(np.abs(window.frames[1:] - window.frames[0]))), window.seen
    first, there = (np.flatnonzero(seen.frame == number) for number in (0, nearest))
    common, a, b = np.intersect1d(
        seen.patch[first], seen.patch[there], assume_unique=True, return_indices=True
    )
    if not common.size:
        return 0.0
    moved = (seen.pixel[first[a]] - seen.pixel[there[b]]) / np.array(size)
    return float(np.linalg.norm(np.median(moved, axis=0)))
