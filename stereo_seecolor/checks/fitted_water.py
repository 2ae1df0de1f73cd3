"""A check for ranges that are not in meters, by the bounds that all waters keep."""

from collections.abc import Mapping

import numpy as np

from stereo_seecolor.records import Array, Water
from stereo_seecolor.water.limits import LITTLE_RELIEF

LEAST_RED = 0.115
"""1/m. What the clearest ocean takes from a camera's red: 0.11 at 25 m of depth and 7 m of range,
more near the surface and near the camera. Fitted: at least 0.122 in rendered waters of 3 kinds, 2
depths, 3 sizes of the scene; 0.25 and more in real frames (FLSea, Sea-thru, a strobe-lit reef).
With ranges 5 times too long: at most 0.099 in clear water.
"""
MOST_RED_OVER_GREEN = 0.45
"""1/m, red less green: 0.3 in pure water, and what else is in water takes at least as much from
green. Fitted, medians of dives: at most 0.28; with ranges 4 times too short in clear water, 0.3 to
0.85. Light of lamps beside the camera crosses the water twice: up to twice as much.
"""
LAMPS_FALL_OFF = 2.0
"""Power of the range by which a lamp's light falls off; less where the sun takes part."""
LEAST_RED_TO_GREEN = 0.8
"""Of attenuation: 1.26 and more in rendered waters of three kinds; with inverse ranges (60 / range)
in clear water 0.69. Inverse ranges that look like meters (2 / range) have 0.85 to 1.5: the maps
tell these themselves (``checks.range_maps``).
"""
ALIKE = 0.25
"""Of the mean: channels that differ by less may be those of a monochrome camera."""


def range_scale_notes(waters: Mapping[str, Water], given: bool) -> tuple[str, ...]:
    """A note where the ranges of the waters are probably not meters. given: not measured here."""
    different = [
        water
        for water in {id(water): water for water in waters.values()}.values()
        if not any(warning.startswith(LITTLE_RELIEF) for warning in water.warnings)
    ]
    rates = np.array([_attenuation(water) for water in different])
    if not len(rates) or np.isnan(rates).all():
        return ()
    red, green, _ = np.nanmedian(rates, axis=0)
    said = f"water: red is attenuated by {red:.2g}/m, green by {green:.2g}/m"
    if given and np.nanmedian(rates[:, 0] / rates[:, 1]) < LEAST_RED_TO_GREEN:
        return (
            f"{said}: red less than green, as only in brown water: if it was not brown, near and "
            "far are exchanged in the range maps, as in disparities and inverse depth, or "
            "red and blue in the images (input.channels)",
        )
    unit = (
        "the unit of the maps (input.range_units_per_m)"
        if given
        else "the unit and the lengths of the calibration"
    )
    factor = f"by this factor or more ({unit})"
    encoding = (
        "or the encoding of the images is wrong (color.input_encoding, another tone curve): colors "
        "alone do not show which: measure a known length"
    )
    if red + np.median([_red_std(water) for water in different]) < LEAST_RED:
        return (
            f"{said}: the clearest water attenuates red by {LEAST_RED:.2g}/m, "
            f"{LEAST_RED / red:.1f} times as much: ranges are too long {factor}, the images "
            f"were taken in air, {encoding}",
        )
    lamps = np.median([min(water.fall_off / LAMPS_FALL_OFF, 1.0) for water in different])
    apart = float(np.nanmedian(rates[:, 0] - rates[:, 1])) / (MOST_RED_OVER_GREEN * (1.0 + lamps))
    if apart > 1:
        return (
            f"{said}: {apart:.1f} times as far apart as in any water: ranges are too short "
            f"{factor}, {encoding}",
        )
    return ()


def _attenuation(water: Water) -> Array:
    """(3,) 1/m at the water's typical range; NaN where not known, and for gray images."""
    if not water.typical_range_m:
        return np.full(3, np.nan)
    rates = -np.log(water.attenuation(np.array(water.typical_range_m))) / water.typical_range_m
    return np.where(np.ptp(rates) < ALIKE * rates.mean(), np.nan, rates)


def _red_std(water: Water) -> float:
    """Standard error of red's attenuation at the water's typical range, 1/m; 0 where the fit states
    none. A short dive may leave it at more than the attenuation itself.
    """
    unknown = np.full(3, np.nan)
    # one that is unknown leaves what the other one adds
    y, w = (np.nan_to_num(water.standard_errors.get(name, unknown)[0]) for name in ("y", "w"))
    fading = np.exp(-water.v[0] * (water.typical_range_m or 0.0))
    return float(np.hypot(y, w * fading))
