"""Jerlov's optical water types: diffuse attenuation of daylight by wavelength, from the clearest
ocean to turbid coast.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

JerlovType = Literal["I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C"]
Spectrum = NDArray[np.float64]

TABLE_NM = np.arange(400, 701, 25)
"""(13,) wavelengths of the tables below, nm."""

KD_JERLOV: dict[JerlovType, Spectrum] = {
    "I": np.array(
        [0.027, 0.022, 0.019, 0.018, 0.027, 0.043, 0.063, 0.089, 0.235, 0.305, 0.36, 0.42, 0.56]
    ),
    "IA": np.array(
        [0.038, 0.031, 0.026, 0.025, 0.032, 0.048, 0.067, 0.094, 0.24, 0.31, 0.37, 0.43, 0.57]
    ),
    "IB": np.array(
        [0.051, 0.042, 0.036, 0.033, 0.042, 0.054, 0.072, 0.099, 0.245, 0.315, 0.375, 0.435, 0.58]
    ),
    "II": np.array(
        [0.096, 0.081, 0.068, 0.062, 0.07, 0.076, 0.089, 0.115, 0.26, 0.335, 0.4, 0.465, 0.61]
    ),
    "III": np.array(
        [0.185, 0.16, 0.135, 0.116, 0.115, 0.116, 0.12, 0.148, 0.295, 0.375, 0.445, 0.52, 0.66]
    ),
    "1C": np.array([0.51, 0.36, 0.25, 0.17, 0.14, 0.13, 0.12, 0.15, 0.3, 0.37, 0.45, 0.51, 0.65]),
    "3C": np.array([0.78, 0.54, 0.39, 0.29, 0.22, 0.2, 0.19, 0.21, 0.33, 0.4, 0.46, 0.56, 0.71]),
    "5C": np.array([1.1, 0.78, 0.56, 0.43, 0.36, 0.31, 0.3, 0.33, 0.4, 0.48, 0.54, 0.65, 0.8]),
    "7C": np.array([1.6, 1.2, 0.89, 0.71, 0.58, 0.49, 0.46, 0.46, 0.48, 0.54, 0.63, 0.78, 0.92]),
}
"""Type -> (13,) diffuse attenuation Kd, 1/m: Jerlov, Marine Optics (1976), table XXVII."""

KD_REVISED: dict[JerlovType, Spectrum] = {
    "IB": np.array([
        0.0438, 0.0395, 0.0355, 0.0330, 0.0396, 0.0596, 0.0715, 0.0995, 0.2471, 0.3245, 0.3652,
        0.4457, 0.6550,
    ]),
    "1C": np.array([
        0.2516, 0.2374, 0.2048, 0.1700, 0.1486, 0.1461, 0.1415, 0.1596, 0.3057, 0.3922, 0.4525,
        0.5257, 0.6896,
    ]),
}  # fmt: skip
"""Two types as revised by Austin and Petzold (Spectral dependence of the diffuse attenuation
coefficient, 1984).
"""


def scattering_per_m(kd: Spectrum) -> float:
    """Scattering coefficient, 1/m, as beam attenuation less Kd, both at 535 nm: Kd = 0.2 c + 0.04
    (Shannon, Proc. SPIE 64, 1975).

    kd: (13,) at TABLE_NM, 1/m. Negative in the clearest waters, beyond the relation.
    """
    kd_535 = float(np.interp(535.0, TABLE_NM, kd))
    return (kd_535 - 0.04) / 0.2 - kd_535
