"""The laws of sensor noise over brightness, for linear and encoded values."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.response.noise import Blocks, NoiseCurve, noise_curve
from stereo_seecolor.files.srgb import decode_srgb

Array = NDArray[np.float64]
Encoding = Literal["linear", "srgb", "gamma"]
DECODERS: dict[str, Callable[[Array], Array]] = {
    "linear": lambda value: value,
    "srgb": decode_srgb,
    "gamma": lambda value: value**1.8,
}
"""Value -> light. gamma: the flattest encoding in use, which is compared with linear images."""
STEP = 1e-3
"""Step of a value for slopes."""
LEAST_BINS = 6
"""Least bins of brightness with more than the noise of rounding."""
PEDESTAL_MISFIT = 0.25
"""Largest misfit of a line, logarithm, rms; with more, its zero is not reliable."""


class Law(NamedTuple):
    """The noise of a sensor seen through a response.

    misfit: rms of logarithms. zero: light at which the line of the noise reaches 0, fraction of
    full scale. misfit_at_zero: of the best line that reaches 0 at no light or below.
    """

    misfit: float
    zero: float
    misfit_at_zero: float


def fit_law(curve: NoiseCurve, bins: NDArray[np.bool_], encoding: Encoding) -> Law:
    """Fit variance = quantization + factor (light - zero) / slope ** 2 to a curve.

    light, slope: of the brightness, decoded, and its derivative. zero: at most the light of the
    darkest value; below 0 if there is read noise.
    """
    decode, mean = DECODERS[encoding], curve.mean[bins] / 255
    light, slope = decode(mean), (decode(mean + STEP) - decode(mean - STEP)) / (2 * STEP)
    darkest = float(decode(np.array([curve.darkest / 255]))[0])
    most = min(darkest, 0.98 * float(light.min()))
    zeros = np.concatenate(
        [-2 * light.max() * np.linspace(1, 0, 60) ** 3, np.linspace(0, most, 40)[1:]]
    )
    shape = (light - zeros[:, None]) / slope**2
    misfits = _misfits(shape, curve.variance[bins], curve.quantization)
    best = int(misfits.argmin())
    return Law(float(misfits[best]), float(zeros[best]), float(misfits[zeros <= 0].min()))


def _misfits(shape: Array, variance: Array, quantization: float) -> Array:
    """(Z,) rms of what the best multiples of (Z, K) shapes leave of (K,) variances."""
    log_factor = np.median(
        np.log(np.maximum(variance - quantization, 1e-3)) - np.log(shape), axis=1
    )
    for _ in range(6):  # Gauss-Newton
        law = np.exp(log_factor)[:, None] * shape
        part = law / (law + quantization)
        left = np.log(variance) - np.log(law + quantization)
        log_factor += (left * part).sum(axis=1) / (part**2).sum(axis=1)
    left = np.log(variance) - np.log(np.exp(log_factor)[:, None] * shape + quantization)
    return np.asarray(np.sqrt((left**2).mean(axis=1)))


def pedestal_law(frames: Sequence[Blocks], quantization: float, encoding: Encoding) -> Law | None:
    """Fit the law of one channel of these frames; None if their noise does not follow it."""
    curve = noise_curve(frames, quantization)
    above = curve is not None and curve.variance > 2 * quantization
    if curve is None or np.sum(above) < LEAST_BINS:
        return None
    law = fit_law(curve, np.asarray(above), encoding)
    return law if law.misfit < PEDESTAL_MISFIT else None
