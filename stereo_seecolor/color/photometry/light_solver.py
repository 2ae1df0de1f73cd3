"""The light of a survey from patches that several frames show: robust least squares on sums of
windows of neighboring frames.

    log light of observation k = scene(patch_k) + terms_k coefficients + trend(range_k) +
        log_gain(frame_k)

The brightness of a patch is eliminated within its window, so that each window adds normal
equations. The trend with range contains the water and the fall-off of lamps, and stays in the
images. Luminance (the mean logarithm of R, G, B) and color (the rest) are solved separately,
because moving shadows and caustics hardly change color.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.robust_statistics import deviation_about_zero
from stereo_seecolor.color.photometry.light_model import (
    MEAN_SQUARES,
    PATTERN,
    SHADING,
    TERMS,
    Light,
    pattern_terms,
)
from stereo_seecolor.color.photometry.light_prior import Gaussian, LightPrior
from stereo_seecolor.color.photometry.observations import Observations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SolverSettings:
    """Rounds and weights of the robust least squares."""

    rounds: int = 5
    """Rounds with new weights; more make no visible difference."""
    outlier: float = 1.5
    """Robust standard deviations at which an observation has half its weight (Cauchy): fish."""
    first_prior: float = 1e-3
    """Precision of all unknowns in the first round, so that the system is solvable."""
    least_scale: float = 1e-4
    """Least robust deviation of residuals, logarithm, for observations without noise."""


SETTINGS = SolverSettings()
COLUMNS, OWN = TERMS + 1, 1 + SHADING
"""Unknowns that all frames share, terms and trend, and those of each frame, gain and shading."""


class LightTerms(NamedTuple):
    """Terms in use. ranged: the pattern changes with range. shading: each frame's own pattern."""

    pattern: bool = False
    ranged: bool = False
    gains: bool = False
    shading: bool = False

    def __str__(self) -> str:
        names = {
            "pattern": "uneven light over the image",
            "ranged": "its change with range",
            "gains": "different exposure of frames",
            "shading": "shadows and sunlight that move",
        }
        return ", ".join(name for key, name in names.items() if getattr(self, key)) or "nothing"


@dataclass(frozen=True, eq=False)
class Window:
    """patch (N,): ascending. frame (N,): number in the dive. terms (N, TERMS), trend (N, 1). values
    (N, Q): logarithms to explain. held (N,): True for observations of patches that are left out of
    the fit, to test it.
    """

    patch: NDArray[np.int64]
    frame: NDArray[np.int64]
    terms: NDArray[np.float32]
    trend: NDArray[np.float32]
    values: Array
    held: NDArray[np.bool_]

    def part(self, held: bool) -> "Window":
        """The observations that are left out of the fit, or the others."""
        chosen = self.held == held
        patch = np.unique(self.patch[chosen], return_inverse=True)[1]
        parts = (self.frame, self.terms, self.trend, self.values, self.held)
        return Window(patch, *(own[chosen] for own in parts))

    @property
    def luminance(self) -> "Window":
        """The window of the mean of the values."""
        return replace(self, values=self.values.mean(axis=1, keepdims=True))

    @property
    def color(self) -> "Window":
        """The window of the values less their mean."""
        return replace(self, values=self.values - self.luminance.values)


@dataclass(frozen=True, eq=False)
class Solution:
    """A solved light; Q outputs: 1 for luminance, 3 for color.

    coefficients: (TERMS, Q), 0 for terms that are not in use. trend: (1, Q), per unit of
    ``Light.log_range``. gains: (F, Q) logarithms of mean 0. shading: (F, SHADING, Q) coefficients.
    trend_error: standard error of each number of the trend.
    misfit: twice the negative logarithm of the evidence, to compare priors and terms.
    covariance: (PATTERN, PATTERN) of the coefficients of the pattern at the reference range; 0
    without a pattern.
    """

    coefficients: Array
    trend: Array
    gains: Array
    shading: Array
    trend_error: float
    misfit: float
    covariance: Array


