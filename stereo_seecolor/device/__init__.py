"""The stages of a frame on a GPU, in torch: the same numbers as the compiled loops give. torch is loaded where a GPU is chosen."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.matching.reduced import MakeMatcher

if TYPE_CHECKING:
    from stereo_seecolor.device.memory import Memory

DRIVERS = ("/dev/nvidiactl", "/dev/nvmap", "/dev/dxg", "C:/Windows/System32/nvcuda.dll")
"""One of these is there where NVIDIA's driver is: of a card, of a Jetson, of a card in WSL, and in Windows."""


def memory_of(device: str) -> "Memory | None":
    """The memory of the device that a setting names (auto, cpu, cuda); None where the compiled loops do the work.

    Raises DeviceError for cuda where torch finds no CUDA device.
    """
    if device == "cpu" or (device == "auto" and not any(Path(driver).exists() for driver in DRIVERS)):
        return None
    from stereo_seecolor.color.device import find_device
    from stereo_seecolor.device.memory import Memory

    found = find_device(device)
    return Memory(found) if found.type == "cuda" else None


def make_matcher(memory: "Memory | None") -> MakeMatcher:
    """What makes the matchers of a rig: on the device of ``memory``, or the compiled ones."""
    if memory is None:
        return Matcher
    from stereo_seecolor.device.matching import DeviceMatcher

    return partial(DeviceMatcher, memory)
