"""Waters built from published measurements of their absorption and scattering, for judging color
methods.

The prior of the fit and the waters of the synthetic dives stem from Jerlov's tables. Nothing here
does: absorption and scattering are the sums of what pure seawater, phytoplankton, dissolved matter
and suspended sediment were measured to add, and every wavelength goes through the water on its own
before a camera sums it up.

Sources: Pope and Fry 1997, Appl. Opt. 36, 8710 (absorption of pure water, table 3); Morel 1974, in
Optical Aspects of Oceanography (scattering of pure seawater); Bricaud et al. 1998, J. Geophys. Res.
103, 31033 (phytoplankton); Loisel and Morel 1998, Limnol. Oceanogr. 43, 847, as in Morel and
Maritorena 2001, J. Geophys. Res. 106, 7163 (particle scattering of the open ocean); Babin et al.
2003, J. Geophys. Res. 108, 3211 (slopes of dissolved and non-algal matter) and Limnol. Oceanogr.
48, 843 (scattering by sediment); Petzold 1972, SIO Ref. 72-78 (backscattered fraction); Gordon
1989, Limnol. Oceanogr. 34, 1389 (diffuse attenuation).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import PerChannel

MeasuredWatersSpectrum = NDArray[np.float64]
"""(31,) at WAVELENGTH_NM."""
Kind = Literal["ocean", "coast", "harbor"]

WAVELENGTH_NM = np.arange(400.0, 701.0, 10.0)
# fmt: off
WATER_ABSORPTION = np.array([
    0.00663, 0.00473, 0.00454, 0.00495, 0.00635, 0.00922, 0.00979, 0.0106, 0.0127, 0.0150, 0.0204,
    0.0325, 0.0409, 0.0434, 0.0474,
    0.0565, 0.0619, 0.0695, 0.0896, 0.1351, 0.2224, 0.2644, 0.2755, 0.2916, 0.3108, 0.340, 0.410,
    0.439, 0.465, 0.516, 0.624,
])
"""1/m, pure water: Pope and Fry 1997."""
PHYTOPLANKTON_FACTOR = np.array([
    0.0241, 0.0287, 0.0328, 0.0359, 0.0378, 0.0350, 0.0328, 0.0309, 0.0281, 0.0254, 0.0210, 0.0162,
    0.0126, 0.0103, 0.0085, 0.0070,
    0.0057, 0.0050, 0.0051, 0.0054, 0.0052, 0.0055, 0.0061, 0.0066, 0.0071, 0.0078, 0.0108, 0.0174,
    0.0161, 0.0069, 0.0025,
])
"""1/m at 1 mg chlorophyll a in a cubic meter: A of a = A Chl^E, Bricaud et al. 1998."""
PHYTOPLANKTON_EXPONENT = np.array([
    0.6877, 0.6834, 0.6664, 0.6478, 0.6266, 0.5993, 0.5961, 0.5970, 0.5890, 0.6074, 0.6529, 0.7212,
    0.7939, 0.8500, 0.9036, 0.9312,
    0.9345, 0.9298, 0.8933, 0.8589, 0.8410, 0.8548, 0.8704, 0.8638, 0.8524, 0.8155, 0.8233, 0.8138,
    0.8284, 0.9255, 1.0286,
])
"""E of the same."""
# fmt: on
AT_440 = 4
"""Where 440 nm stands in a spectrum."""


@dataclass(frozen=True)
class OpticalConstants:
    """Absorption and scattering of the water's constituents, from the sources above."""

    dissolved_slope: float = 0.0176  # 1/nm, mean of European coasts; Babin et al. 2003
    sediment_slope: float = 0.0123  # 1/nm, non-algal particles; the same
    # m^2/g at 555 nm, mean of coastal waters, nearly flat in wavelength; Babin et al. 2003
    sediment_scattering: float = 0.5
    water_scattering: float = 0.00288  # 1/m at 500 nm, seawater; Morel 1974
    water_scattering_exponent: float = -4.32  # the same
    # 1/m at 550 nm and 1 mg/m^3, falling with wavelength; Loisel and Morel 1998
    algae_scattering: float = 0.416
    algae_scattering_exponent: float = 0.766  # of chlorophyll; the same
    # backscattered fraction of molecules, which scatter forward and back alike
    water_back: float = 0.5
    # of particles, mean of Petzold's waters; Mobley 1994, Light and Water
    particle_back: float = 0.0183
    diffuse: float = 1.0395  # Kd cos(angle) / (a + b_b); Gordon 1989
    refractive_index: float = 1.34  # seawater


CONSTANTS = OpticalConstants()


