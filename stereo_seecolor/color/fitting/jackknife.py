"""Standard errors of a dive's water from its parts: the water is fitted again without each part.

The errors of one fit assume how much content differs from range to range. The jackknife measures it
(Efron 1982; blocks of neighboring frames as in Kuensch, Annals of Statistics 17, 1989): frames that
follow each other show the same reef, so that blocks are left out, not frames.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting import robust
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_quantiles import quantiles_by_range
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water

LEAST, MOST = 4, 10
"""Blocks: fewer give no error worth stating, more cost time."""
NAMES = ("y", "w", "beta", "gamma_inf", "white")


def with_errors_of_parts(water: Water, tables: Sequence[MomentTable], config: ColorConfig) -> Water:
    """Give a water the errors that its parts show, where these are larger than those of the fit.

    Args:
        water: Fitted to the sum of the tables.
        tables: Of frames, or of groups of neighboring frames, in order.
        config: Settings of the color stage.

    Returns:
        The water. Errors that the fit does not state (NaN) stay unknown.
    """
    if not water.standard_errors or config.method != "robust" or len(tables) < LEAST:
        return water
    shown = _block_errors(water, tables, config)
    errors = {
        name: np.where(np.isfinite(error), np.fmax(error, shown.get(name, error)), np.nan)
        for name, error in water.standard_errors.items()
    }
    return replace(water, standard_errors=errors)


def _block_errors(
    water: Water, tables: Sequence[MomentTable], config: ColorConfig
) -> dict[str, NDArray[np.float64]]:
    """(3,) errors of each parameter; of the white point those of its color."""
    blocks = [
        reduce(add, tables[part[0] : part[-1] + 1])
        for part in np.array_split(np.arange(len(tables)), min(len(tables), MOST))
    ]
    rest = [
        quantiles_by_range(reduce(add, [*blocks[:i], *blocks[i + 1 :]]), config.encoding)
        for i in range(len(blocks))
    ]
    waters, _ = robust.fit_all(rest, config, [water] * len(rest), robust.ENOUGH)
    values = np.array([[getattr(one, name) for name in NAMES] for one in waters])
    white = np.log(values[:, 4])
    values[:, 4] = (white - white.mean(axis=1, keepdims=True)) * water.white
    number = len(blocks)
    errors = np.sqrt((number - 1) * values.var(axis=0))
    return dict(zip(NAMES, errors, strict=True))
