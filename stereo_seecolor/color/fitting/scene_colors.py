"""Colors of the sea floor, from which the prior of the robust fit is computed.

The colors are those of cameras, without water, for scenes mixed from published reflectance spectra.
``benchmarks/spectra.py`` computes them and writes ``scene_colors.json``.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.json_records import load_object

Array = NDArray[np.float64]
COLORS = Path(__file__).with_name("scene_colors.json")


@dataclass(frozen=True, eq=False)
class SceneColors:
    """Logarithms of R, G, B less their mean, at the nine quantiles of the sea floor.

    mean: (3, 9). channels: (3, 3) covariance of the channels at one quantile, mean over quantiles,
    relative to the variance along the axis from warm to cool (R up, B down): from green to magenta
    colors vary less. cast: (3, 3) covariance of the part that all quantiles of a scene share.
    """

    mean: Array
    channels: Array
    cast: Array


@lru_cache
def sea_floor() -> SceneColors:
    """Read the colors of all spectra."""
    kept = load_object(COLORS)
    return SceneColors(*(np.array(kept[name]) for name in ("mean", "channels", "cast")))
