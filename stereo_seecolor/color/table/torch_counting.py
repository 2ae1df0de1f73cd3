"""Counts pixels in torch, on any device, with the same result as ``counting.measure``."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from stereo_seecolor.color.table.counting import FIRST, INFINITY, LAST
from stereo_seecolor.color.table.range_bins import LOW_BITS, RANGE_BINS


def positions(bits: Tensor) -> Tensor:
    """Compute ``counting.position_of`` of (N,) int32 bits of ranges."""
    known = (bits > 0) & (bits < int(INFINITY))
    return torch.where(known, (bits - int(FIRST)).clamp(0, LAST), LAST + 1)


def count_pixels(pixels: Tensor, bits: Tensor, values: int) -> tuple[Tensor, Tensor]:
    """Counts (3, 256, values) and offset sums (256,) of pixels (N, 3) and range bits (N,)."""
    position = positions(bits)
    range_bin = position >> LOW_BITS
    channel = torch.arange(3, device=pixels.device, dtype=torch.int32)
    value = pixels.to(torch.int32) >> (0 if pixels.dtype == torch.uint8 else 4)
    cell = (channel * (RANGE_BINS + 1) + range_bin[:, None]) * values + value
    counts = torch.bincount(cell.reshape(-1), minlength=3 * (RANGE_BINS + 1) * values).reshape(
        3, RANGE_BINS + 1, values
    )
    sums = torch.zeros(RANGE_BINS + 1, dtype=torch.int64, device=pixels.device)
    # integers: the order does not matter
    sums.index_add_(0, range_bin, (position & ((1 << LOW_BITS) - 1)).to(torch.int64))
    return counts[:, :RANGE_BINS], sums[:RANGE_BINS]


def pixels_on(image: NDArray[Any], device: torch.device) -> Tensor:
    """Copy the pixels of an image to a device: (N, 3) uint8, or int32 for 16 bits."""
    return on_device(image.reshape(-1, 3), device)


def on_device(numbers: NDArray[Any], device: torch.device) -> Tensor:
    """Copy numbers to a device; uint16 as int32, because few operations of torch support uint16."""
    plain = numbers.astype(np.int32) if numbers.dtype == np.uint16 else numbers
    return torch.from_numpy(plain).to(device)
