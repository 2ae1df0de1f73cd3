"""The prior of the water: daylight that passed through Jerlov's water types, down to the reef and
on to the camera.

The equations of image formation (Akkaynak and Treibitz, CVPR 2018) convert spectra of many waters,
depths and cameras to the fifteen parameters of the model. The prior is the Gaussian of these. So
for a scene with little relief, the fit gives a water that exists, and a white point that such
waters transmit.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.water.jerlov import KD_JERLOV, TABLE_NM, scattering_per_m

Vector = NDArray[np.float64]

WATER = 15
"""Parameters: log far, log(near / far), log beta, log(gamma_inf / white), log white; R, G, B."""

_KD = np.stack(list(KD_JERLOV.values()))  # from the clearest ocean to turbid coast
WAVELENGTH_NM = np.arange(400.0, 701.0, 10.0)
_RANGE_M = np.array([0.5, 1.0, 2.0, 3.5, 5.5, 8.0])
RATE_OF_CHANGE = 0.25
"""1/m: attenuation changes from near to far over 4 m."""
LARGEST_LOG_NEAR = float(np.log1p(np.exp(2.0)))
"""Of log(near / far): up to near = (1 + e^2) far, 8.4 times far, less light arrives from farther
away. The optical depth z (far + (near - far) exp(-z RATE_OF_CHANGE)) grows by far + (near - far)
(1 - u) exp(-u) a meter, u = z RATE_OF_CHANGE, which is least at u = 2.
"""


@dataclass(frozen=True)
class Ensemble:
    """The waters, depths and cameras from which the Gaussian of the prior is computed."""

    samples: int = 256
    """Twice as many change means by at most a fiftieth of their standard deviations."""
    deepest_m: float = 15.0
    """Largest depth of the scene below the surface, if it is unknown,"""
    most_optical_depth: float = 2.0
    """if daylight has at most this optical depth there in its clearest channel: at larger depths
    divers use lamps.
    """
    least_scattering_per_m: float = 0.02
    """Scattering of the clearest water type, for which the table has nearly none."""
    beam_scattering: float = 0.4
    """Largest fraction of scattering that an image loses: most light is scattered by small angles.
    """
    peaks_nm: tuple[float, float, float] = (605.0, 535.0, 460.0)
    """Peaks of the filters R, G, B (Jiang et al., WACV 2013, their 28 cameras)."""
    widths_nm: tuple[float, float, float] = (30.0, 35.0, 30.0)
    """Standard deviations of the filters (the same)."""
    peak_nm: float = 15.0
    """Largest difference of a camera's peaks from these: a choice."""
    width_fraction: float = 0.2
    """Largest difference of a camera's widths from these, as a fraction: a choice."""
    lit_above_m: float = 1.0
    """The water between camera and bottom is lit as at a depth of at most this above the bottom."""
    scattering_reference_nm: float = 535.0
    """Wavelength of the stated scattering by particles, which follows a power of 0 to -1."""
    gamma_inf: tuple[float, float] = (0.02, 12.0)
    """Least backscatter relative to the white point, and the factor from least to most."""
    seen_at_m: float = 2.0
    """Range at which one rate replaces the backscatter of a spectrum."""


@dataclass(frozen=True)
class LeftOut:
    """Standard deviations of logarithms, for variations that the ensemble does not contain."""

    rate_all: float = 0.4
    """Attenuation and backscatter rates of all channels together."""
    rate: float = 0.6
    """Both rates of a channel."""
    far: float = 0.1
    """The attenuation of a channel, independent of its backscatter rate."""
    beta: float = 0.2
    """The backscatter rate of a channel, independent of its attenuation."""
    near: float = 0.5
    """Near attenuation relative to far."""
    gamma_inf_all: float = 0.5
    """Backscatter far away, all channels together."""
    gamma_inf: float = 0.3
    """Backscatter far away, of a channel."""
    white: float = 0.15
    """White point of a channel: a camera's own balance."""
    exposure: float = 2.0
    """White point of all channels together: the exposure is unknown."""


ENSEMBLE, LEFT_OUT = Ensemble(), LeftOut()


