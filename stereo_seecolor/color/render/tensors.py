"""What ``counting`` and ``kernels`` do, in torch, for a CUDA device (``color.device: cuda``) or any other: the same numbers.

Images that are on the device already can stay there: ``count_pixels`` and ``look_up``.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from stereo_seecolor.color.render import kernels
from stereo_seecolor.color.render.gains import FINE, FINE_LEVELS, Gains
from stereo_seecolor.color.render.tone import Looks
from stereo_seecolor.color.table.encoding import NODES
from stereo_seecolor.color.table.moment_table import LEVELS, LOW_BITS, NEAREST_M, range_bits

_FIRST = int(np.float32(NEAREST_M).view(np.int32))
_INFINITY = int(np.float32(np.inf).view(np.int32))
_LAST = (LEVELS << LOW_BITS) - 1
_FINE_BITS = LOW_BITS - FINE.bit_length() + 1


def count(
    image: NDArray[Any], range_m: NDArray[np.floating], values: int, device: torch.device
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """``counting.count`` on a device."""
    pixels, bits = _pixels(np.ascontiguousarray(image), device), torch.from_numpy(range_bits(range_m)).to(device)
    counts, offset_sum = count_pixels(pixels, bits, values)
    return counts.cpu().numpy(), offset_sum.cpu().numpy()


def apply(
    image: NDArray[Any], bits: NDArray[np.int32], by_level: Gains, look: Looks, device: torch.device
) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], float]:
    """``kernels.apply`` on a device."""
    pixels, level = _pixels(image, device), levels(torch.from_numpy(bits).to(device), _FINE_BITS)
    known = torch.from_numpy(look.known).to(device)[pixels.to(torch.int64)]
    capped = torch.from_numpy(np.append(by_level.capped, False)).to(device)[level]
    unknown = level == FINE_LEVELS
    curve, shoulder = (_tensor(part, device) for part in (look.curve, look.shoulder))
    if image.dtype == np.uint8:
        out = look_up(pixels, level, _tensor(kernels.color_table(by_level, look), device))
        mend = (capped | (known < 1).any(dim=1)) & ~unknown
        light = _mended(pixels[mend], level[mend], known[mend], by_level, look)
        out[mend] = curve[(light * NODES + 0.5).clamp(0, curve.numel() - 1).to(torch.int64)]
    else:
        out = _encoded(_mended(pixels, level, known, by_level, look), curve)
        out[unknown] = curve[0]
    if look.shoulder.size:
        out = _rolled_off(out.to(torch.float32), shoulder).clamp(max=np.iinfo(image.dtype).max)
    out = out.to(torch.int32)
    beyond = (capped | (known == 0).any(dim=1)) & ~unknown
    clipped = int((out == np.iinfo(image.dtype).max).any(dim=1).sum()) / max(int((~unknown).sum()), 1)
    return out.cpu().numpy().astype(image.dtype).reshape(-1), unknown.cpu().numpy(), beyond.cpu().numpy(), clipped


def linear(
    image: NDArray[Any], bits: NDArray[np.int32], by_level: Gains, decoded: NDArray[np.float32], device: torch.device
) -> NDArray[np.float32]:
    """``kernels.linear`` on a device."""
    level = levels(torch.from_numpy(bits).to(device), _FINE_BITS)
    light = _light(_pixels(image, device), level, by_level, decoded)
    light[level == FINE_LEVELS] = 0
    return np.asarray(light.cpu().numpy().reshape(-1))


def levels(bits: Tensor, shift: int) -> Tensor:
    """(N,) int32 bits of ranges -> their places among the levels, without ``shift`` low bits; past the last where not known."""
    known = (bits > 0) & (bits < _INFINITY)
    place = (bits - _FIRST).clamp(0, _LAST)
    return torch.where(known, place, _LAST + 1) >> shift


def count_pixels(pixels: Tensor, bits: Tensor, values: int) -> tuple[Tensor, Tensor]:
    """Counts (3, 256, values) and offset sums (256,), both int64, of (N, 3) pixels with the (N,) int32 bits of their ranges."""
    place = levels(bits, 0)
    level = place >> LOW_BITS
    channel = torch.arange(3, device=pixels.device, dtype=torch.int32)
    value = pixels.to(torch.int32) >> (0 if pixels.dtype == torch.uint8 else 4)
    cell = (channel * (LEVELS + 1) + level[:, None]) * values + value
    counts = torch.bincount(cell.reshape(-1), minlength=3 * (LEVELS + 1) * values).reshape(3, LEVELS + 1, values)
    sums = torch.zeros(LEVELS + 1, dtype=torch.int64, device=pixels.device)
    sums.index_add_(0, level, (place & ((1 << LOW_BITS) - 1)).to(torch.int64))  # integers: the order does not matter
    return counts[:, :LEVELS], sums[:LEVELS]


def look_up(pixels: Tensor, level: Tensor, table: Tensor) -> Tensor:
    """(N, 3) uint8 pixels at their (N,) fine levels through ``kernels.color_table``."""
    channel = torch.arange(3, device=pixels.device, dtype=torch.int32) * 256
    return table[(level[:, None] * 768 + channel) + pixels]


def _pixels(image: NDArray[Any], device: torch.device) -> Tensor:
    """(N, 3) uint8, or int32 of 16 bits."""
    return _tensor(image.reshape(-1, 3), device)


def _tensor(numbers: NDArray[Any], device: torch.device) -> Tensor:
    """On a device; as int32 where uint16, which few of torch's operations take."""
    return torch.from_numpy(numbers.astype(np.int32) if numbers.dtype == np.uint16 else numbers).to(device)


