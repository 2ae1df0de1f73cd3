"""The light of a survey from patches that several frames show: robust least squares on sums of
windows of neighboring frames.

    log light of observation k = scene(patch_k) + terms_k coefficients + trend(range_k) +
        log_gain(frame_k)

The brightness of a patch is unknown and eliminated within its window, so that each window adds
normal equations. The trend with range contains the water and the fall-off of lamps; it is fitted
together with the other terms and stays in the images. Luminance (the mean logarithm of R, G, B) and
color (the rest) are solved separately, because moving shadows and caustics change luminance and
hardly color.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SolverSettings:
    """Rounds and weights of the robust least squares."""

    rounds: int = 5
    """Rounds with new weights; more make no visible difference."""
    outlier: float = 1.5
    """Robust standard deviations beyond which an observation has less than half its weight
    (Cauchy): fish.
    """
    first_prior: float = 1e-3
    """Precision of all unknowns in the first round, so that the system is solvable."""
    least_scale: float = 1e-4
    """Least robust deviation of residuals, logarithm: without it, all observations without noise
    would be outliers.
    """


SETTINGS = SolverSettings()


class LightTerms(NamedTuple):
    """Terms in use. ranged: the pattern changes with range. shading: each frame's own pattern."""

    pattern: bool = False
    ranged: bool = False
    gains: bool = False
    shading: bool = False

    def __str__(self) -> str:
        names = {
            "pattern": "uneven light over the picture",
            "ranged": "its change with range",
            "gains": "different exposure of frames",
            "shading": "shadows and sunlight that move",
        }
        return ", ".join(name for key, name in names.items() if getattr(self, key)) or "nothing"


