"""What is known of water before any image: daylight that came down through Jerlov's water types and on to the camera, as a prior.

Spectra of many waters, depths and cameras are put through the equations of image formation (Akkaynak and Treibitz, CVPR 2018),
each becomes the fifteen numbers of the model, and the prior is the Gaussian of these. So a fit that sees little relief leans on
water that exists, and a white point on light that such water lets through.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.jerlov import KD_JERLOV, TABLE_NM, scattering_per_m

Vector = NDArray[np.float64]

_KD = np.stack(list(KD_JERLOV.values()))  # from the clearest ocean to turbid coast
_WAVELENGTH_NM = np.arange(400.0, 701.0, 10.0)
_PEAKS_NM, _WIDTHS_NM = np.array([605.0, 535.0, 460.0]), np.array([30.0, 35.0, 30.0])  # Jiang et al., WACV 2013, their 28 cameras
_RANGE_M = np.array([0.5, 1.0, 2.0, 3.5, 5.5, 8.0])
RATE_OF_CHANGE = 0.25
"""1/m: over 4 m a coefficient goes from near to far. Any light stays monotone in range while near is below 8 times far."""
_SAMPLES = 256
_DEEPEST_M = 15.0


_ALL_RATES, _RATE, _FAR, _BETA, _NEAR, _VEIL, _VEIL_CHANNEL, _WHITE, _EXPOSURE = 0.4, 0.6, 0.1, 0.2, 0.5, 0.5, 0.3, 0.15, 2.0
"""Standard deviations of what the ensemble leaves out (logarithms): rates of all channels together, of a channel, of its
attenuation and backscatter apart; near attenuation against far; the veil of all channels and of one; the white point of a
channel (a camera's own balance); the exposure."""


@lru_cache
def water_prior(depth_m: float | None = None) -> tuple[Vector, Vector]:
    """Mean (15,) and covariance (15, 15) of log far, log(near / far), log beta, log(gamma_inf / white), log white, each R, G, B.

    a_c(z) = far + (near - far) exp(-z RATE_OF_CHANGE). White is known up to the exposure, which is given a wide spread.
    depth_m: how far below the surface the scene lies, where known; else anything from the surface to where little red is left.
    """
    samples = np.stack([_water(draw, depth_m) for draw in _low_discrepancy(_SAMPLES, 10)])
    return samples.mean(axis=0), np.cov(samples.T) + _left_out()


def _left_out() -> NDArray[np.float64]:
    """(15, 15) the covariance that the ensemble does not explain."""
    every, each = np.ones((3, 3)), np.eye(3)
    out = np.zeros((5, 3, 5, 3))
    for i in (0, 2):  # attenuation and backscatter are lost to the same water
        for j in (0, 2):
            out[i, :, j] = _ALL_RATES**2 * every + _RATE**2 * each
    out[0, :, 0] += _FAR**2 * each
    out[1, :, 1] += _NEAR**2 * each
    out[2, :, 2] += _BETA**2 * each
    out[3, :, 3] += _VEIL**2 * every + _VEIL_CHANNEL**2 * each
    out[4, :, 4] += _WHITE**2 * each + _EXPOSURE**2 * every
    return out.reshape(15, 15)


def _water(draw: Vector, depth_m: float | None) -> Vector:
    """Fifteen numbers of one water from ten draws in [0, 1)."""
    at = draw[0] * (len(_KD) - 1)
    table = _KD[int(at)] * (1 - at % 1) + _KD[int(at) + 1] * (at % 1)
    kd = np.interp(_WAVELENGTH_NM, TABLE_NM, table)
    scattering = max(scattering_per_m(table), 0.02)
    beam = kd + 0.4 * draw[1] * scattering  # most of what is scattered goes on nearly straight, and is not lost to an image
    depth_m = draw[2] * min(_DEEPEST_M, 2.0 / kd.min()) if depth_m is None else depth_m
    sunlight = np.exp(-kd * depth_m)
    channels = _channels(draw[3:7])
    white = channels @ sunlight
    transmission = np.exp(-np.outer(_RANGE_M, beam)) * sunlight @ channels.T / white
    fall, far = np.polyfit(np.exp(-RATE_OF_CHANGE * _RANGE_M), -np.log(transmission) / _RANGE_M[:, None], 1)
    above = np.exp(kd * 2 * (draw[7] - 0.5))  # the veil is lit at the depth of the water between, within a meter of the bottom's
    veil_spectrum = sunlight * above * (_WAVELENGTH_NM / 535.0) ** -draw[8] * scattering / beam
    veil = channels @ veil_spectrum
    reached = channels @ (veil_spectrum * -np.expm1(-2.0 * beam)) / veil
    log_white = np.log(white)
    log_veil = np.log(veil) - log_white + np.log(0.02) + draw[9] * np.log(12.0)
    return np.concatenate(
        [np.log(far), np.log1p(fall / far), np.log(-np.log1p(-reached) / 2.0), log_veil, log_white - log_white.mean()]
    )


def _channels(draw: Vector) -> NDArray[np.float64]:
    """(3, wavelengths) a camera's filters, of unit sum; peaks and widths a little off the usual."""
    peaks = _PEAKS_NM + 15.0 * (2 * draw[:3] - 1)
    widths = _WIDTHS_NM * (0.8 + 0.4 * draw[3])
    filters = np.exp(-0.5 * ((_WAVELENGTH_NM - peaks[:, None]) / widths[:, None]) ** 2)
    return np.asarray(filters / filters.sum(axis=1, keepdims=True))


def _low_discrepancy(number: int, dimensions: int) -> NDArray[np.float64]:
    """(number, dimensions) points that fill the unit cube evenly: Kronecker's sequence on roots of the generalized golden ratio."""
    ratio = 1.5
    for _ in range(40):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, number + 1)[:, None] * steps) % 1.0)