def _light(pixels: Tensor, level: Tensor, by_level: Gains, decoded: NDArray[np.float32]) -> Tensor:
    """``kernels._unclipped`` of all pixels."""
    inside, device = level.clamp(max=FINE_LEVELS - 1), pixels.device
    numbers = by_level.gain, by_level.offset, by_level.missing
    gain, offset, missing = (torch.from_numpy(np.ascontiguousarray(x.T)).to(device)[inside] for x in numbers)
    light = gain * torch.from_numpy(decoded).to(device)[pixels.to(torch.int64)] - offset
    return torch.where(_sum(missing) > 0, light + missing * (_sum(light) / _sum(1 - missing)), light)


def _rolled_off(codes: Tensor, shoulder: Tensor) -> Tensor:
    """``kernels._roll_off``."""
    knee, span, bend, unit, zero = shoulder.unbind()
    code = codes.amax(dim=1, keepdim=True)
    over = (code - knee).clamp(min=0)
    factor = (torch.minimum(code, knee) + over * (span + over * bend) / (span + over)) / code * unit
    return (codes * factor - zero).clamp(min=0)


def _mended(pixels: Tensor, level: Tensor, known: Tensor, by_level: Gains, look: Looks) -> Tensor:
    """``kernels._lights`` of all pixels."""
    light = _light(pixels, level, by_level, look.decoded)
    lost = (1 - known[:, :1]) * (1 - known[:, 1:2]) * (1 - known[:, 2:])
    brightest = light.amax(dim=1, keepdim=True)
    gray = (_sum(known * light) + lost * brightest) / (_sum(known) + lost)
    return light + (1 - known) * (gray - light).clamp(min=0)


def _sum(channels: Tensor) -> Tensor:
    return channels[:, :1] + channels[:, 1:2] + channels[:, 2:]


def _encoded(light: Tensor, nodes: Tensor) -> Tensor:
    place = (light * NODES).clamp(0, nodes.numel() - 2)
    node = place.to(torch.int64)
    values: Tensor = nodes[node] + (nodes[node + 1] - nodes[node]) * (place - node)
    return values
