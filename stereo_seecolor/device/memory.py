"""Where a frame's stages run, and what lies there: arrays are not uploaded again."""

import weakref
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


class Memory:
    """The memory of a device. Arrays that came from it must not be written to afterwards."""

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self._held: dict[int, tuple[weakref.ref[Any], Tensor]] = {}

    def tensor(self, array: NDArray[Any]) -> Tensor:
        """The array on the device: uploaded through pinned memory, unless it came from there."""
        held = self._held.get(id(array))
        if held is not None and held[0]() is array:
            return held[1]
        tensor = torch.from_numpy(
            np.ascontiguousarray(array) if array.flags.writeable else array.copy()
        )
        return self._hold(
            array,
            tensor.pin_memory().to(self.device, non_blocking=True)
            if self.device.type == "cuda"
            else tensor,
        )

    def array(self, tensor: Tensor) -> NDArray[Any]:
        """A tensor as an array, whose ``tensor`` then costs nothing."""
        array: NDArray[Any] = tensor.cpu().numpy()
        self._hold(array, tensor)
        return array

    def _hold(self, array: NDArray[Any], tensor: Tensor) -> Tensor:
        key = id(array)
        self._held[key] = weakref.ref(array, lambda _: self._held.pop(key, None)), tensor
        return tensor
