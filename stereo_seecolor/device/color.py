"""The color stage on a device, as ``color.corrector`` does it on the processor: count, fill holes,
remove the water, bound colors.

The fit and the choice of the exposure take the moment table, 0.8 MB, on the processor.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render import torch_apply
from stereo_seecolor.color.render.apply import brighter, corrected
from stereo_seecolor.color.render.carried import SAMPLE, Smoother
from stereo_seecolor.color.render.carried_colors import SETTINGS, bounds_of
from stereo_seecolor.color.render.display import Tone, display
from stereo_seecolor.color.render.lookup import Shown
from stereo_seecolor.color.render.water_gains import gains
from stereo_seecolor.color.table.counting import check_pair
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_bins import VALUE_BINS
from stereo_seecolor.color.table.torch_counting import count_pixels
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.device.memory import Memory
from stereo_seecolor.records import Correction, Image, Map, Mask, Water

ATTENUATION = 0.25
"""Of lambda from one pass of the smoother to the next, as in OpenCV's."""


class DeviceCorrector(Corrector):
    """A Corrector whose pixels stay on a device."""

    def __init__(self, memory: Memory, config: ColorConfig | None = None) -> None:
        super().__init__(config)
        self._memory = memory

    def carry_ranges(self, image: Image, range_m: Map, seen: Mask | None = None) -> Map:
        """As ``Corrector.carry_ranges``."""
        known = np.isfinite(range_m)
        if known.all() or not known.any():
            return range_m
        whole = carry_ranges(self._memory.tensor(image), self._memory.tensor(range_m))
        return self._memory.array(
            whole
            if seen is None
            else whole.where(self._memory.tensor(seen), self._memory.tensor(range_m))
        )

    def within_measured(self, image: NDArray[Any], carried: Mask, measured: Mask) -> NDArray[Any]:
        """As ``Corrector.within_measured``."""
        every = slice(None, None, SETTINGS.every_px), slice(None, None, SETTINGS.every_px)
        bounds = bounds_of(image[every], measured[every]) if carried.any() else None
        if bounds is None:
            return image
        limits = (torch.from_numpy(limit).to(self._memory.device) for limit in bounds)
        return self._memory.array(
            within(
                self._memory.tensor(image),
                torch.from_numpy(carried).to(self._memory.device),
                *limits,
            )
        )

    def _count(self, image: Image, range_m: Map, every: int = 1) -> MomentTable:
        check_pair(image, range_m)
        depth, rows = (8 if image.dtype == np.uint8 else 16), slice(every // 2, None, every)
        counts, sums = count(
            self._memory.tensor(image)[rows], self._memory.tensor(range_m)[rows], VALUE_BINS[depth]
        )
        return MomentTable(counts.cpu().numpy(), sums.cpu().numpy(), depth)

    def _correct(
        self, image: Image, range_m: Map, water: Water, tone: Tone, camera: Image | None
    ) -> Correction:
        check_pair(image, range_m)
        bright = brighter(image, camera)
        by_range = gains(water, self.config, tone.exposure)
        tables = display(8 * image.dtype.itemsize, self.config.encoding, tone.highlights)
        pixels, bits = _pixels(self._memory.tensor(image)), _bits(self._memory.tensor(range_m))
        shown, unknown, unrecoverable, clipped = torch_apply.apply_on(
            pixels,
            _pixels(self._memory.tensor(bright)),
            bits,
            by_range,
            tables,
            image.dtype == np.uint8,
        )
        shown = shown.to(torch.uint8 if image.dtype == np.uint8 else torch.uint16).view(image.shape)
        written_to = self.config.unknown_pixels == "raw"
        whole = shown.cpu().numpy() if written_to else self._memory.array(shown)
        masks = (mask.cpu().numpy().reshape(image.shape[:2]) for mask in (unknown, unrecoverable))
        return corrected(image, bright, Shown(whole, *masks), clipped, water, tone, self.config)


def count(image: Tensor, range_m: Tensor, values: int) -> tuple[Tensor, Tensor]:
    """Counts and offset sums of a moment table, of an image (H, W, 3) and ranges (H, W)."""
    pixels = _pixels(image)
    return count_pixels(pixels, _bits(range_m), values)


def _pixels(image: Tensor) -> Tensor:
    flat = image.reshape(-1, 3)
    return flat if image.dtype == torch.uint8 else flat.to(torch.int32)


def _bits(range_m: Tensor) -> Tensor:
    return range_m.contiguous().view(torch.int32).flatten()


def carry_ranges(image: Tensor, range_m: Tensor) -> Tensor:
    """``carried.carry_ranges`` of an image (H, W, 3) and its ranges (H, W), some of them known."""
    smoother = Smoother()
    known = range_m.isfinite()
    height, width = range_m.shape
    size = tuple(max(round(side / smoother.step_px), 1) for side in (height, width))
    step = tuple(min(smoother.step_px, side) for side in (height, width))
    full = 1.0 if image.dtype == torch.uint8 else 1 / 257
    channels = image.to(torch.float32).permute(2, 0, 1)
    guide = (_areas(channels, size, step).round() * full).round()
    filled = range_m.where(known, 0)
    cells = height / size[0], width / size[1]
    total, density = _areas(torch.stack([filled, known.to(torch.float32)]), size, cells)
    mean_m = torch.where(density > 0, total / density.clamp(min=1e-30), 0)
    sampled = mean_m[::SAMPLE, ::SAMPLE][density[::SAMPLE, ::SAMPLE] > 0]
    ends = torch.tensor([smoother.strays, 1 - smoother.strays], device=image.device)
    near_m, far_m = (
        torch.quantile(sampled, ends)
        if len(sampled)
        else torch.tensor([0.0, torch.inf], device=image.device)
    )
    weight = density * mean_m**2 * ((mean_m >= near_m) & (mean_m <= far_m))
    farther = smoother.farther * weight.sum() / (density > 0).sum()
    carried = torch.quantile(mean_m[density > 0], 0.5).expand_as(weight)
    for reach, passes in smoother.reaches:
        both = torch.stack([weight * mean_m + farther * carried, weight + farther])
        over, under = smooth(guide, both, reach, smoother.color_sigma, passes)
        carried = over / under
    lowest, highest = range_m[known].aminmax()
    carried = carried.clamp(torch.maximum(near_m, lowest), torch.minimum(far_m, highest))
    large = F.interpolate(carried[None, None], (height, width), mode="bilinear")[0, 0]
    return range_m.where(known, large)


def _areas(images: Tensor, size: tuple[int, ...], step: tuple[float, ...]) -> Tensor:
    """(N, H, W) reduced to (N, *size), each pixel the mean of a cell of ``step`` pixels (down,
    across), as cv2.INTER_AREA.
    """
    down, across = (
        _cells(number, length, cell).to(images.device)
        for number, length, cell in zip(size, images.shape[1:], step, strict=True)
    )
    return down @ images @ across.T


def _cells(number: int, length: int, step: float) -> Tensor:
    first = torch.arange(number, dtype=torch.float64)[:, None] * step
    pixel = torch.arange(length, dtype=torch.float64)
    inside = (torch.minimum(first + step, pixel + 1) - torch.maximum(first, pixel)).clamp(min=0)
    return (inside / inside.sum(1, keepdim=True)).to(torch.float32)


def smooth(guide: Tensor, values: Tensor, reach: float, color_sigma: float, passes: int) -> Tensor:
    """The fast global smoother (Min et al. 2014) of (N, H, W) values along rows and columns, with
    edges of a guide (C, H, W).
    """
    across, down = (
        -(-(guide.diff(dim=axis).square().sum(0).sqrt()) / color_sigma).exp() for axis in (2, 1)
    )
    for _ in range(passes):
        values = _solve(reach * across, values)
        values = _solve(reach * down.T, values.mT).mT
        reach *= ATTENUATION
    return values


def _solve(beside: Tensor, values: Tensor) -> Tensor:
    """Solve the tridiagonal systems of all rows at once, by cyclic reduction. beside: (H, W - 1),
    values: (N, H, W).
    """
    a, c = F.pad(beside, (1, 0)), F.pad(beside, (0, 1))
    b = 1 - a - c
    step, width = 1, values.shape[-1]
    while step < width:
        before, after = (step, 0), (0, step)
        lower = -a / F.pad(b, before, value=1.0)[:, :width]
        upper = -c / F.pad(b, after, value=1.0)[:, step:]
        a_before, c_before = (F.pad(part, before)[:, :width] for part in (a, c))
        a_after, c_after = (F.pad(part, after)[:, step:] for part in (a, c))
        b = b + lower * c_before + upper * a_after
        values = (
            values
            + lower * F.pad(values, before)[..., :width]
            + upper * F.pad(values, after)[..., step:]
        )
        a, c, step = lower * a_before, upper * c_after, 2 * step
    return values / b


def within(image: Tensor, carried: Tensor, most: Tensor, least: Tensor) -> Tensor:
    """``carried_colors.within_measured`` of an image (H, W, 3), given its bounds (3,)."""
    pixels = image.to(torch.float32).clamp(min=0)
    others = torch.stack([pixels[..., [1, 2]], pixels[..., [0, 2]], pixels[..., [0, 1]]], dim=2)
    full = (
        255.0
        if image.dtype == torch.uint8
        else 65535.0
        if image.dtype == torch.uint16
        else torch.inf
    )
    limited = pixels.clamp(others.amin(3) * least, (others.amax(3) * most).clamp(max=full))
    changed = (limited != pixels).any(2, keepdim=True) & _wide(carried)[..., None]
    whole = image if image.dtype == torch.float32 else image.to(torch.int32)
    return torch.where(changed, limited.to(whole.dtype), whole).to(image.dtype)


def _wide(carried: Tensor) -> Tensor:
    """(H, W) True in carried areas at least ``hole_px`` wide, and what joins them."""
    side = SETTINGS.hole_px
    core = _largest(-_largest(-carried.to(torch.float32), side), side)
    return carried & (_largest(core, 2 * side + 1) > 0)


def _largest(image: Tensor, side: int) -> Tensor:
    rows = F.max_pool2d(image[None], (1, side), 1, (0, side // 2))
    return F.max_pool2d(rows, (side, 1), 1, (side // 2, 0))[0]
