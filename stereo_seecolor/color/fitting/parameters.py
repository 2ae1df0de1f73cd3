"""The water's parameters as unbounded raw weights for an optimizer: fractions before a sigmoid, rates before a softplus."""

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.records import Water

BACKSCATTER = ("gamma_inf", "beta", "eta", "alpha")
ATTENUATION = ("w", "v", "y", "x")
LEAST = 1e-6
"""Fractions stay this far inside (0, 1), rates (1/m) above it: raw weights are finite, and no image shows the difference."""


def raw_fractions(fractions: Any) -> NDArray[np.float64]:
    """The inverse of a sigmoid, of fractions kept inside (0, 1)."""
    inside = np.clip(fractions, LEAST, 1 - LEAST)
    return np.asarray(np.log(inside) - np.log1p(-inside))


def raw_rates(rates: Any) -> NDArray[np.float64]:
    """The inverse of a softplus, of rates kept above 0."""
    above = np.maximum(rates, LEAST)
    return np.asarray(above + np.log(-np.expm1(-above)))


def fractions(raw: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sigmoid of raw weights: fractions in (0, 1)."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * raw)))


def rates(raw: NDArray[np.float64]) -> NDArray[np.float64]:
    """The softplus of raw weights: rates above 0."""
    return np.asarray(np.logaddexp(0, raw))


def water_of(found: NDArray[np.float64], encoding: InputEncoding) -> Water:
    """A Water from its (8, 3) parameters in the order of BACKSCATTER and ATTENUATION."""
    gamma_inf, beta, eta, alpha, w, v, y, x = np.array(found)
    return Water(gamma_inf, beta, eta, alpha, w=w, v=v, y=y, x=x, input_encoding=encoding)


@dataclass(frozen=True)
class ColdWater:
    """Initial parameters of a fit without a start, the same in all channels: thin backscatter, attenuation of 0.2 per meter."""

    gamma_inf: float = 0.1
    """Fraction of full scale."""
    beta: float = 0.2
    """1/m."""
    eta: float = 0.02
    """Fraction of full scale: nearly none near the camera."""
    alpha: float = 1.0
    """1/m."""
    w: float = 0.1
    """1/m; with y the attenuation close to the camera."""
    v: float = 0.1
    """1/m."""
    y: float = 0.1
    """1/m."""
    x: float = 0.1
    """1/m."""


COLD = ColdWater()


def cold_water(encoding: InputEncoding) -> Water:
    """The water of ``COLD``."""
    return water_of(np.outer(astuple(COLD), np.ones(3)), encoding)
