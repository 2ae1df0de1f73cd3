"""Rectification on a device: ``cv2.remap`` with the same tables, to the bit for 8-bit images."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from calibration import Rectification
from calibration.rectification import RemapTables
from stereo_seecolor.device.memory import Memory
from stereo_seecolor.records import Image

FRACTIONS = 32
"""Places between two pixels that OpenCV's tables tell apart."""


class Rectifier:
    """``Rectification.apply_left`` and ``apply_right`` on a device, where results stay."""

    def __init__(self, memory: Memory, rectification: Rectification) -> None:
        self._memory, self._compiled = memory, rectification
        self._left = _taps(rectification.maps_left, rectification.raw_size, memory.device)
        self._right = _taps(rectification.maps_right, rectification.raw_size_right, memory.device)

    def apply_left(self, image: Image) -> Image:
        """As ``Rectification.apply_left``."""
        if self._left is None or image.shape[1::-1] != self._compiled.raw_size:
            return self._compiled.apply_left(image)  # untouched, or named as of a wrong size
        return self._memory.array(remap(self._memory.tensor(image), *self._left))

    def apply_right(self, image: Image) -> Image:
        """As ``Rectification.apply_right``."""
        if self._right is None or image.shape[1::-1] != self._compiled.raw_size_right:
            return self._compiled.apply_right(image)
        return self._memory.array(remap(self._memory.tensor(image), *self._right))


def remap(image: Tensor, places: Tensor, weights: Tensor) -> Tensor:
    """An (..., H, W, C) image, or a batch, at the four pixels around each place, weighed; both (4,
    h, w) of ``_taps``.
    """
    flat = image.flatten(-3, -2).to(torch.int32)
    total = flat.new_full((*flat.shape[:-2], *places.shape[1:], flat.shape[-1]), FRACTIONS**2 // 2)
    for place, weight in zip(places, weights, strict=True):
        total += flat[..., place, :] * weight[..., None]
    return (total // FRACTIONS**2).to(image.dtype)


def _taps(
    maps: RemapTables | None, size: tuple[int, int], device: torch.device
) -> tuple[Tensor, Tensor] | None:
    """(4, h, w) int64 places of the pixels around, and their int32 weights, which add up to
    FRACTIONS**2; 0 beyond the image.
    """
    if maps is None:
        return None
    table, fraction = maps
    width, height = size
    fx, fy = (
        (fraction % FRACTIONS).astype(np.int32),
        (fraction // FRACTIONS % FRACTIONS).astype(np.int32),
    )
    places: list[Any] = []
    weights: list[Any] = []
    for dy, wy in ((0, FRACTIONS - fy), (1, fy)):
        for dx, wx in ((0, FRACTIONS - fx), (1, fx)):
            x, y = (table[..., axis].astype(np.int64) + by for axis, by in ((0, dx), (1, dy)))
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            places.append(np.where(inside, y * width + x, 0))
            weights.append(np.where(inside, wx * wy, 0).astype(np.int32))
    return torch.from_numpy(np.stack(places)).to(device), torch.from_numpy(np.stack(weights)).to(
        device
    )
