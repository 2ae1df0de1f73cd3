"""The change of the color of one spot with range: a second measurement of the water.

The fit compares near with far pixels, and mistakes a color difference between near corals and far
sand for an effect of the water. A spot that is visible from two ranges has one color.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import LUMINANCE
from stereo_seecolor.records import Water

Array = NDArray[np.float64]

SYSTEMATIC = 0.25
"""Systematic error of a trend, as a power of the range: gains and pattern explain part of it, or
add to it. On synthetic dives with lamps the error is up to 0.4, while the scatter of the
observations implies 0.05 to 0.15.
"""
MOST_BACKSCATTER = 0.8
"""Fraction of backscatter in a channel; spots with more say nothing about attenuation."""


@dataclass(frozen=True, eq=False)
class ColorTrend:
    """power: (3,) R, G, B of a spot are proportional to range to this power, times a common factor;
    mean 0. error: standard error of each. range_m: range of the measurement. light: (3,) of a spot
    there.
    """

    power: Array
    error: float
    range_m: float
    light: Array

    def content(self) -> dict[str, Any]:
        """Convert to JSON."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_content(cls, content: Any) -> "ColorTrend":
        """Convert from JSON. Raises ValueError, KeyError or TypeError for other content."""
        power, light = (
            np.array(content[name], np.float64).reshape(3) for name in ("power", "light")
        )
        return cls(power, float(content["error"]), float(content["range_m"]), light)


def with_color_trend(water: Water, trend: ColorTrend | None) -> Water:
    """Combine attenuations of water and trend: their mean, weighted by variance; colors at the
    range of the trend do not change. Brightness is unchanged, because lamps contribute to it.
    Waters of the paper's method are unchanged.
    """
    if trend is None or water.x.any():
        return water
    z, light, steps = trend.range_m, trend.light, np.array([0.99, 1.0, 1.01])
    attenuation, backscatter = water.attenuation(z * steps), water.backscatter(z * steps)
    direct = light - np.minimum(backscatter[1], MOST_BACKSCATTER * light)
    near, _, far = direct * attenuation / attenuation[1] + backscatter
    power = (far - near) / light / np.log(steps[2] / steps[0])
    off = (trend.power - (power - power.mean())) * light / direct
    variance = (
        np.nan_to_num(water.standard_errors.get("y", np.full(3, np.nan)) * z, nan=np.inf) ** 2
    )
    error = np.hypot(trend.error, SYSTEMATIC) * light / direct
    taken = off / (1.0 + error**2 / variance)
    y = np.maximum(water.y - (taken - taken @ LUMINANCE) / z, np.maximum(-water.w, 0.0))
    return replace(water, y=y, white=water.white * np.exp((y - water.y) * z))
