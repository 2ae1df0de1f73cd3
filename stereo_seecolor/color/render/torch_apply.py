"""``kernels`` in torch, for a CUDA device (``color.device: cuda``) or any other, with the same results."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from stereo_seecolor.color.render.gains import FINE_BINS, Gains
from stereo_seecolor.color.render.kernels import FINE_SHIFT, Shown, code_table
from stereo_seecolor.color.render.tone import NODES, Display
from stereo_seecolor.color.table.torch_counting import on_device, pixels_on, positions


def apply(image: NDArray[Any], bits: NDArray[np.int32], gains: Gains, shown: Display, device: torch.device) -> tuple[Shown, float]:
    """``kernels.apply`` on a device."""
    pixels, eight = pixels_on(image, device), image.dtype == np.uint8
    out, unknown, unrecoverable, clipped = apply_on(pixels, torch.from_numpy(bits).to(device), gains, shown, eight)
    return Shown(out.cpu().numpy().astype(image.dtype), unknown.cpu().numpy(), unrecoverable.cpu().numpy()), clipped


def apply_on(pixels: Tensor, bits: Tensor, gains: Gains, shown: Display, eight: bool) -> tuple[Tensor, Tensor, Tensor, float]:
    """``kernels.apply`` of (N, 3) pixels and (N,) bits that are on a device. eight: of 8 bits, else 16.

    Returns corrected pixels, as int32; where the range is unknown; where they cannot be recovered; and the fraction clipped.
    """
    device, fine = pixels.device, positions(bits) >> FINE_SHIFT
    unknown, top = fine == FINE_BINS, 255 if eight else 65535
    known = on_device(shown.known, device)[pixels.to(torch.int64)]
    capped = on_device(gains.capped, device)[fine] & ~unknown
    light = _above_noise(_mixed(_light(pixels, fine, known, gains, shown.decoded), gains), fine, gains)
    codes = _codes(light, on_device(shown.curve, device), eight)
    if eight and not gains.matrix.size:
        plain = (~capped & (known == 1).all(dim=1)) | unknown
        codes[plain] = _looked_up(pixels[plain], fine[plain], code_table(gains, shown))
    knee, length, bend, unit, zero = on_device(shown.shoulder, device).unbind()
    code = codes.amax(dim=1, keepdim=True).clamp(min=1e-30)
    over = (code - knee).clamp(min=0)
    factor = (torch.minimum(code, knee) + over * (length + over * bend) / (length + over)) / code * unit
    out = (codes * factor - zero).clamp(0, top).to(torch.int32)
    out[unknown] = 0
    unrecoverable = (capped | (known == 0).any(dim=1)) & ~unknown
    clipped = int((out == top).any(dim=1).sum()) / max(int((~unknown).sum()), 1)
    return out, unknown, unrecoverable, clipped


def linear(
    image: NDArray[Any], bits: NDArray[np.int32], gains: Gains, decoded: NDArray[np.float32], device: torch.device
) -> NDArray[np.float32]:
    """``kernels.linear`` on a device."""
    fine = positions(torch.from_numpy(bits).to(device)) >> FINE_SHIFT
    light = _mixed(_unclipped(pixels_on(image, device), fine, gains, decoded), gains)
    light[fine == FINE_BINS] = 0
    return np.asarray(light.cpu().numpy())


def _looked_up(pixels: Tensor, fine: Tensor, table: NDArray[np.uint16]) -> Tensor:
    """(N, 3) codes of 8-bit pixels at their (N,) fine bins."""
    channel = torch.arange(3, device=pixels.device, dtype=torch.int32) * 256
    return on_device(table, pixels.device)[(fine[:, None] * 768 + channel) + pixels].to(torch.float32)


def _light(pixels: Tensor, fine: Tensor, known: Tensor, gains: Gains, decoded: NDArray[np.float32]) -> Tensor:
    """``pixel_kernels.light_of`` of all pixels."""
    light = _unclipped(pixels, fine, gains, decoded)
    lost = (1 - known[:, :1]) * (1 - known[:, 1:2]) * (1 - known[:, 2:])
    brightest = light.amax(dim=1, keepdim=True)
    gray = (_sum(known * light) + lost * brightest) / (_sum(known) + lost)
    return light + (1 - known) * (gray - light).clamp(min=0)


def _unclipped(pixels: Tensor, fine: Tensor, gains: Gains, decoded: NDArray[np.float32]) -> Tensor:
    """``pixel_kernels.unclipped`` of all pixels."""
    inside, device = fine.clamp(max=FINE_BINS - 1), pixels.device
    gain, offset, missing = (on_device(np.ascontiguousarray(part.T), device)[inside] for part in gains[:3])
    light = gain * on_device(decoded, device)[pixels.to(torch.int64)] - offset
    return torch.where(_sum(missing) > 0, light + missing * (_sum(light) / _sum(1 - missing)), light)


def _mixed(light: Tensor, gains: Gains) -> Tensor:
    """``pixel_kernels.mixed`` of all pixels."""
    return light @ on_device(gains.matrix, light.device).T if gains.matrix.size else light


def _above_noise(light: Tensor, fine: Tensor, gains: Gains) -> Tensor:
    """``pixel_kernels.above_noise`` of all pixels."""
    noise = on_device(gains.noise, light.device)[fine.clamp(max=FINE_BINS - 1)][:, None]
    return 0.5 * (light + (light * light + 4 * noise * noise).sqrt())


def _sum(channels: Tensor) -> Tensor:
    return channels[:, :1] + channels[:, 1:2] + channels[:, 2:]


def _codes(light: Tensor, curve: Tensor, nearest: bool) -> Tensor:
    """Codes of light: of the nearest node of the curve, or interpolated between two."""
    place = (light * NODES + 0.5 * nearest).clamp(0, curve.numel() - 2)
    node = place.to(torch.int64)
    return curve[node] if nearest else curve[node] + (curve[node + 1] - curve[node]) * (place - node)
