"""The light of pixels without the water, and its displayed values: one formula each.

On the processor ``lookup`` reads a table of these formulas for 8-bit pixels; others are computed.
Pixels are also counted here, on any device of torch.
"""

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from stereo_seecolor.color.device import one_thread
from stereo_seecolor.color.render.display import NODES, Display
from stereo_seecolor.color.render.lookup import FINE_SHIFT, Shown, count_full, fine_bins, look_up
from stereo_seecolor.color.render.water_gains import FINE_BINS, Gains
from stereo_seecolor.color.table.torch_counting import on_device, pixels_on, positions
from stereo_seecolor.compute.threads import in_parts

CPU = torch.device("cpu")
PART_PIXELS = 65536
"""Least pixels of a thread: for fewer, another thread takes longer to start."""


class Tensors(NamedTuple):
    """``Gains`` and ``Display`` on a device; tables have one more bin for unknown range."""

    gain: Tensor
    offset: Tensor
    missing: Tensor
    capped: Tensor
    noise: Tensor
    matrix: Tensor
    decoded: Tensor
    known: Tensor
    curve: Tensor
    shoulder: Tensor

    @classmethod
    def of(cls, gains: Gains, shown: Display, device: torch.device) -> "Tensors":
        """Copy both to this device."""
        by_bin = (
            np.pad(part.T, ((0, 1), (0, 0))) for part in (gains.gain, gains.offset, gains.missing)
        )
        rest = (
            gains.capped,
            np.pad(gains.noise, (0, 1)),
            gains.matrix,
            shown.decoded,
            shown.known,
            shown.curve,
            shown.shoulder,
        )
        return cls(*(on_device(np.ascontiguousarray(part), device) for part in (*by_bin, *rest)))


