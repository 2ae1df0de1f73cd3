"""Colors of the sea floor, and the prior of the robust fit that is made of them.

The colors are what cameras see, without water, of scenes that are mixed from published reflectance
spectra. They are kept in ``scene_colors.json``, which ``benchmarks/spectra.py`` makes.
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

    mean: (3, 9). channels: (3, 3) covariance of the channels at one quantile, the mean over
    quantiles, against the variance along the axis from warm to cool (R up, B down): from green to
    magenta a color varies less. cast: (3, 3) covariance of what all quantiles of a scene have in
    common.
    """

    mean: Array
    channels: Array
    cast: Array


@lru_cache
def sea_floor() -> SceneColors:
    """The kept colors of all spectra."""
    kept = load_object(COLORS)
    return SceneColors(*(np.array(kept[name]) for name in ("mean", "channels", "cast")))