@dataclass(frozen=True, eq=False)
class Window:
    """patch (N,): ascending. frame (N,): number in the dive. terms (N, TERMS), trend (N, 1),
    log_light (N, 3). held (N,): True for observations of patches that are left out of the fit, to
    test it.
    """

    patch: NDArray[np.int64]
    frame: NDArray[np.int64]
    terms: NDArray[np.float32]
    trend: NDArray[np.float32]
    log_light: Array
    held: NDArray[np.bool_]

    def part(self, held: bool) -> "Window":
        """Return only the observations that are left out of the fit, or only the others."""
        chosen = self.held == held
        patch = np.unique(self.patch[chosen], return_inverse=True)[1]
        parts = (self.frame, self.terms, self.trend, self.log_light, self.held)
        return Window(patch, *(values[chosen] for values in parts))


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
    seen: Observations,
    frames: NDArray[np.int64],
    usable: NDArray[np.bool_],
    light: Light,
    size: tuple[int, int],
) -> Window:
    """Make the window of the usable (N,) observations of patches that two frames or more show.

    frames: number in the dive of each frame of the observations. light: defines the ranges of the
    polynomial. size: (width, height) of the image.
    """
    patch = seen.patch[usable]
    kept = np.flatnonzero(usable)[np.bincount(patch, minlength=1)[patch] > 1]
    patch = np.unique(seen.patch[kept], return_inverse=True)[1]
    log_range = light.log_range(seen.range_m[kept])
    terms = pattern_terms(seen.pixel[kept], log_range, size).astype(np.float32)
    trend = log_range[:, None].astype(np.float32)
    held = (patch // 2) % 2 == 1  # every other two neighbors of the grid
    return Window(patch, frames[seen.frame[kept]], terms, trend, np.log(seen.light[kept]), held)


def solve(
    windows: Sequence[Window],
    values: Sequence[Array],
    use: LightTerms,
    frames: int,
    prior: LightPrior,
) -> Solution:
    """Solve the light by robust least squares.

    values: of each window, (N, Q) logarithms to explain: luminance or color. use: terms to solve.
    frames: number of frames in all.
    """
    columns = np.zeros(TERMS + 1, np.bool_)
    columns[:PATTERN], columns[PATTERN:TERMS], columns[TERMS:] = use.pattern, use.ranged, True
    of_frame = (1 + SHADING if use.shading else 1) if use.gains else 0
    known, outputs = prior.of(columns, frames, of_frame), values[0].shape[1]
    parts = [
        _WindowSums.of(window, columns, of_frame, value)
        for window, value in zip(windows, values, strict=True)
    ]
    reef = MeanReef.of(windows, parts, (len(known.mean), outputs), prior)
    found, matrix, squares, variance = _robust_fit(parts, known, reef, prior, outputs)
    number = int(columns.sum())
    coefficients = np.zeros((TERMS + 1, outputs))
    coefficients[columns] = found[:number]
    own = np.zeros((frames, 1 + SHADING, outputs))
    own[:, :of_frame] = found[number:].reshape(frames, of_frame, outputs)
    independent = sum(len(part.patch) - len(part.first) for part in parts) / prior.alike.views
    squares = outputs * (squares / variance + independent * np.log(variance))
    squares += reef.squares_left(found)
    evidence = matrix / variance + reef.precision
    covariance = np.linalg.inv(evidence + known.precision)
    return Solution(
        coefficients=coefficients[:TERMS],
        trend=coefficients[TERMS:],
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
    known: Gaussian,
    reef: "MeanReef",
    prior: LightPrior,
    outputs: int,
) -> tuple[Array, Array, float, float]:
    """Solve in rounds, each with Cauchy weights from the residuals of the one before.

    Returns the unknowns (n, Q), their normal equations (n, n) without the prior, the weighted sum
    of squares, and the variance of an observation times the number that count as one.
    """
    weights = [np.ones(len(part.patch)) for part in parts]
    variance, size = SETTINGS.first_prior, len(known.mean)
    for _ in range(SETTINGS.rounds):
        matrix, slope = np.zeros((size, size)), np.zeros((size, outputs))
        for part, weight in zip(parts, weights, strict=True):
            products, number = part.products(weight), len(part.at)
            matrix[np.ix_(part.at, part.at)] += products[:, :number]
            slope[part.at] += products[:, number:]
        right = slope + variance * ((known.precision @ known.mean)[:, None] + reef.right)
        precision = known.precision + reef.precision
        found = np.asarray(np.linalg.solve(matrix + variance * precision, right), np.float64)
        residuals = [part.residuals(found, own) for part, own in zip(parts, weights, strict=True)]
        every = np.concatenate(residuals)
        scale = max(deviation_about_zero(every) if every.size else 0.0, SETTINGS.least_scale)
        weights = [1.0 / (1.0 + (own / (SETTINGS.outlier * scale)) ** 2) for own in residuals]
        variance = prior.alike.views * max(scale, prior.about.systematic) ** 2
    squares = [(weight * own**2).sum() for weight, own in zip(weights, residuals, strict=True)]
    return found, matrix, float(sum(squares)), variance


@dataclass(frozen=True, eq=False)
class MeanReef:
    """The mean light of the reef: over many patches it is the same in each part of the image and in
    each frame, at equal range.

    Views of one patch show neither a slope across a straight track nor a drift of gains along it.
    The light of the patches has the same mean everywhere, with an error that follows from the
    number of independent patches.

    precision (n, n), right (n, Q): normal equations, as of a prior. squares (Q,): of the light of
    the patches, in variances.
    """

    precision: Array
    right: Array
    squares: Array

    @classmethod
    def of(
        cls,
        windows: Sequence[Window],
        parts: "Sequence[_WindowSums]",
        size_of: tuple[int, int],
        prior: LightPrior,
    ) -> "MeanReef":
        """Add up the equations of all windows. size_of: numbers of unknowns and of outputs."""
        (unknowns, outputs), nuisance = size_of, REEF.range_degree + 1
        size = nuisance + unknowns + outputs
        sums, lights, cells = np.zeros((size, size)), [], []
        for window, part in zip(windows, parts, strict=True):
            count = part.sums(np.ones(len(part.patch)))
            mean = part.sums(part.both) / count[:, None]
            log_range = part.sums(window.trend[:, 0].astype(np.float64)) / count
            powers = log_range[:, None] ** np.arange(nuisance)
            row = np.concatenate([powers, mean], axis=1)
            at = np.concatenate(
                [np.arange(nuisance), nuisance + part.at, np.arange(size)[-outputs:]]
            )
            sums[np.ix_(at, at)] += row.T @ row
            lights.append(np.concatenate([powers, mean[:, len(part.at) :]], axis=1))
            cells.append(_cells(window.terms[part.first]))
        variance = _variance_of_mean(lights, cells, nuisance) * prior.alike.windows
        variance *= prior.about.mean_reef**2
        inner, cross = sums[:nuisance, :nuisance], sums[:nuisance, nuisance:]
        regular = 1e-9 * np.trace(inner) * np.eye(nuisance)
        rest = sums[nuisance:, nuisance:] - cross.T @ np.linalg.solve(inner + regular, cross)
        rest /= max(variance, REEF.least_variance)
        return cls(rest[:unknowns, :unknowns], rest[:unknowns, unknowns:], np.diag(rest)[unknowns:])

    def squares_left(self, unknowns: Array) -> float:
        """Compute the remaining sum of squares with the (n, Q) unknowns, in variances."""
        explained = 2 * self.right - self.precision @ unknowns
        return float(self.squares.sum() - (unknowns * explained).sum())


@dataclass(frozen=True)
class ReefSettings:
    """Settings of the mean of the reef."""

    range_degree: int = 2
    """Degree in the logarithm of the range with which the light of the reef may change: corals are
    nearer than sand.
    """
    cells: int = 3
    """Parts of the image, each way, whose means determine the number of patches that count as one.
    """
    least_variance: float = 1e-4
    """Least variance of a patch times the number of patches that count as one."""


REEF = ReefSettings()


def _cells(terms: NDArray[np.float32]) -> NDArray[np.int64]:
    """(P,) part of the picture of each patch, by its first view."""
    place = np.clip(((terms[:, :2] + 1) / 2 * REEF.cells).astype(np.int64), 0, REEF.cells - 1)
    return np.asarray(place[:, 1] * REEF.cells + place[:, 0])


def _variance_of_mean(
    lights: Sequence[Array], cells: Sequence[NDArray[np.int64]], nuisance: int
) -> float:
    """Variance of a patch's light times the number of patches that are alike: that of the mean of n
    patches is this by n. Measured from the means of parts of pictures.
    """
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
    """Compute the standard error of the pattern at the reference range, logarithm, rms over the
    image.

    others: solutions that fit about equally well, and this one, weighted by their evidence.
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
    """both (N, n + Q): the n columns that are not 0 in a window, and the values. at (n,): numbers
    of these columns. patch (N,): of each observation. first: of each patch.
    """

    both: Array
    at: NDArray[np.int64]
    patch: NDArray[np.int64]
    first: NDArray[np.int64]

    @classmethod
    def of(
        cls, window: Window, columns: NDArray[np.bool_], of_frame: int, value: Array
    ) -> "_WindowSums":
        """The equations of a window. columns: terms in use. of_frame: unknowns of a frame."""
        design = np.concatenate([window.terms, window.trend], axis=1)[:, columns]
        seen_by, index = np.unique(window.frame, return_inverse=True)
        every = np.arange(len(design))
        terms = np.concatenate([np.ones((len(design), 1)), window.terms[:, :SHADING]], axis=1)
        own = np.zeros((len(design), len(seen_by), of_frame))
        own[every, index] = terms[:, :of_frame]
        of_frames = design.shape[1] + seen_by[:, None] * of_frame + np.arange(of_frame)
        at = np.concatenate([np.arange(design.shape[1]), of_frames.ravel()])
        both = [design.astype(np.float64), own.reshape(len(design), -1), value]
        first = np.flatnonzero(np.diff(window.patch, prepend=-1))
        return cls(np.concatenate(both, axis=1), at, window.patch, first)

    def residuals(self, unknowns: Array, weight: Array) -> Array:
        """(N,) rms over outputs of differences from the patch's mean, the solution removed."""
        number, squares = len(self.at), np.zeros(len(self.patch))
        for output in range(unknowns.shape[1]):
            left = self.both[:, number + output] - self.both[:, :number] @ unknowns[self.at, output]
            left -= (self.sums(left * weight) / self.sums(weight))[self.patch]
            squares += left**2
        return np.asarray(np.sqrt(squares / unknowns.shape[1]))

    def products(self, weight: Array) -> Array:
        """(n, n + Q) normal equations of the columns less their means over a patch."""
        number, weighted = len(self.at), weight[:, None] * self.both
        sums = self.sums(weighted)
        means = sums[:, :number] / self.sums(weight)[:, None]
        return np.asarray(weighted[:, :number].T @ self.both - means.T @ sums)

    def sums(self, values: Array) -> Array:
        """Sums over the observations of each patch."""
        return np.add.reduceat(values, self.first, axis=0) if len(values) else values


def explained(window: Window, solution: Solution) -> Array:
    """Compute the (N, Q) values of a window from a solution, up to the brightness of its
    patches.
    """
    shading = np.einsum("ns,nsq->nq", window.terms[:, :SHADING], solution.shading[window.frame])
    part = np.asarray(window.terms @ solution.coefficients + solution.gains[window.frame] + shading)
    return np.asarray(part + window.trend @ solution.trend)
