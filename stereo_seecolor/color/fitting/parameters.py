"""The water's parameters as what an optimizer moves freely: shares before a sigmoid, rates before a softplus."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.records import Water

BACKSCATTER = ("gamma_inf", "beta", "eta", "alpha")
ATTENUATION = ("w", "v", "y", "x")


def raw_shares(shares: Any) -> NDArray[np.float64]:
    """The inverse of a sigmoid, of shares kept inside (0, 1)."""
    inside = np.clip(shares, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(inside) - np.log1p(-inside))


def raw_rates(rates: Any) -> NDArray[np.float64]:
    """The inverse of a softplus, of rates kept above 0."""
    above = np.maximum(rates, 1e-6)
    return np.asarray(above + np.log(-np.expm1(-above)))


def shares(raw: NDArray[np.float64]) -> NDArray[np.float64]:
    """A sigmoid."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * raw)))


def rates(raw: NDArray[np.float64]) -> NDArray[np.float64]:
    """A softplus."""
    return np.asarray(np.logaddexp(0, raw))


def water_of(found: NDArray[np.float64], encoding: InputEncoding) -> Water:
    """A Water from its (8, 3) parameters in the order of BACKSCATTER and ATTENUATION."""
    gamma_inf, beta, eta, alpha, w, v, y, x = np.array(found)
    return Water(gamma_inf, beta, eta, alpha, w=w, v=v, y=y, x=x, input_encoding=encoding)


def cold_water(encoding: InputEncoding) -> Water:
    """Where a fit begins that knows nothing: a thin veil, and attenuation of 0.2 at every range."""
    every = np.ones(3)
    return water_of(
        np.stack([0.1 * every, 0.2 * every, 0.02 * every, every, 0.1 * every, 0.1 * every, 0.1 * every, 0.1 * every]), encoding
    )
