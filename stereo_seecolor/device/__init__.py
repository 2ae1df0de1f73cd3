"""The stages of a frame on a GPU, in torch: the same numbers as the compiled loops give. torch is
loaded only if a GPU is selected.
"""

from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from calibration import Rectification
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.matching.reduced import MakeMatcher
from stereo_seecolor.records import Image

if TYPE_CHECKING:
    from stereo_seecolor.device.memory import Memory

DRIVERS = ("/dev/nvidiactl", "/dev/nvmap", "/dev/dxg", "C:/Windows/System32/nvcuda.dll")
"""One of these exists with NVIDIA's driver: of a card, a Jetson, a card in WSL, in Windows."""


class Rectifies(Protocol):
    """Rectifies the images of a rig: a ``Rectification``, or one on a device."""

    def apply_left(self, image: Image) -> Image:
        """Rectify a raw left image."""

    def apply_right(self, image: Image) -> Image:
        """Rectify a raw right image."""


def memory_of(device: str) -> "Memory | None":
    """The memory of the device that a setting names (auto, cpu, cuda); None where the compiled
    loops do the work.

    Raises DeviceError for cuda where torch finds no CUDA device.
    """
    if device == "cpu" or (
        device == "auto" and not any(Path(driver).exists() for driver in DRIVERS)
    ):
        return None
    from stereo_seecolor.color.device import find_device

    found = find_device(device)
    return memory_on(found.type) if found.type == "cuda" else None


@cache
def memory_on(torch_device: str) -> "Memory":
    """The one memory of a device of torch, which all stages share."""
    import torch

    from stereo_seecolor.device.memory import Memory

    return Memory(torch.device(torch_device))


def make_rectifier(rectification: Rectification, memory: "Memory | None") -> Rectifies:
    """What rectifies images: on the device of ``memory``, or compiled."""
    if memory is None:
        return rectification
    from stereo_seecolor.device.rectify import Rectifier

    return Rectifier(memory, rectification)


def make_matcher(memory: "Memory | None") -> MakeMatcher:
    """What makes the matchers of a rig."""
    if memory is None:
        return Matcher
    from stereo_seecolor.device.matching import DeviceMatcher

    return partial(DeviceMatcher, memory)


def make_corrector(config: ColorConfig, memory: "Memory | None") -> Corrector:
    """The corrector on the device of ``memory``, or the compiled one."""
    if memory is None:
        return Corrector(config)
    from stereo_seecolor.device.color import DeviceCorrector

    return DeviceCorrector(memory, config)