def window_of(
    seen: Observations, usable: NDArray[np.bool_], light: Light, size: tuple[int, int]
) -> Window:
    """The window of logarithms of usable (N,) observations of patches that two frames or more show.

    light: defines the ranges of the polynomial. size: (width, height) of the image.
    """
    patch = seen.patch[usable]
    kept = np.flatnonzero(usable)[np.bincount(patch, minlength=1)[patch] > 1]
    seen = seen.part(kept)
    patch = np.unique(seen.patch, return_inverse=True)[1]
    log_range = light.log_range(seen.range_m)
    terms = pattern_terms(seen.pixel, log_range, size).astype(np.float32)
    trend = log_range[:, None].astype(np.float32)
    held = (patch // 2) % 2 == 1  # every other two neighbors of the grid
    return Window(patch, seen.frames[seen.frame], terms, trend, np.log(seen.light), held)


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of windows with all terms, of which a fit uses some columns.

    parts: of each window. frames: their number. products: of values and columns, equally weighted:
    Q outputs, COLUMNS that all frames share, OWN of each frame. means: the same of the means of
    patches, with powers of their range first. variance: of the mean light of a patch, times the
    number of patches that count as one.
    """

    parts: "Sequence[_WindowSums]"
    frames: int
    products: Array
    means: Array
    variance: float

    @classmethod
    def of(cls, windows: Sequence[Window], frames: int) -> "Equations":
        """Make the equations of the values of windows."""
        parts = [_WindowSums.of(window) for window in windows]
        outputs, powers = windows[0].values.shape[1], np.arange(REEF.range_degree + 1)
        size = outputs + COLUMNS + frames * OWN
        means, lights, cells = np.zeros((len(powers) + size,) * 2), [], []
        for window, part in zip(windows, parts, strict=True):
            mean = part.sums(part.seen)[0] / part.seen.sum(axis=0)[:, None]
            log_range = mean[:, outputs + TERMS]
            row = np.concatenate([log_range[:, None] ** powers, mean], axis=1)
            at = np.concatenate([powers, len(powers) + part.at])
            means[np.ix_(at, at)] += row.T @ row
            lights.append(row[:, : len(powers) + outputs])
            cells.append(_cells(window.terms[np.diff(window.patch, prepend=-1) > 0]))
        products = _products(parts, [part.seen for part in parts], size)
        return cls(parts, frames, products, means, _variance_of_mean(lights, cells, len(powers)))

    @property
    def outputs(self) -> int:
        """Q: 1 for luminance, 3 for color."""
        return len(self.products) - COLUMNS - self.frames * OWN


def solve(equations: Equations, use: LightTerms, prior: LightPrior) -> Solution:
    """Solve the light by robust least squares. use: terms to solve."""
    columns = np.zeros(COLUMNS, np.bool_)
    columns[:PATTERN], columns[PATTERN:TERMS], columns[TERMS:] = use.pattern, use.ranged, True
    of_frame = (OWN if use.shading else 1) if use.gains else 0
    frames, outputs = equations.frames, equations.outputs
    known = prior.of(columns, frames, of_frame)
    of_frames = outputs + COLUMNS + np.arange(frames)[:, None] * OWN + np.arange(of_frame)
    chosen = np.concatenate(
        [np.arange(outputs), outputs + np.flatnonzero(columns), of_frames.ravel()]
    )
    parts = [part.using(columns, of_frame) for part in equations.parts]
    reef = MeanReef.of(equations, chosen, prior)
    products = equations.products[np.ix_(chosen, chosen)]
    found, matrix, squares, variance = _robust_fit(parts, products, known, reef, prior)
    number, unknowns = int(columns.sum()), np.zeros((COLUMNS + frames * OWN, outputs))
    unknowns[chosen[outputs:] - outputs] = found
    own = unknowns[COLUMNS:].reshape(frames, OWN, outputs)
    independent = sum(part.seen.sum() - part.seen.shape[1] for part in parts) / prior.alike.views
    squares = outputs * (squares / variance + independent * np.log(variance))
    squares += reef.squares_left(found)
    evidence = matrix / variance + reef.precision
    covariance = np.linalg.inv(evidence + known.precision)
    return Solution(
        coefficients=unknowns[:TERMS],
        trend=unknowns[TERMS:COLUMNS],
        gains=own[:, 0] - own[:, 0].mean(axis=0),
        shading=own[:, 1:],
        trend_error=float(np.sqrt(covariance[number - 1, number - 1])),
        misfit=known.misfit(found, squares, evidence),
        covariance=np.asarray(covariance[:PATTERN, :PATTERN], np.float64)
        if use.pattern
        else np.zeros((PATTERN, PATTERN)),
    )


def _robust_fit(
    parts: "Sequence[_WindowSums]",
    products: Array,
    known: Gaussian,
    reef: "MeanReef",
    prior: LightPrior,
) -> tuple[Array, Array, float, float]:
    """Solve in rounds, each with Cauchy weights from the residuals of the one before. products: of
    the first round, equally weighted.

    Returns unknowns (n, Q), normal equations (n, n) without the prior, weighted sum of squares, and
    the variance of an observation times the number that count as one.
    """
    weights = [part.seen for part in parts]
    variance, outputs = SETTINGS.first_prior, len(products) - len(known.mean)
    precision = known.precision + reef.precision
    for number in range(SETTINGS.rounds):
        if number:
            products = _products(parts, weights, len(products))
        matrix, slope = products[outputs:, outputs:], products[outputs:, :outputs]
        right = slope + variance * ((known.precision @ known.mean)[:, None] + reef.right)
        found = np.asarray(np.linalg.solve(matrix + variance * precision, right), np.float64)
        residuals = [part.residuals(found, own) for part, own in zip(parts, weights, strict=True)]
        both = list(zip(parts, residuals, strict=True))
        every = np.concatenate([own[part.seen > 0] for part, own in both])
        scale = max(deviation_about_zero(every) if every.size else 0.0, SETTINGS.least_scale)
        weights = [
            part.seen / (1.0 + (own / (SETTINGS.outlier * scale)) ** 2) for part, own in both
        ]
        variance = prior.alike.views * max(scale, prior.about.systematic) ** 2
    squares = [(weight * own**2).sum() for weight, own in zip(weights, residuals, strict=True)]
    return found, matrix, float(sum(squares)), variance


def _products(parts: "Sequence[_WindowSums]", weights: Sequence[Array], size: int) -> Array:
    """(size, size) sum of the products of all windows."""
    total = np.zeros((size, size))
    for part, weight in zip(parts, weights, strict=True):
        total[np.ix_(part.at, part.at)] += part.products(weight)
    return total


@dataclass(frozen=True, eq=False)
class MeanReef:
    """The mean light of the reef: over many patches it is the same in each part of the image and in
    each frame, at equal range, with an error by the number of independent patches. Views of one
    patch show neither a slope across a straight track nor a drift of gains along it.

    precision (n, n), right (n, Q): normal equations, as of a prior. squares (Q,): of the light of
    the patches, in variances.
    """

    precision: Array
    right: Array
    squares: Array

    @classmethod
    def of(cls, equations: Equations, chosen: NDArray[np.int64], prior: LightPrior) -> "MeanReef":
        """Make the equations of the unknowns in use. chosen: their numbers, after the outputs'."""
        nuisance, outputs = REEF.range_degree + 1, equations.outputs
        at = np.concatenate([np.arange(nuisance), nuisance + chosen])
        sums = equations.means[np.ix_(at, at)]
        inner, cross = sums[:nuisance, :nuisance], sums[:nuisance, nuisance:]
        regular = 1e-9 * np.trace(inner) * np.eye(nuisance)
        rest = sums[nuisance:, nuisance:] - cross.T @ np.linalg.solve(inner + regular, cross)
        variance = equations.variance * prior.alike.windows * prior.about.mean_reef**2
        rest /= max(variance, REEF.least_variance)
        return cls(rest[outputs:, outputs:], rest[outputs:, :outputs], np.diag(rest)[:outputs])

    def squares_left(self, unknowns: Array) -> float:
        """The sum of squares that the (n, Q) unknowns leave, in variances."""
        explained = 2 * self.right - self.precision @ unknowns
        return float(self.squares.sum() - (unknowns * explained).sum())


@dataclass(frozen=True)
class ReefSettings:
    """Settings of the mean of the reef."""

    range_degree: int = 2
    """Degree in log range by which the reef's light may change: corals are nearer than sand."""
    cells: int = 3
    """Parts of the image, each way, whose means tell how many patches count as one."""
    least_variance: float = 1e-4
    """Least variance of a patch times the number of patches that count as one."""


REEF = ReefSettings()


def _cells(terms: NDArray[np.float32]) -> NDArray[np.int64]:
    """(P,) part of the image of each patch, by its first view."""
    place = np.clip(((terms[:, :2] + 1) / 2 * REEF.cells).astype(np.int64), 0, REEF.cells - 1)
    return np.asarray(place[:, 1] * REEF.cells + place[:, 0])


def _variance_of_mean(
    lights: Sequence[Array], cells: Sequence[NDArray[np.int64]], nuisance: int
) -> float:
    """Variance of a patch's light times the number alike, from the means of parts of images."""
    every = np.concatenate(lights)
    fitted = np.linalg.lstsq(every[:, :nuisance], every[:, nuisance:], rcond=None)[0]
    means = []
    for light, cell in zip(lights, cells, strict=True):
        left = light[:, nuisance:] - light[:, :nuisance] @ fitted
        count = np.bincount(cell, minlength=REEF.cells**2)
        for output in left.T:
            mean = np.bincount(cell, output, REEF.cells**2)[count > 0] / count[count > 0]
            means.append(np.sqrt(count[count > 0]) * mean)
    return float(np.mean(np.concatenate(means) ** 2)) if means else REEF.least_variance


def pattern_error(solution: Solution, others: Sequence[Solution]) -> float:
    """Standard error of the pattern at the reference range, logarithm, rms over the image. others:
    solutions that fit about equally well, and this one, weighted by their evidence.
    """
    weights = np.exp(
        0.5 * (min(other.misfit for other in others) - np.array([other.misfit for other in others]))
    )
    squares = []
    for other in others:
        off = (other.coefficients - solution.coefficients)[:PATTERN]
        squares.append(((other.covariance + off @ off.T / off.shape[1]) * MEAN_SQUARES).sum())
    return float(np.sqrt(np.average(squares, weights=weights)))


@dataclass(frozen=True, eq=False)
class _WindowSums:
    """The equations of a window of F frames and P patches.

    seen (F, P): 1 where a frame sees a patch, else 0, as everything else is there. both
    (F, P, Q + C): the values, and the columns of unknowns that all frames share. own (F, P, K): the
    columns of a frame's own unknowns. frames (F,): their numbers.
    """

    seen: Array
    both: Array
    own: Array
    frames: NDArray[np.int64]

    @classmethod
    def of(cls, window: Window) -> "_WindowSums":
        """The equations of a window, with all terms."""
        frames, index = np.unique(window.frame, return_inverse=True)
        columns = [window.terms[:, :SHADING], window.values, window.terms, window.trend]
        rows = np.concatenate([np.ones((len(index), 1)), *columns], axis=1)
        grid = np.zeros((len(frames), window.patch.max(initial=-1) + 1, rows.shape[1]))
        grid[index, window.patch] = rows
        both, own = grid[..., OWN:].copy(), grid[..., :OWN].copy()
        return cls(own[..., 0], both, own, frames)

    def using(self, columns: NDArray[np.bool_], of_frame: int) -> "_WindowSums":
        """The same with some columns. of_frame: unknowns of a frame."""
        used = np.ones(self.both.shape[2], np.bool_)
        used[-len(columns) :] = columns
        both = self.both if used.all() else np.compress(used, self.both, axis=2)
        return replace(self, both=both, own=self.own[..., :of_frame])

    @property
    def at(self) -> NDArray[np.int64]:
        """(Q + n,) numbers of the outputs and of the unknowns."""
        shared, of_frame = self.both.shape[2], self.own.shape[2]
        own = shared + self.frames[:, None] * of_frame + np.arange(of_frame)
        return np.concatenate([np.arange(shared), own.ravel()])

    def residuals(self, unknowns: Array, weight: Array) -> Array:
        """(F, P) rms over outputs of differences from the patch's mean, the solution removed."""
        (frames, _, of_frame), outputs = self.own.shape, unknowns.shape[1]
        every = np.concatenate([-np.eye(outputs), unknowns])[self.at]
        shared, own = every[: self.both.shape[2]], every[self.both.shape[2] :]
        left = self.both @ shared + self.own @ own.reshape(frames, of_frame, outputs)
        left -= (weight[..., None] * left).sum(axis=0) / weight.sum(axis=0)[:, None]
        return np.asarray(np.sqrt((left**2).mean(axis=2)))

    def sums(self, root: Array) -> tuple[Array, Array, Array]:
        """Sums over the observations of each patch, (P, Q + n) of values and columns, weighted.

        root (F, P): square root of the weights. Also returns ``both`` and ``own`` times it.
        """
        both, own = root[..., None] * self.both, root[..., None] * self.own
        sums = [np.einsum("fp,fpc->pc", root, both)]
        sums += [each[:, None] * columns for each, columns in zip(root, own, strict=True)]
        return np.concatenate(sums, axis=1), both, own

    def products(self, weight: Array) -> Array:
        """(Q + n, Q + n) of values and columns less their means over a patch."""
        (frames, _, of_frame), shared = self.own.shape, self.both.shape[2]
        sums, both, own = self.sums(np.sqrt(weight))
        sums /= np.sqrt(weight.sum(axis=0))[:, None]
        found = -(sums.T @ sums)
        rows = both.reshape(-1, shared)
        found[:shared, :shared] += rows.T @ rows
        cross = (own.swapaxes(1, 2) @ both).reshape(-1, shared)
        found[shared:, :shared] += cross
        found[:shared, shared:] += cross.T
        at = shared + np.arange(frames * of_frame).reshape(frames, of_frame)
        found[at[:, :, None], at[:, None, :]] += own.swapaxes(1, 2) @ own
        return found


def explained(window: Window, solution: Solution) -> Array:
    """(N, Q) values of a window by a solution, up to the brightness of its patches."""
    shading = np.einsum("ns,nsq->nq", window.terms[:, :SHADING], solution.shading[window.frame])
    part = np.asarray(window.terms @ solution.coefficients + solution.gains[window.frame] + shading)
    return np.asarray(part + window.trend @ solution.trend)
