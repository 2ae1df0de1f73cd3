"""The paper's formulas of water, written once: for numpy arrays, and for torch tensors, whose
derivatives autograd then knows.

I_c = J_c white_c A_c(z) + B_c(z), DeepSeeColor (Jamieson, How, Girdhar 2023). z in meters, rates in
1/m, never negative.
"""

import sys
from typing import Any

import numpy as np


def ged(x: Any) -> Any:
    """The gated exponential decay: 1 where x <= 0, exp(-x) elsewhere."""
    of = _library(x)
    return of.exp(-of.clip(x, 0, None))


def cged(x: Any) -> Any:
    """Its complement: 1 - GED(x)."""
    of = _library(x)
    return -of.expm1(-of.clip(x, 0, None))


def sigmoid(x: Any) -> Any:
    """1 / (1 + exp(-x)); the last layer of the paper's network (fig. backscatter-net)."""
    return 1 / (1 + _library(x).exp(-x))


def backscatter(z: Any, gamma_inf: Any, beta: Any, eta: Any, alpha: Any) -> Any:
    """B(z) as a fraction of full scale (paper eq. sea-thru-backscatter-residual)."""
    return gamma_inf * cged(beta * z) + eta * ged(alpha * z)


def optical_depth(z: Any, w: Any, v: Any, y: Any, x: Any) -> Any:
    """-log A(z) (paper eq. sea-thru-atten-coeff)."""
    return z * (w * ged(v * z) + y * ged(x * z))


def attenuation(z: Any, w: Any, v: Any, y: Any, x: Any) -> Any:
    """A(z) in (0, 1]; the white point is not in it."""
    return ged(optical_depth(z, w, v, y, x))


def _library(x: Any) -> Any:
    """The library of an array: torch is loaded already where there is a tensor."""
    return np if isinstance(x, np.ndarray | np.generic | float) else sys.modules["torch"]