@lru_cache
def water_prior(depth_m: float | None = None) -> tuple[Vector, Vector]:
    """Compute mean (15,) and covariance (15, 15) of log far, log(near / far), log beta,
    log(gamma_inf / white), log white, each R, G, B.

    a_c(z) = far + (near - far) exp(-z RATE_OF_CHANGE). White is determined up to the exposure,
    which has a wide distribution.

    Args:
        depth_m: Depth of the scene below the surface, m; None = any depth from the surface to where
            little red remains.
    """
    samples = np.stack([_water(draw, depth_m) for draw in low_discrepancy(ENSEMBLE.samples, 10)])
    return samples.mean(axis=0), np.cov(samples.T) + _left_out()


def _left_out() -> NDArray[np.float64]:
    """(15, 15) the covariance that the ensemble does not explain."""
    every, each = np.ones((3, 3)), np.eye(3)
    out = np.zeros((5, 3, 5, 3))
    for i in (0, 2):  # attenuation and backscatter are lost to the same water
        for j in (0, 2):
            out[i, :, j] = LEFT_OUT.rate_all**2 * every + LEFT_OUT.rate**2 * each
    out[0, :, 0] += LEFT_OUT.far**2 * each
    out[1, :, 1] += LEFT_OUT.near**2 * each
    out[2, :, 2] += LEFT_OUT.beta**2 * each
    out[3, :, 3] += LEFT_OUT.gamma_inf_all**2 * every + LEFT_OUT.gamma_inf**2 * each
    out[4, :, 4] += LEFT_OUT.white**2 * each + LEFT_OUT.exposure**2 * every
    return out.reshape(15, 15)


def _water(draw: Vector, depth_m: float | None) -> Vector:
    """(15,) parameters of one water, from (10,) draws in [0, 1)."""
    at = draw[0] * (len(_KD) - 1)
    table = _KD[int(at)] * (1 - at % 1) + _KD[int(at) + 1] * (at % 1)
    kd = np.interp(WAVELENGTH_NM, TABLE_NM, table)
    scattering = max(scattering_per_m(table), ENSEMBLE.least_scattering_per_m)
    beam = kd + ENSEMBLE.beam_scattering * draw[1] * scattering
    if depth_m is None:
        depth_m = draw[2] * min(ENSEMBLE.deepest_m, ENSEMBLE.most_optical_depth / kd.min())
    sunlight = np.exp(-kd * depth_m)
    channels = random_camera(draw[3:7])
    white = channels @ sunlight
    transmission = np.exp(-np.outer(_RANGE_M, beam)) * sunlight @ channels.T / white
    fall, far = np.polyfit(
        np.exp(-RATE_OF_CHANGE * _RANGE_M), -np.log(transmission) / _RANGE_M[:, None], 1
    )
    above = np.exp(kd * 2 * ENSEMBLE.lit_above_m * (draw[7] - 0.5))
    power = (WAVELENGTH_NM / ENSEMBLE.scattering_reference_nm) ** -draw[8]
    scattered = sunlight * above * power * scattering / beam
    backscatter = channels @ scattered
    reached = channels @ (scattered * -np.expm1(-ENSEMBLE.seen_at_m * beam)) / backscatter
    log_white = np.log(white)
    least, most = np.log(ENSEMBLE.gamma_inf)
    log_backscatter = np.log(backscatter) - log_white + least + draw[9] * most
    return np.concatenate(
        [
            np.log(far),
            np.log1p(fall / far),
            np.log(-np.log1p(-reached) / ENSEMBLE.seen_at_m),
            log_backscatter,
            log_white - log_white.mean(),
        ]
    )


def random_camera(draw: Vector) -> NDArray[np.float64]:
    """(3, wavelengths) filters of unit sum. draw: (4,) random numbers in [0, 1), for peaks and
    widths.
    """
    peaks = ENSEMBLE.peaks_nm + ENSEMBLE.peak_nm * (2 * draw[:3] - 1)
    widths = np.array(ENSEMBLE.widths_nm) * (
        1 - ENSEMBLE.width_fraction + 2 * ENSEMBLE.width_fraction * draw[3]
    )
    filters = np.exp(-0.5 * ((WAVELENGTH_NM - peaks[:, None]) / widths[:, None]) ** 2)
    return np.asarray(filters / filters.sum(axis=1, keepdims=True))


def low_discrepancy(number: int, dimensions: int) -> NDArray[np.float64]:
    """(number, dimensions) points that fill the unit cube uniformly (Kronecker's sequence)."""
    ratio = 1.5
    for _ in range(40):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, number + 1)[:, None] * steps) % 1.0)
