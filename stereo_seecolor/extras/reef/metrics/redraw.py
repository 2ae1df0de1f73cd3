"""Numbers of a terrain without the roughness that errors of ranges add, at the scale of its cells, with standard errors.

Two things change what a terrain measures. Errors of the heights roughen it: the number is computed again with errors drawn from
the terrain's own (each cell's standard error, alike over the correlation length), and what these add is taken off (simulation and
extrapolation: Cook and Stefanski 1994, J. American Statistical Association 89). Matching and voxels smooth it: the number is
computed again on a terrain that is smoothed further, and continued to the cell as a power of the scale, as of a fractal surface.
Both corrections are uncertain themselves: a part of each is in the standard error.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.site.terrain import Terrain
from stereo_seecolor.extras.reef.site.terrain_errors import TerrainErrors

Array = NDArray[np.float64]
DRAWS = 24
"""The standard error is then itself known to 15 % (1 / sqrt(2 (n - 1)))."""


@dataclass(frozen=True)
class CorrectionSettings:
    """How well the corrections are known, as fractions of themselves."""

    of_noise: float = 0.75  # standard errors of heights are known to some 15 %; extremes of heights grow unlike their squares
    of_scale: float = 0.5  # no reef is the same fractal at all scales
    smoother: float = 2.0  # of the scale that is resolved: far enough to tell how the number goes with it
    of_match: float = 0.85  # standard deviation of what matching smooths, in correlation lengths of its errors
    of_voxel: float = 0.5  # and of what voxels smooth, in voxels: both as found on drawn reefs
    steps: float = 4.0  # a smoothing of that standard deviation squared, times this, counts as the square of a cell
    steepest: float = 1.5  # power of the scale with which squared slopes fall at most: 1 for a surface of sharp steps


SETTINGS = CorrectionSettings()


def corrected(
    measure: Callable[[Array], Array], derive: Callable[[Array], Array], terrain: Terrain, errors: TerrainErrors, scale_m: float
) -> tuple[Array, Array]:
    """Compute numbers of a terrain without its noise and at a stated scale, and their standard errors: (M,) each.

    Args:
        measure: heights (H, W) -> (K,), to which errors and scales add: squares of slopes and of ranges of heights.
        derive: (K,) -> (M,), the numbers.
        terrain: its heights are measured. Cells whose standard error is unknown stay as they are.
        errors: standard errors of its heights, and the length over which they are correlated, which is also how finely
            matching resolves.
        scale_m: edge of the cells that ``measure`` averages heights over.
    """
    cell_m = terrain.grid.cell_m
    smoothing_m = np.hypot(SETTINGS.of_match * errors.correlation_m, SETTINGS.of_voxel * cell_m)
    resolved_m = float(np.sqrt(scale_m**2 + SETTINGS.steps * smoothing_m**2))
    blur_cells = resolved_m / cell_m * float(np.sqrt((SETTINGS.smoother**2 - 1) / SETTINGS.steps))

    def both(heights: Array) -> Array:
        return np.array([measure(heights), measure(smoothed(heights, blur_cells))])

    noises = _noises(errors.noise_m, errors.correlation_m / cell_m, DRAWS // 2)
    mapped = both(terrain.height_m)
    draws = np.array([both(terrain.height_m + sign * noise) for noise in noises for sign in (1, -1)])  # what is odd cancels
    fine, coarse = 2 * mapped - draws.mean(axis=0)
    falls = np.divide(fine, coarse, out=np.ones_like(fine), where=(coarse * fine > 0) & (np.abs(coarse) < np.abs(fine)))
    falls = np.minimum(falls, SETTINGS.smoother**SETTINGS.steepest)
    sharp = fine * falls ** (np.log(resolved_m / scale_m) / np.log(SETTINGS.smoother))
    raw, smooth, values = derive(mapped[0]), derive(fine), derive(sharp)
    noise, scale = SETTINGS.of_noise * (raw - smooth), SETTINGS.of_scale * (values - smooth)
    by_draws = np.array([derive(draw) for draw in draws[:, 0]]).std(axis=0, ddof=1)
    return values, np.linalg.norm([by_draws, noise, scale], axis=0)


def spread_of(measure: Callable[[Array], Array], terrain: Terrain, errors: TerrainErrors) -> Array:
    """Compute the standard deviation, (M,), of ``measure`` (heights (H, W) -> (M,)) over DRAWS draws of the terrain's errors."""
    noises = _noises(errors.std_m, errors.correlation_m / terrain.grid.cell_m, DRAWS)
    return np.asarray(np.array([measure(terrain.height_m + noise) for noise in noises]).std(axis=0, ddof=1))


def _noises(std_m: Array, correlation_cells: float, count: int) -> Iterator[Array]:
    """Draws of errors (H, W) of heights; 0 where their standard error is unknown."""
    rng, sigma = np.random.default_rng(0), correlation_cells / float(np.sqrt(2))
    return (_noise(std_m.shape, sigma, rng) * np.nan_to_num(std_m) for _ in range(count))


def smoothed(heights: Array, sigma: float) -> Array:
    """Heights (H, W) after a Gaussian of ``sigma`` cells; what is unknown stays so, and counts for nothing."""
    known, size = np.isfinite(heights), (2 * int(np.ceil(3 * sigma)) + 1,) * 2
    weight = cv2.GaussianBlur(known.astype(np.float64), size, sigma, borderType=cv2.BORDER_CONSTANT)
    total = cv2.GaussianBlur(np.where(known, heights, 0), size, sigma, borderType=cv2.BORDER_CONSTANT)
    return np.where(known, total / np.maximum(weight, 1e-12), np.nan)


def _noise(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> Array:
    """Gaussian noise of unit variance, correlated as exp(-d^2 / (4 sigma^2)), cells."""
    noise = rng.standard_normal(shape)
    if sigma < 0.3:
        return noise
    size = 2 * int(np.ceil(3 * sigma)) + 1
    kernel = cv2.getGaussianKernel(size, sigma)
    return np.asarray(cv2.sepFilter2D(noise, -1, kernel, kernel) / float((kernel**2).sum()))
