"""Numbers of a terrain without the roughness that errors of ranges add, at the scale of its cells,
with standard errors.

Two things change what a terrain measures. Errors of the heights roughen it: the number is
computed again with errors drawn from the terrain's own (each cell's standard error, alike over
the correlation length), and what these add is taken off (simulation and extrapolation: Cook and
Stefanski 1994, J. American Statistical Association 89). Matching and voxels smooth it: the
number is computed again on a terrain that is smoothed further, and continued to the cell: slopes as
a power of the scale, as of a fractal surface; ranges of heights, which the largest things make, by
a factor for each unit of the scale. Both corrections are uncertain themselves: a part
of each is in the standard error.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array

DRAWS = 24
"""The standard error is then itself known to 15 % (1 / sqrt(2 (n - 1)))."""


@dataclass(frozen=True)
class CorrectionSettings:
    """How well the corrections are known, as fractions of themselves."""

    # standard errors of heights are known to some 15 %; extremes of heights grow unlike their
    # squares
    of_noise: float = 0.75
    of_scale: float = 0.5  # no reef is the same fractal at all scales
    # of the scale that is resolved: far enough to tell how the number goes with it
    smoother: float = 2.0
    # standard deviation of what matching smooths, in correlation lengths of its errors
    of_match: float = 0.85
    of_voxel: float = 0.5  # and of what voxels smooth, in voxels: both as found on synthetic reefs
    # of that standard deviation, what smoothing takes from highest places: as found on synthetic
    # reefs
    of_peaks: float = 0.5
    # a smoothing of that standard deviation squared, times this, counts as the square of a cell
    steps: float = 4.0
    # power of the scale with which squared slopes fall at most: 1 for a surface of sharp steps
    steepest: float = 1.5


SETTINGS = CorrectionSettings()


@dataclass(frozen=True, eq=False)
class Smoothing:
    """How numbers (K,) go with the scale at which heights are known.

    kernel_cells: edge of what each of them itself averages slopes over, in cells; 1 for differences
    of neighbors. of_ranges: True for squared ranges of heights.
    """

    kernel_cells: Array
    of_ranges: NDArray[np.bool_]

    def undone(self, fine: Array, coarse: Array, cells: float, resolved: float) -> Array:
        """The numbers at ``cells`` from those of heights resolved to ``resolved`` cells, and to
        ``smoother`` times as many.
        """
        own, added = self.kernel_cells * cells, resolved**2 - cells**2
        at_fine = np.sqrt(own**2 + added)
        at_coarse = np.sqrt(own**2 + added + (SETTINGS.smoother**2 - 1) * resolved**2)
        ratio, falling = at_coarse / at_fine, (coarse * fine > 0) & (np.abs(coarse) < np.abs(fine))
        falls = np.divide(fine, coarse, out=np.ones_like(fine), where=falling)
        falls = np.minimum(falls, ratio**SETTINGS.steepest)
        steps = np.where(
            self.of_ranges,
            (at_fine - own) / (at_coarse - at_fine),
            np.log(at_fine / own) / np.log(ratio),
        )
        return np.asarray(fine * falls**steps)


def observed(
    measure: Callable[[Array], Array],
    height_m: Array,
    noise_m: Array,
    correlation_cells: float,
    scale_cells: int = 1,
    draws: int = DRAWS,
    seed: int = 0,
) -> Array:
    """Measure a terrain, or a part of one, with drawn errors: what ``corrected`` needs.

    Args:
        measure: heights (H, W) -> (K,), to which errors and scales add: squares of slopes and of
            ranges of heights.
        height_m: (H, W), NaN where unknown.
        noise_m: (H, W) standard errors of the heights. Cells where it is NaN stay as they are.
        correlation_cells: length over which errors are alike, in cells, which is also how finely
            matching resolves.
        scale_cells: edge of the cells that ``measure`` averages heights over, in cells.
        draws: of errors.
        seed: of the draws: another one for each part of a terrain.

    Returns:
        (1 + draws, 2, K): as mapped, then with each draw; as it is, and smoothed further.
    """
    blur_cells = _resolved(correlation_cells, scale_cells) * float(
        np.sqrt((SETTINGS.smoother**2 - 1) / SETTINGS.steps)
    )

    def both(heights: Array) -> Array:
        return np.array([measure(heights), measure(smoothed(heights, blur_cells))])

    noises = _noises(noise_m, correlation_cells, draws // 2, seed)
    # what is odd cancels
    drawn = [both(height_m + sign * noise) for noise in noises for sign in (1, -1)]
    return np.array([both(height_m), *drawn])


def corrected(
    found: Array,
    smoothing: Smoothing,
    derive: Callable[[Array], Array],
    correlation_cells: float,
    scale_cells: int = 1,
) -> tuple[Array, Array, Array]:
    """Compute numbers of a terrain without its noise and at a stated scale.

    Args:
        found: (1 + draws, 2, K) what ``observed`` measured, of one terrain or the means of parts.
        smoothing: how these go with the scale.
        derive: (K,) -> (M,), the numbers.
        correlation_cells: as ``observed`` had it.
        scale_cells: as ``observed`` had it.

    Returns:
        The numbers, their standard errors by the draws, and by how well the corrections are known:
        (M,) each.
    """
    mapped, drawn = found[0], found[1:]
    fine, coarse = 2 * mapped - drawn.mean(axis=0)
    resolved = _resolved(correlation_cells, scale_cells)
    sharp = smoothing.undone(fine, coarse, scale_cells, resolved)
    raw, smooth, values = derive(mapped[0]), derive(fine), derive(sharp)
    of_corrections = np.hypot(
        SETTINGS.of_noise * (raw - smooth),
        SETTINGS.of_scale * (values - smooth),
    )
    by_draws = np.array([derive(draw) for draw in drawn[:, 0]]).std(axis=0, ddof=1)
    return values, by_draws, of_corrections


def blur_reach(correlation_cells: float, scale_cells: int) -> int:
    """Cells around a part of a terrain that ``observed`` smooths over."""
    return int(np.ceil(3 * _resolved(correlation_cells, scale_cells)))


def _resolved(correlation_cells: float, scale_cells: int) -> float:
    """How many cells across is what matching and voxels leave of the finest detail."""
    lost = _smoothed_cells(correlation_cells)
    return float(np.sqrt(scale_cells**2 + SETTINGS.steps * lost**2))


def _smoothed_cells(correlation_cells: float) -> float:
    """Standard deviation of what matching and voxels smooth, in cells."""
    of_match, of_voxel = SETTINGS.of_match, SETTINGS.of_voxel
    return float(np.hypot(of_match * correlation_cells, of_voxel))


def peaks(
    measure: Callable[[Array], Array], height_m: Array, noise_m: Array, correlation_cells: float
) -> tuple[Array, Array]:
    """Measure highest places without what noise adds to them, on average, and with what smoothing
    took: as much as smoothing once more takes.

    Args:
        measure: heights (H, W) -> (M,).
        height_m: (H, W), NaN where unknown.
        noise_m: (H, W) standard errors of the heights.
        correlation_cells: as ``observed`` has it.

    Returns:
        The values, and their standard errors by how well both corrections are known: (M,) each.
    """
    blur_cells = SETTINGS.of_peaks * _smoothed_cells(correlation_cells)

    def both(heights: Array) -> Array:
        return np.array([measure(heights), measure(smoothed(heights, blur_cells))])

    noises = _noises(noise_m, correlation_cells, DRAWS // 2)
    drawn = [both(height_m + sign * noise) for noise in noises for sign in (1, -1)]
    mapped = both(height_m)
    added = np.mean(drawn, axis=0) - mapped
    fine, coarse = mapped - added
    taken = np.maximum(fine - coarse, 0)
    return fine + taken, np.hypot(SETTINGS.of_noise * added[0], SETTINGS.of_scale * taken)


def spread_of(
    measure: Callable[[Array], Array], height_m: Array, std_m: Array, correlation_cells: float
) -> Array:
    """Compute the standard deviation, (M,), of ``measure`` (heights (H, W) -> (M,)) over DRAWS
    draws of errors of the heights.
    """
    noises = _noises(std_m, correlation_cells, DRAWS)
    return np.asarray(np.array([measure(height_m + noise) for noise in noises]).std(axis=0, ddof=1))


def _noises(std_m: Array, correlation_cells: float, count: int, seed: int = 0) -> Iterator[Array]:
    """Draws of errors (H, W) of heights; 0 where their standard error is unknown."""
    rng, sigma = np.random.default_rng(seed), correlation_cells / float(np.sqrt(2))
    return (_noise(std_m.shape, sigma, rng) * np.nan_to_num(std_m) for _ in range(count))


def averaged(heights: NDArray[np.float64], cells: int) -> NDArray[np.float64]:
    """Means of cells x cells blocks of heights (..., H, W), NaN if less than half is known."""
    if cells == 1:
        return heights
    rows, columns = (n // cells * cells for n in heights.shape[-2:])
    whole = heights[..., :rows, :columns]
    known = np.isfinite(whole)
    count = _block_sums(known.astype(np.float64), cells)
    mean = _block_sums(np.where(known, whole, 0), cells) / np.maximum(count, 1)
    return np.where(count >= 0.5 * cells**2, mean, np.nan)


def _block_sums(values: Array, cells: int) -> Array:
    """Sums of blocks of cells x cells: a third of the time of a sum over axes of so few."""
    strips = reduce(np.add, [values[..., k::cells, :] for k in range(cells)])
    return reduce(np.add, [strips[..., k::cells] for k in range(cells)])


def smoothed(heights: Array, sigma: float) -> Array:
    """Heights (H, W) after a Gaussian of ``sigma`` cells; unknown ones count for nothing."""
    known, size = np.isfinite(heights), (2 * int(np.ceil(3 * sigma)) + 1,) * 2
    weight = cv2.GaussianBlur(known.astype(np.float64), size, sigma, borderType=cv2.BORDER_CONSTANT)
    total = cv2.GaussianBlur(
        np.where(known, heights, 0), size, sigma, borderType=cv2.BORDER_CONSTANT
    )
    return np.where(known, total / np.maximum(weight, 1e-12), np.nan)


def _noise(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> Array:
    """Gaussian noise of unit variance, correlated as exp(-d^2 / (4 sigma^2)), cells."""
    noise = rng.standard_normal(shape)
    if sigma < 0.3:
        return noise
    size = 2 * int(np.ceil(3 * sigma)) + 1
    kernel = cv2.getGaussianKernel(size, sigma)
    return np.asarray(cv2.sepFilter2D(noise, -1, kernel, kernel) / float((kernel**2).sum()))
