"""Corners of a target in an image, and the bounds of their detection."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

MIN_CORNERS = 8  # a pose has 6 unknowns, corners have two numbers: 8 leave 10 to judge it
DETECTION_SIDE_PX = 1600
"""Larger images are searched at this size first: quick, and refined at full size after."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners found in one image. ids: (n,) which corner of the target; pixels: (n, 2) float64,
    where.
    """

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]


def images_for_detection(
    image: NDArray[np.uint8],
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], float]:
    """The image as a target is looked for in it, the same with its contrast raised (haze), and how
    many of their pixels a pixel of the image has along a side.
    """
    scale = min(1.0, DETECTION_SIDE_PX / max(image.shape))
    small = (
        image
        if scale == 1
        else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    )
    clear = cv2.createCLAHE(3.0, (8, 8)).apply(small)
    return np.asarray(small, np.uint8), np.asarray(clear, np.uint8), scale
