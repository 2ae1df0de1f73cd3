"""Corners of a target in an image, and the bounds of their detection."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MIN_CORNERS = 8  # a pose has 6 unknowns, corners have two numbers: 8 leave 10 to judge it
DETECTION_SIDE_PX = (
    1600  # larger images are searched at this size first: quick, and refined at full size after
)


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners found in one image. ids: (n,) which corner of the target; pixels: (n, 2) float64,
    where.
    """

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]
