"""Checks that catch a wrong calibration before it costs a dive, each with its evidence in numbers."""

import numpy as np
from numpy.typing import NDArray

from calibration.rig import Camera

Array = NDArray[np.float64]


def lens_folds(camera: Camera) -> bool:
    """True if the lens model turns back within the image, so that two directions share a pixel (or none reaches it).

    A sign of coefficients fitted to corners from the middle of the image alone.
    """
    width, height = camera.image_size
    edge = np.linspace(0, 1, 9)
    x, y = np.meshgrid(edge * (width - 1), edge * (height - 1))
    return bool(np.isnan(camera.rays(np.column_stack([x.ravel(), y.ravel()]))).any())
