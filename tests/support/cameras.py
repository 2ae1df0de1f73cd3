"""Drawn cameras: what a sensor, its software and a file make of light that is known."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import encode_srgb

Array = NDArray[np.float64]


def drawn_light(seed: int, size: tuple[int, int] = (480, 360)) -> Array:
    """(H, W, 3) linear light of a drawn sea floor: rock of fine texture, and sand with little."""
    rng = np.random.default_rng(seed)
    width, height = size

    def noise(step: int) -> Array:
        small = rng.normal(size=(height // step + 3, width // step + 3)).astype(np.float32)
        large = cv2.resize(small, None, fx=step, fy=step, interpolation=cv2.INTER_CUBIC)
        return np.asarray(large[:height, :width], np.float64)

    shape = 0.7 * noise(120) + 0.4 * noise(60)
    rough = 1 / (1 + np.exp(-6 * noise(80)))
    texture = sum(weight * noise(step) for step, weight in ((24, 0.2), (12, 0.15), (6, 0.1)))
    light = 0.2 * np.exp(0.9 * shape + rough * texture)
    return np.clip(light[..., None] * np.array([0.75, 1.0, 1.05]), 0, 0.95)


@dataclass(frozen=True)
class Camera:
    """electrons: of full scale. read: noise of reading, electrons. pedestal: of 255, in linear
    light. curve: of the file. mosaic: demosaiced, bilinearly. jpeg: quality; 0 = lossless.
    """

    electrons: float = 6000.0
    read: float = 6.0
    pedestal: float = 0.0
    curve: Literal["linear", "srgb", "gamma 1.8"] = "linear"
    bits: Literal[8, 16] = 8
    mosaic: bool = False
    denoised: bool = False
    halved: bool = False
    jpeg: int = 0

    def shoot(self, light: Array, seed: int = 0) -> NDArray[np.unsignedinteger]:
        """(H, W, 3) RGB image of the light."""
        rng = np.random.default_rng(seed)
        electrons = rng.poisson(light * self.electrons) + rng.normal(0, self.read, light.shape)
        seen = electrons / self.electrons + self.pedestal / 255
        if self.mosaic:
            seen = _demosaiced(seen)
        seen = np.clip(seen, 0, 1).astype(np.float32)
        if self.denoised:
            seen = cv2.bilateralFilter(seen, 5, 0.06, 1.5)
        if self.curve == "srgb":
            seen = encode_srgb(seen)
        elif self.curve == "gamma 1.8":
            seen = seen ** np.float32(1 / 1.8)
        if self.halved:
            seen = cv2.resize(seen, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        full = 2**self.bits - 1
        image = np.round(seen * full).astype(np.uint8 if self.bits == 8 else np.uint16)
        if self.jpeg:
            written = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])[1]
            image = cv2.imdecode(written, cv2.IMREAD_COLOR)
        return image


def _demosaiced(seen: Array) -> Array:
    """The image by bilinear interpolation from an RGGB mosaic."""
    mosaic = np.zeros(seen.shape[:2], np.float32)
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        mosaic[row::2, column::2] = seen[row::2, column::2, channel]
    whole = np.round(np.clip(mosaic, 0, 1) * 65535).astype(np.uint16)
    return np.asarray(cv2.cvtColor(whole, cv2.COLOR_BayerBG2RGB), np.float64)[..., ::-1] / 65535
