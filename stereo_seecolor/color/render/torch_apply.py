"""What ``kernels`` does, in torch, for a CUDA device (``color.device: cuda``) or any other: the same numbers.

Images that are on the device already can stay there: ``look_up``.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from stereo_seecolor.color.render import kernels
from stereo_seecolor.color.render.gains import FINE, FINE_LEVELS, Gains
from stereo_seecolor.color.render.tone import Looks
from stereo_seecolor.color.table.bins import LOW_BITS
from stereo_seecolor.color.table.encoding import NODES
from stereo_seecolor.color.table.torch_counting import levels, on_device, pixels_on

_FINE_BITS = LOW_BITS - FINE.bit_length() + 1


def apply(
    image: NDArray[Any], bits: NDArray[np.int32], by_level: Gains, look: Looks, device: torch.device
) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], float]:
    """``kernels.apply`` on a device."""
    pixels, level = pixels_on(image, device), levels(torch.from_numpy(bits).to(device), _FINE_BITS)
    known = torch.from_numpy(look.known).to(device)[pixels.to(torch.int64)]
    capped = torch.from_numpy(np.append(by_level.capped, False)).to(device)[level]
    unknown = level == FINE_LEVELS
    curve, shoulder = (on_device(part, device) for part in (look.curve, look.shoulder))
    if image.dtype == np.uint8:
        out = look_up(pixels, level, on_device(kernels.color_table(by_level, look), device))
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
    light = _light(pixels_on(image, device), level, by_level, decoded)
    light[level == FINE_LEVELS] = 0
    return np.asarray(light.cpu().numpy().reshape(-1))


def look_up(pixels: Tensor, level: Tensor, table: Tensor) -> Tensor:
    """(N, 3) uint8 pixels at their (N,) fine levels through ``kernels.color_table``."""
    channel = torch.arange(3, device=pixels.device, dtype=torch.int32) * 256
    return table[(level[:, None] * 768 + channel) + pixels]


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
