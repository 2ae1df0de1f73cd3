"""Quarter turns of cameras and images."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_COSINES = (1.0, 0.0, -1.0, 0.0)


def quarter_turn(turns: int) -> Array:
    """The exact rotation about the optical axis by ``turns`` times 90 degrees, x towards y (clockwise in an image): (3, 3)."""
    cosine, sine = _COSINES[turns % 4], _COSINES[(turns - 1) % 4]
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def quarter_turns_of(R: Array) -> int:
    """0..3: the quarter turn about the optical axis that the rotation (3, 3) is nearest to."""
    return round(roll(R) / (np.pi / 2)) % 4


def roll(R: Array) -> float:
    """The angle, in radians, of the rotation about the optical axis that the rotation (3, 3) is nearest to."""
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))