def on_processor(
    image: NDArray[Any],
    bits: NDArray[np.int32],
    gains: Gains,
    shown: Display,
    bright: NDArray[Any],
) -> tuple[Shown, float]:
    """Correct (N, 3) pixels at (N,) ranges, given as float32 bits, on the processor. bright (N, 3):
    values by which clipped pixels are known.

    Returns the corrected pixels, and the fraction of pixels with a range that are at full scale.
    """
    out = Shown(
        np.zeros(image.shape, image.dtype),
        np.empty(bits.size, np.bool_),
        np.zeros(bits.size, np.bool_),
    )
    fine, met = np.empty(bits.size, np.uint32), list[tuple[int, int, int]]()

    def count(a: int, b: int) -> None:
        met.append(fine_bins(bits[a:b], fine[a:b], out.unknown[a:b]))

    in_parts(count, bits.size, PART_PIXELS)
    known = sum(number for _, _, number in met)
    if not known:
        return out, 0.0
    tensors = Tensors.of(gains, shown, CPU)
    looked_up = image.dtype == np.uint8 and not gains.matrix.size
    if looked_up:
        bins = slice(min(near for near, _, _ in met), max(far for _, far, _ in met) + 1)
        with one_thread():
            table, factors = code_table(tensors, shown, bins), np.zeros(0, np.float32)
            if not shown.values.size:  # highlights roll off, by a pixel's greatest code
                factors = _factor(torch.arange(65536.0), tensors.shoulder).numpy()
    first_capped = int(np.argmax(shown.known < 1))
    numbers, top = list[int](), np.iinfo(image.dtype).max

    def part(a: int, b: int) -> None:
        shown_part = out.image[a:b].reshape(-1)
        if looked_up:
            special, roll_off = np.empty(b - a, np.uint32), (factors, shown.shoulder[4])
            limits = gains.capped, first_capped
            number = look_up(
                image[a:b].reshape(-1),
                bright[a:b].reshape(-1),
                fine[a:b],
                table,
                roll_off,
                limits,
                special,
                shown_part,
            )
            at = special[:number].astype(np.int64) + a
        else:
            at = a + np.flatnonzero(~out.unknown[a:b])
        for some in np.array_split(at, len(at) // PART_PIXELS + 1) if len(at) else ():
            with one_thread():
                values, lost = _displayed(
                    pixels_on(image[some], CPU),
                    pixels_on(bright[some], CPU),
                    torch.from_numpy(fine[some].astype(np.int32)),
                    tensors,
                    top == 255,
                )
            out.image[some], out.unrecoverable[some] = values.numpy(), lost.numpy()
        numbers.append(count_full(shown_part, top))

    in_parts(part, bits.size, PART_PIXELS)
    return out, sum(numbers) / known


def apply_on(
    pixels: Tensor, bright: Tensor, bits: Tensor, gains: Gains, shown: Display, eight: bool
) -> tuple[Tensor, Tensor, Tensor, float]:
    """Correct (N, 3) pixels at (N,) ranges, given as bits, on a device. bright: as in
    ``on_processor``. eight: 8 bits, else 16.

    Returns int32 pixels, masks of unknown ranges and of lost colors, and the clipped fraction.
    """
    device, fine = pixels.device, (positions(bits) >> FINE_SHIFT).to(torch.int32)
    tensors, unknown = Tensors.of(gains, shown, device), fine == FINE_BINS
    values, lost = _displayed(pixels, bright, fine, tensors, eight)
    if eight and not gains.matrix.size:
        known = (_at(tensors.known, bright.to(torch.int32)) == 1).all(dim=1)
        plain = ~_at(tensors.capped, fine) & known & ~unknown
        table = on_device(
            code_table(tensors, shown, slice(0, FINE_BINS)).astype(np.float32), device
        )
        row = fine[plain][:, None] * 3 + torch.arange(3, device=device)
        codes = table[(row * 256 + pixels[plain]).to(torch.int64)]
        values[plain] = (
            codes.to(torch.int32) if shown.values.size else _rolled_off(codes, tensors, 255)
        )
    values[unknown] = 0
    clipped = int((values == (255 if eight else 65535)).any(dim=1).sum()) / max(
        int((~unknown).sum()), 1
    )
    return values, unknown, lost & ~unknown, clipped


def linear(
    image: NDArray[Any], bits: NDArray[np.int32], gains: Gains, shown: Display
) -> NDArray[np.float32]:
    """Compute linear light, (N, 3) float32, neither clipped nor encoded; 0 where unknown."""
    out, tensors = np.empty(image.shape, np.float32), Tensors.of(gains, shown, CPU)

    def part(a: int, b: int) -> None:
        fine = (positions(torch.from_numpy(bits[a:b])) >> FINE_SHIFT).to(torch.int32)
        light = _mixed(
            _unclipped(pixels_on(image[a:b], CPU).to(torch.int32), fine, tensors), tensors
        )
        out[a:b] = torch.where((fine == FINE_BINS)[:, None], 0, light).numpy()

    in_parts(part, bits.size, PART_PIXELS)
    return out


def code_table(tensors: Tensors, shown: Display, bins: slice) -> NDArray[Any]:
    """Compute the code of each 8-bit value in each of these fine bins, (1025 * 768,), or its
    displayed value without roll-off; black for unknown range; other rows are not set.
    """
    light = tensors.gain[bins, :, None] * tensors.decoded - tensors.offset[bins, :, None]
    node = (
        (_above_noise(light, tensors.noise[bins, None, None]) * NODES + 0.5)
        .clamp_(max=tensors.curve.numel() - 1)
        .to(torch.int32)
    )
    curve = shown.values if shown.values.size else shown.codes
    table = np.empty((FINE_BINS + 1, 768), curve.dtype)
    np.take(curve, node.view(len(node), 768).cpu().numpy(), out=table[bins], mode="clip")
    table[-1] = curve[0]
    return table.reshape(-1)


def _displayed(
    pixels: Tensor, bright: Tensor, fine: Tensor, tensors: Tensors, eight_bits: bool
) -> tuple[Tensor, Tensor]:
    """Displayed values (N, 3) int32 of pixels at (N,) fine bins, and where color is lost (N,)."""
    known = _at(tensors.known, bright.to(torch.int32))
    light = _mixed(_with_clipped(_unclipped(pixels.to(torch.int32), fine, tensors), known), tensors)
    place = (
        _above_noise(light, _at(tensors.noise, fine)[:, None]) * NODES + 0.5 * eight_bits
    ).clamp_(0, tensors.curve.numel() - 2)
    node = place.to(torch.int32)
    codes = _at(tensors.curve, node)
    if not eight_bits:  # between two nodes
        codes = codes + (_at(tensors.curve, node + 1) - codes) * (place - node)
    top = 255 if eight_bits else 65535
    return _rolled_off(codes, tensors, top), _at(tensors.capped, fine) | (known == 0).any(dim=1)


def _at(table: Tensor, index: Tensor) -> Tensor:
    """``table[index]``, which torch does several times sooner this way."""
    return table.index_select(0, index.reshape(-1)).view(*index.shape, *table.shape[1:])


def _unclipped(pixels: Tensor, fine: Tensor, tensors: Tensors) -> Tensor:
    """Linear light. What a limited gain leaves out is taken from channels with less noise."""
    light = _at(tensors.gain, fine) * _at(tensors.decoded, pixels) - _at(tensors.offset, fine)
    if not tensors.missing.any():
        return light
    missing = _at(tensors.missing, fine)
    return torch.where(
        _sum(missing) > 0, light + missing * (_sum(light) / _sum(1 - missing)), light
    )


def _with_clipped(light: Tensor, known: Tensor) -> Tensor:
    """Light in which clipped channels are as bright as the others, or as the brightest."""
    if not (known < 1).any():
        return light
    lost = (1 - known[:, :1]) * (1 - known[:, 1:2]) * (1 - known[:, 2:])
    gray = (_sum(known * light) + lost * light.amax(dim=1, keepdim=True)) / (_sum(known) + lost)
    return light + (1 - known) * (gray - light).clamp(min=0)


def _mixed(light: Tensor, tensors: Tensors) -> Tensor:
    """The channels after the color matrix, if there is one."""
    return light @ tensors.matrix.T if tensors.matrix.numel() else light


def _above_noise(light: Tensor, noise: Tensor) -> Tensor:
    """Light where it stands out of the noise, else the noise: equal channels, gray."""
    return 0.5 * (light + (light * light + 4 * noise * noise).sqrt())


def _rolled_off(codes: Tensor, tensors: Tensors, top: int = 255) -> Tensor:
    """Displayed values of codes (N, 3)."""
    factor = _factor(codes.amax(dim=1, keepdim=True), tensors.shoulder)
    return (codes * factor - tensors.shoulder[4]).clamp(0, top).to(torch.int32)


def _factor(code: Tensor, shoulder: Tensor) -> Tensor:
    """Values per code, by a pixel's greatest code: less above the knee (``display.display``)."""
    knee, length, bend, unit, _ = shoulder.unbind()
    over, code = (code - knee).clamp(min=0), code.clamp(min=1e-30)
    above = over * (length + over * bend) / (length + over)
    return (torch.minimum(code, knee) + above) / code * unit


def _sum(channels: Tensor) -> Tensor:
    return channels[:, :1] + channels[:, 1:2] + channels[:, 2:]
