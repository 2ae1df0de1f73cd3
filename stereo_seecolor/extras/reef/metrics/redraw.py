"""Standard errors of anything computed from a terrain, by repeating the computation with errors drawn from the terrain's own.

The errors are drawn with each cell's standard error, alike over the terrain's correlation length.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.site.terrain import Terrain
from stereo_seecolor.extras.reef.site.terrain_errors import TerrainErrors

Array = NDArray[np.float64]
DRAWS = 24
"""The standard error is then itself known to 15 % (1 / sqrt(2 (n - 1)))."""


def spread_of(measure: Callable[[Array], Array], terrain: Terrain, errors: TerrainErrors) -> Array:
    """Compute the standard deviation, (M,), of ``measure`` (heights (H, W) -> (M,)) over DRAWS draws of the terrain's errors.

    Cells whose standard error is unknown stay as they are.
    """
    rng = np.random.default_rng(0)
    std = np.nan_to_num(errors.std_m)
    sigma = errors.correlation_m / terrain.grid.cell_m / np.sqrt(2)
    results = np.array([measure(terrain.height_m + _noise(std.shape, sigma, rng) * std) for _ in range(DRAWS)])
    return np.asarray(results.std(axis=0, ddof=1))


def _noise(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> Array:
    """Gaussian noise of unit variance, correlated as exp(-d^2 / (4 sigma^2)), cells."""
    noise = rng.standard_normal(shape)
    if sigma < 0.3:
        return noise
    size = 2 * int(np.ceil(3 * sigma)) + 1
    kernel = cv2.getGaussianKernel(size, sigma)
    return np.asarray(cv2.sepFilter2D(noise, -1, kernel, kernel) / float((kernel**2).sum()))
