"""Device and number of threads of torch."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from stereo_seecolor.errors import DeviceError


def find_device(name: str) -> torch.device:
    """The torch device that a setting names (auto, cpu, cuda).

    Raises DeviceError for cuda where torch finds none.
    """
    if name == "cuda" and not torch.cuda.is_available():
        raise DeviceError(
            "device cuda: torch finds no CUDA device here; take auto or cpu (--device), or install "
            "a CUDA build of torch (docs/gpu.md)"
        )
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")


@contextmanager
def one_thread() -> Iterator[None]:
    """Use one thread in torch: the tensors of a fit are small, and waiting threads spin."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