@dataclass(frozen=True)
class Contents:
    """The constituents of a water.

    chlorophyll: mg/m^3. dissolved: absorption of dissolved matter at 440 nm, 1/m. sediment: g/m^3.
    sediment_absorption: m^2/g at 440 nm.
    """

    chlorophyll: float
    dissolved: float
    sediment: float = 0.0
    sediment_absorption: float = 0.04

    @property
    def absorption(self) -> MeasuredWatersSpectrum:
        """a, 1/m."""
        beyond_nm = WAVELENGTH_NM - WAVELENGTH_NM[AT_440]
        dissolved = self.dissolved * np.exp(-CONSTANTS.dissolved_slope * beyond_nm)
        sediment = (
            self.sediment * self.sediment_absorption * np.exp(-CONSTANTS.sediment_slope * beyond_nm)
        )
        return np.asarray(WATER_ABSORPTION + phytoplankton(self.chlorophyll) + dissolved + sediment)

    @property
    def scattering(self) -> tuple[MeasuredWatersSpectrum, MeasuredWatersSpectrum]:
        """b of the water's molecules and of particles, 1/m."""
        of = CONSTANTS
        water = of.water_scattering * (WAVELENGTH_NM / 500.0) ** of.water_scattering_exponent
        algae = (
            of.algae_scattering
            * self.chlorophyll**of.algae_scattering_exponent
            * 550.0
            / WAVELENGTH_NM
        )
        return water, algae + of.sediment_scattering * self.sediment

    @property
    def backscattering(self) -> MeasuredWatersSpectrum:
        """b_b, 1/m."""
        water, particles = self.scattering
        return CONSTANTS.water_back * water + CONSTANTS.particle_back * particles

    def diffuse_attenuation(self, sun_zenith_deg: float) -> MeasuredWatersSpectrum:
        """K_d of daylight from a sun at that angle above the water, 1/m."""
        sine = np.sin(np.radians(sun_zenith_deg)) / CONSTANTS.refractive_index
        return np.asarray(
            CONSTANTS.diffuse * (self.absorption + self.backscattering) / np.sqrt(1 - sine**2)
        )


def phytoplankton(chlorophyll: float) -> MeasuredWatersSpectrum:
    """Absorption by phytoplankton, 1/m."""
    return np.asarray(PHYTOPLANKTON_FACTOR * chlorophyll**PHYTOPLANKTON_EXPONENT)


@dataclass(frozen=True, eq=False)
class SpectralWater:
    """A water, the daylight in it and a camera; what the camera sees, without any model of a
    channel's light over range.

    bands: (3, 31) the camera's sensitivities, each with sum 1; balanced for daylight at the
    surface, which is taken as flat.
    light: (31,) the daylight that the scene gets. beam: (31,) 1/m, what is lost on the way from the
    scene to the camera.
    veil: (31,) the water's own light, before a camera that looks into the distance.
    """

    bands: NDArray[np.float64]
    light: MeasuredWatersSpectrum
    beam: MeasuredWatersSpectrum
    veil: MeasuredWatersSpectrum

    @property
    def white(self) -> PerChannel:
        """The channels' values of a white scene without water."""
        return np.asarray(self.bands @ self.light)

    def attenuation(self, range_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Compute the fraction of a channel's light that is left after a range, meters: (...,
        3).
        """
        left = np.exp(-np.asarray(range_m, np.float64)[..., None] * self.beam)
        return np.asarray(left @ (self.bands * self.light / self.white[:, None]).T)

    def backscatter(self, range_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Compute the backscatter over a range, meters: (..., 3)."""
        gained = -np.expm1(-np.asarray(range_m, np.float64)[..., None] * self.beam)
        return np.asarray(gained @ (self.bands * self.veil).T)


def draw_contents(kind: Kind, rng: np.random.Generator) -> Contents:
    """A water of a kind. In the open ocean, dissolved matter follows chlorophyll (Morel and
    Maritorena 2001).
    """
    if kind == "ocean":
        chlorophyll = _between(0.03, 0.5, rng)
        algae = float(phytoplankton(chlorophyll)[AT_440])
        return Contents(chlorophyll, 0.2 * (float(WATER_ABSORPTION[AT_440]) + algae))
    if kind == "coast":
        return Contents(
            _between(0.3, 3.0, rng),
            _between(0.02, 0.2, rng),
            _between(0.05, 1.0, rng),
            _between(0.02, 0.06, rng),
        )
    return Contents(
        _between(2.0, 10.0, rng),
        _between(0.15, 0.6, rng),
        _between(0.5, 4.0, rng),
        _between(0.02, 0.06, rng),
    )


def draw_water(contents: Contents, rng: np.random.Generator) -> SpectralWater:
    """Daylight at some depth and sun, seen by some camera; at most 12 m deep, or where a twentieth
    of the best light is left.

    Of the light that particles scatter most goes forward and still lands near its pixel: a fifth to
    all of it counts as lost. The veil has the color of the daylight that is scattered back, and a
    level of 3 to 30 % of a white scene's brightest channel.
    """
    diffuse = contents.diffuse_attenuation(rng.uniform(0.0, 60.0))
    light = np.exp(-diffuse * rng.uniform(0.5, min(12.0, 3.0 / diffuse.min())))
    water, particles = contents.scattering
    beam = contents.absorption + water + rng.uniform(0.2, 1.0) * particles
    bands = camera_bands(rng)
    veil = light * contents.backscattering / beam
    veil *= _between(0.03, 0.3, rng) * (bands @ light).max() / (bands @ veil).max()
    return SpectralWater(bands, light, beam, veil)


def camera_bands(rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw sensitivities of R, G, B, (3, 31), each with sum 1: Gaussians around the cameras of
    Jiang et al., WACV 2013.
    """
    peaks_nm = np.array([602.0, 535.0, 460.0]) + rng.normal(0, 8.0, 3)
    widths_nm = np.array([30.0, 36.0, 29.0]) + rng.normal(0, 4.0, 3)
    bands = np.exp(-0.5 * ((WAVELENGTH_NM - peaks_nm[:, None]) / widths_nm[:, None]) ** 2)
    return np.asarray(bands / bands.sum(axis=1, keepdims=True))


def _between(low: float, high: float, rng: np.random.Generator) -> float:
    """Drawn evenly in logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
