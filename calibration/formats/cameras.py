"""Cameras of calibration files, as all formats make them."""

import numpy as np
from numpy.typing import NDArray

from calibration.formats.reading.section import naming
from calibration.rig import Camera, CameraModel


def make_camera(
    where: str,
    K: NDArray[np.float64],
    distortion: NDArray[np.float64],
    size: tuple[int, int],
    model: CameraModel,
) -> Camera:
    """A Camera whose complaints name the file."""
    with naming(where):
        return Camera(K, distortion, size, model)
