"""Named waters: wide-band attenuation, backscatter and sunlight by depth, from published spectra.

Diffuse attenuation Kd by wavelength: Jerlov, Marine Optics (1976), table XXVII, with Austin and
Petzold's revision (1984) for types I to 1C. Beam attenuation c along the line of sight: Kd(535 nm)
= 0.2 c(535 nm) + 0.04 (Shannon, Proc. SPIE 64, 1975); the difference c - Kd is scattering and taken
as flat in wavelength.
Most of it goes forward by less than a degree and still lands near its pixel, so what an image loses
lies between Kd and c (Akkaynak et al., CVPR 2017): Kd and a fifth of the scattering here. Wide-band
coefficients are what a camera's channel sees of the spectrum, so they fall with range (same paper).
Veiling light at infinity is b E / c (Akkaynak and Treibitz, CVPR 2018, eq. 9).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import PerChannel, Water
from stereo_seecolor.water.jerlov import KD_JERLOV, KD_REVISED, TABLE_NM, Spectrum, scattering_per_m

WaterName = Literal["blue-ocean", "coastal-green", "turbid"]

_KD: dict[WaterName, Spectrum] = {
    "blue-ocean": KD_REVISED["IB"],
    "coastal-green": KD_REVISED["1C"],
    "turbid": KD_JERLOV["5C"],
}
WATER_NAMES: tuple[WaterName, ...] = tuple(_KD)

_WAVELENGTH_NM = np.arange(400.0, 701.0, 5.0)
# Peaks and widths of a machine-vision sensor's R, G, B filters, about the mean of the 28 cameras of
# Jiang et al. (WACV 2013).
_CHANNELS = np.exp(
    -0.5
    * (
        (_WAVELENGTH_NM - np.array([[610.0], [535.0], [460.0]]))
        / np.array([[26.0], [36.0], [28.0]])
    )
    ** 2
)
_LOST_FRACTION_OF_SCATTERING = 0.2
# of the scattered sunlight, what reaches a camera as veiling light; sets its level, not its color
_VEILING_FRACTION = 0.06
_FITTED_RANGE_M = np.linspace(0.5, 6.0, 23)


@dataclass(frozen=True, eq=False)
class LitWater:
    """A water and the sunlight in it.

    water: COLOR.md's model; its white point is the light at ``depth_m``. depth_m: depth below the
    surface that ``water`` is for.
    sun_attenuation: (3,) 1/m, how the light that arrives falls off with depth around ``depth_m``.
    """

    water: Water
    depth_m: float
    sun_attenuation: PerChannel


def lit_water(
    name: WaterName,
    depth_m: float,
    camera_depth_m: float,
    exposure_range_m: float,
    lamps: float = 0.0,
    encoding: Literal["srgb", "linear"] = "srgb",
) -> LitWater:
    """The named water over a bottom at ``depth_m``, seen from ``camera_depth_m``.

    Exposure is set as a camera would: a white patch at ``exposure_range_m`` just fits its brightest
    channel, with ``lamps`` times the sun's light added, and the veil before it does not take it
    beyond full scale. encoding: of the images; the water itself acts in linear light.
    """
    kd = np.interp(_WAVELENGTH_NM, TABLE_NM, _KD[name])
    scattering = scattering_per_m(_KD[name])
    beam = kd + _LOST_FRACTION_OF_SCATTERING * scattering
    sunlight = np.exp(-kd * depth_m)

    rate, decay = _falling_rate(_transmission(beam, sunlight))
    veiling_spectrum = _VEILING_FRACTION * np.exp(-kd * camera_depth_m) * scattering / beam
    beta, zero = _saturating_rate(beam, veiling_spectrum), np.zeros(3)
    patch = (1.0 + lamps) * _band(sunlight * np.exp(-beam * exposure_range_m))
    veil = _band(veiling_spectrum) * -np.expm1(-beta * exposure_range_m)
    exposure = min(0.95 / patch.max(), 1.0 / (patch + veil).max())
    water = Water(
        gamma_inf=exposure * _band(veiling_spectrum),
        beta=beta,
        eta=zero,
        alpha=np.ones(3),
        w=rate,
        v=decay,
        y=zero,
        x=zero,
        white=exposure * _band(sunlight),
        input_encoding=encoding,
    )
    deeper = _band(sunlight * np.exp(-0.5 * kd))
    return LitWater(water, depth_m, 2.0 * np.log(_band(sunlight) / deeper))


def _band(spectrum: Spectrum) -> PerChannel:
    """(3,) what each channel sees of a spectrum, 1 for a flat one."""
    return np.asarray(_CHANNELS @ spectrum / _CHANNELS.sum(axis=1))


def _transmission(beam: Spectrum, light: Spectrum) -> NDArray[np.float64]:
    """(K, 3) fraction of the light that each channel still sees after each of the fitted ranges."""
    return np.stack([_band(light * np.exp(-beam * z)) / _band(light) for z in _FITTED_RANGE_M])


def _falling_rate(transmission: NDArray[np.float64]) -> tuple[PerChannel, PerChannel]:
    """w, v of a(z) = w exp(-v z): least squares on log a, which is nearly straight in z."""
    log_rate = np.log(-np.log(transmission) / _FITTED_RANGE_M[:, None])
    slope, intercept = np.polyfit(_FITTED_RANGE_M, log_rate, 1)
    return np.exp(intercept), np.maximum(-slope, 0.0)


def _saturating_rate(beam: Spectrum, veiling: Spectrum) -> PerChannel:
    """beta of 1 - exp(-beta z), matched where the veil is about half way (z = 1.5 m)."""
    z = 1.5
    reached = _band(veiling * -np.expm1(-beam * z)) / _band(veiling)
    return np.asarray(-np.log1p(-reached) / z)
