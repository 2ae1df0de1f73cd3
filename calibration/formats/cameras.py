"""Cameras of calibration files, as all formats make and write them."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.formats.reading.section import Section, naming
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


def known_lens(section: Section, key: str, known: Iterable[str], usual: str = "") -> str:
    """The name of the lens model under ``key``; where the file names none, the ``usual`` one."""
    name = usual if usual and not section.has(key) else section.text(key)
    if name not in known:
        raise CalibrationError(
            f"{section.where}: {key}: {name!r} is not supported: calibrate with one of "
            f"{', '.join(filter(None, known))}"
        )
    return name


def five_coefficients(camera: Camera, side: str, program_has: str) -> NDArray[np.float64]:
    """k1 k2 p1 p2 k3. Raises CalibrationError for a model of more; program_has: for the message."""
    if camera.model == "fisheye" or camera.distortion[5:].any():
        raise CalibrationError(
            f"{side}: {program_has}, but this {camera.model} camera has more: write native"
        )
    return np.pad(camera.distortion[:5], (0, 5 - camera.distortion[:5].size))
