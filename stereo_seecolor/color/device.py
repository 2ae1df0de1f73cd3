"""Where torch runs."""

import torch

from stereo_seecolor.errors import DeviceError


def find_device(name: str) -> torch.device:
    """The torch device of ``color.device``. Raises DeviceError for CUDA where there is none."""
    if name == "cuda" and not torch.cuda.is_available():
        raise DeviceError(
            "color.device=cuda: torch finds no CUDA device here; set color.device=auto or cpu, or install a CUDA build of torch"
        )
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")
