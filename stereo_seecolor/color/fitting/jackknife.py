"""Standard errors of the water of a dive: the water is fitted again without each part of the dive.

The errors of one fit assume how much the scene differs between ranges. The jackknife measures it
(Efron 1982; blocks of neighboring frames as in Kuensch, Annals of Statistics 17, 1989). Blocks are
left out, not frames, because consecutive frames show the same reef.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.resampling import jackknife
from stereo_seecolor.color.fitting import robust
from stereo_seecolor.color.fitting.robust import COLOR_AXES, NAMES
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_quantiles import RangeQuantiles, quantiles_by_range
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water

LEAST, MOST = 4, 10
"""Least and most blocks: with fewer the error is not reliable, more take time."""
LEAST_VARIANCE = 1e-12
"""Least variance of a logarithm: stated errors may be impossible for numbers that sum to 0."""


def with_errors_of_blocks(
    water: Water, whole: MomentTable, blocks: Iterable[MomentTable], config: ColorConfig
) -> Water:
    """Set the standard errors of a water to the jackknife errors, where these are larger; unknown
    errors (NaN) stay unknown. whole: the table that it was fitted to, the sum of the blocks.
    blocks: tables of neighboring frames, at most MOST, one at a time.
    """
    if not water.standard_errors or config.method != "robust":
        return water
    others = (whole - block for block in blocks)
    rest = [quantiles_by_range(other, config.encoding) for other in others if other.pixels.any()]
    if len(rest) < LEAST:
        return water
    shown = _errors(water, rest, config)
    errors = {
        name: np.where(np.isfinite(error), np.fmax(error, shown[name]), np.nan)
        for name, error in water.standard_errors.items()
    }
    of_color = water.standard_errors["white"] / water.white
    if np.isfinite(of_color).all():
        errors["white"] = water.white * _larger(of_color, shown["white"] / water.white)
    return replace(water, standard_errors=errors)


def _larger(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) errors of colors, logarithms that sum to 0, for the least covariance that exceeds those
    of both along every axis of color.
    """
    square, axes = np.linalg.eigh(_of_colors(one))
    root = axes * np.sqrt(np.maximum(square, LEAST_VARIANCE))
    size, axes = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, _of_colors(other)).T))
    both = COLOR_AXES @ root @ axes
    return np.asarray(np.sqrt(both**2 @ np.maximum(size, 1.0)))


def _of_colors(error: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 2) covariance along COLOR_AXES of three logarithms that sum to 0, from their errors."""
    square = error**2
    covariance = square.sum() / 2 - square - square[:, None]
    np.fill_diagonal(covariance, square)
    return np.asarray(COLOR_AXES.T @ covariance @ COLOR_AXES)


def _errors(
    water: Water, rest: Sequence[RangeQuantiles], config: ColorConfig
) -> dict[str, NDArray[np.float64]]:
    """(3,) errors of each parameter from the fits without each block; of white, those of color."""
    waters, _ = robust.fit_all(rest, config, [water] * len(rest))
    values = np.array([[getattr(one, name) for name in NAMES] for one in waters])
    white = np.log(values[:, 4])
    values[:, 4] = (white - white.mean(axis=1, keepdims=True)) * water.white
    return dict(zip(NAMES, jackknife(values), strict=True))
