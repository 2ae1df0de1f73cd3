"""Other color methods for comparison, implemented from their papers.

Every method takes an image as displayed, (H, W, 3) float64 in [0, 1], with a range map (H, W) in
meters, NaN where unknown, and returns (H, W, 3) float64 in the same encoding, not clipped, NaN
where it has no result. ``expose`` sets all to one exposure.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from stereo_seecolor.records import Array

Method = Callable[[Array, Array], Array]

# of the pixels of each channel that become black, and white: the usual contrast stretch
STRETCHED_FRACTION = 0.01
# darkest pixels of each bin of range (Akkaynak and Treibitz, CVPR 2019)
DARK_FRACTION, DARK_BINS = (0.01, 10)
CLIPPED_FRACTION = 0.0005  # of the pixels at full scale, at most 1 in 2000
LEAST_ATTENUATION = 1e-3  # 1/m: below, a logarithm of a ratio is noise
_GRID_WIDTH, _AVERAGING_STEPS = 160, 600  # pixels, and steps of the local averaging of Sea-thru


def raw(image: Array, range_m: Array) -> Array:
    """The image unchanged."""
    return image


def contrast_stretch(image: Array, range_m: Array) -> Array:
    """Each channel stretched from its darkest to its brightest hundredth, and clipped."""
    low, high = np.quantile(
        image.reshape(-1, 3), [STRETCHED_FRACTION, 1 - STRETCHED_FRACTION], axis=0
    )
    return np.asarray(np.clip((image - low) / np.maximum(high - low, 1e-6), 0, 1))


def gray_world(image: Array, range_m: Array) -> Array:
    """A gain a channel that makes the mean of pixels with range gray (Buchsbaum 1980)."""
    known = np.isfinite(range_m)
    mean = image[known].mean(axis=0)
    return expose(image * (mean.mean() / np.maximum(mean, 1e-6)), known)


def simple_model(image: Array, range_m: Array) -> Array:
    """One coefficient a channel for both attenuation and backscatter (paper, eqs. 2 and 3), then
    gray world.

    Backscatter is fitted to the darkest hundredth of ten range bins; J = (I - B) exp(a z).
    """
    known = np.isfinite(range_m)
    z, dark = darkest(image[known], range_m[known])
    result = np.full(image.shape, np.nan)
    for c in range(3):
        rate, (level,) = _best_rates(
            z, dark[:, c], 1, lambda z, rates: 1 - np.exp(-rates[0] * z)[:, None]
        )
        a = rate[0]
        result[known, c] = np.maximum(
            image[known, c] - level * -np.expm1(-a * range_m[known]), 0
        ) * np.exp(a * range_m[known])
    return gray_world(result, range_m)


def sea_thru(image: Array, range_m: Array) -> Array:
    """Akkaynak and Treibitz, CVPR 2019: backscatter with residual from the darkest, illuminant by
    local space average color, attenuation of two exponentials so that it gives back the ranges,
    then gray world.
    """
    known = np.isfinite(range_m)
    z, dark = darkest(image[known], range_m[known])
    direct = np.full(image.shape, np.nan)
    for c in range(3):
        (beta, alpha), (level, rest) = _best_rates(
            z,
            dark[:, c],
            2,
            lambda z, rates: np.stack([1 - np.exp(-rates[0] * z), np.exp(-rates[1] * z)], axis=1),
        )
        backscatter = level * -np.expm1(-beta * range_m[known]) + rest * np.exp(
            -alpha * range_m[known]
        )
        direct[known, c] = np.maximum(image[known, c] - backscatter, 0)
    coarse = local_space_average(direct, range_m)
    result = np.full(image.shape, np.nan)
    for c in range(3):
        seen = known & (coarse[..., c] > 1e-3)
        attenuation = _two_exponentials(
            range_m[seen], -np.log(np.minimum(coarse[seen, c], 1)) / range_m[seen]
        )
        result[known, c] = direct[known, c] * np.exp(attenuation(range_m[known]) * range_m[known])
    return gray_world(result, range_m)


PAPER, OURS = "paper", "stereo-seecolor"
"""Names of the paper's method and of this program's beside the others."""

METHODS: dict[str, Method] = {
    "raw": raw,
    "contrast stretch": contrast_stretch,
    "gray world": gray_world,
    "simple model": simple_model,
    "sea-thru": sea_thru,
}


def expose(image: Array, known: NDArray[np.bool_], fraction: float = CLIPPED_FRACTION) -> Array:
    """The image scaled so that a fraction of its known pixels has a channel at full scale."""
    brightest = float(np.quantile(image[known].max(axis=-1), 1 - fraction))
    return image / brightest if brightest > 0 else image


def darkest(pixels: Array, range_m: Array) -> tuple[Array, Array]:
    """Pixels for Sea-thru's estimate of backscatter: ranges (K,), colors (K, 3) of the darkest
    hundredth of ten range bins.
    """
    edges = np.linspace(range_m.min(), range_m.max(), DARK_BINS + 1)
    bins = np.clip(np.digitize(range_m, edges) - 1, 0, DARK_BINS - 1)
    ranges, colors = [], []
    for b in range(DARK_BINS):
        inside = np.flatnonzero(bins == b)
        number = int(np.ceil(DARK_FRACTION * inside.size))
        if number:
            dark = inside[np.argpartition(pixels[inside].sum(axis=1), number - 1)[:number]]
            ranges.append(range_m[dark])
            colors.append(pixels[dark])
    return np.concatenate(ranges), np.concatenate(colors)


def local_space_average(direct: Array, range_m: Array) -> Array:
    """Ebner's local space average color over neighbors of about the same range, doubled: the
    illuminant (Sea-thru, eqs. 14-15).

    On a grid of at most 160 columns, whose cells average with the neighbors within a tenth of the
    range's spread.
    """
    height, width = range_m.shape
    scale = min(1.0, _GRID_WIDTH / width)
    size = (max(int(width * scale), 1), max(int(height * scale), 1))
    z: Array = cv2.resize(range_m, size, interpolation=cv2.INTER_NEAREST)
    small: Array = cv2.resize(direct, size, interpolation=cv2.INTER_NEAREST)
    near = 0.1 * (np.nanmax(range_m) - np.nanmin(range_m)) + 1e-6
    small = np.where(np.isfinite(z)[..., None], small, 0.0).reshape(-1, 3)
    average, weight = small, 0.02
    cells = np.arange(z.size).reshape(z.shape)
    side = [(cells[1:], cells[:-1]), (cells[:, 1:], cells[:, :-1])]
    one, other = (np.concatenate([each[k].ravel() for each in side]) for k in (0, 1))
    joined = np.abs(z.flat[one] - z.flat[other]) < near
    rows, columns = (
        np.concatenate(ends)[np.tile(joined, 2)] for ends in ((one, other), (other, one))
    )
    number = np.maximum(np.bincount(rows, minlength=z.size), 1)
    neighbors = csr_array(((1 - weight) / number[rows], (rows, columns)), shape=(z.size, z.size))
    for _ in range(_AVERAGING_STEPS):
        average = neighbors @ average + weight * small
    average = average.reshape(*z.shape, 3)
    grown: Array = cv2.resize(2.0 * average, (width, height), interpolation=cv2.INTER_LINEAR)
    return grown


def _best_rates(
    z: Array, values: Array, number: int, basis: Callable[[Array, Array], Array]
) -> tuple[Array, Array]:
    """Fit ``values`` by least squares on a basis that depends on rates, which are searched on a
    grid of 0 to 5 per meter.

    Returns rates (number,) and weights of the basis, which are kept in [0, 1], as in the paper.
    """
    grid = np.concatenate([np.linspace(0.02, 1, 25), np.linspace(1.1, 5, 12)])
    best: tuple[float, Array, Array] | None = None
    for rates in np.stack(np.meshgrid(*[grid] * number, indexing="ij"), axis=-1).reshape(
        -1, number
    ):
        columns = basis(z, rates)
        normal = columns.T @ columns + 1e-9 * np.eye(columns.shape[1])
        weights = np.clip(np.linalg.solve(normal, columns.T @ values), 0, 1)
        error = float(((columns @ weights - values) ** 2).sum())
        if best is None or error < best[0]:
            best = (error, rates, weights)
    assert best is not None
    return best[1], best[2]


def _two_exponentials(z: Array, attenuation: Array) -> Callable[[Array], Array]:
    """a(z) = w exp(-v z) + y exp(-x z) of coarse attenuation, by least squares on what the ranges
    then are (Sea-thru, eq. 17).
    """
    step = max(1, z.size // 4000)
    z, attenuation = z[::step], np.maximum(attenuation[::step], LEAST_ATTENUATION)
    optical = attenuation * z
    grid = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2])
    best: tuple[float, Array, Array] | None = None
    for i, v in enumerate(grid):
        for x in grid[i + 1 :]:
            columns = np.stack([z * np.exp(-v * z), z * np.exp(-x * z)], axis=1)
            weights = np.linalg.solve(columns.T @ columns + 1e-9 * np.eye(2), columns.T @ optical)
            if (weights < 0).any():  # both terms fall: the better one alone
                alone = np.maximum(columns.T @ optical, 0) / (columns**2).sum(axis=0)
                errors = ((columns * alone - optical[:, None]) ** 2).sum(axis=0)
                weights = np.where(np.arange(2) == errors.argmin(), alone, 0)
            fitted = np.maximum(columns @ weights / z, LEAST_ATTENUATION)
            error = float((((optical / fitted) - z) ** 2).mean())
            if best is None or error < best[0]:
                best = (error, np.array([v, x]), weights)
    assert best is not None
    rates, weights = best[1], best[2]
    return lambda z: np.asarray(np.exp(-rates * z[:, None]) @ weights)
