"""The semi-global search of ``matching.sgm`` in torch, on any device: the same costs, bands, strips
and checks, to the bit.

The four paths are loops over whole planes of pixels (``along``), which any device runs; on a CUDA
device with Triton each is a kernel (``triton_paths``). A disparity outside of a tile's band costs
FAR, so that one array of costs holds tiles of any bands. The strips of an image are matched side by
side: (S, rows, W), each with the rows beyond its ends in which its vertical paths settle.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from stereo_seecolor.matching.census import PATTERN
from stereo_seecolor.matching.sgm import search as compiled
from stereo_seecolor.matching.sgm.search import FAR, P1_SHIFT, PENALTIES, TILE, Band

VOLUME_BYTES = {"cpu": 1 << 26}
"""Bytes of costs held at once, by type of device; larger pairs go in groups of strips."""
VOLUME_BYTES_GPU = 1 << 30
_BORDER = 3


Along = Callable[[Tensor, Tensor, Tensor, slice], None]
"""along(cost, p2, total, kept): adds to total[:, kept] the costs of the paths along the second
axis, in both directions.

cost: (S, L, M, D) uint8. p2: (S, L + 1, M) uint8, of the step from l - 1 to l. total: (S, L, M, D)
int16. kept: some of the steps.
"""


class FoundDisparities(NamedTuple):
    """(H, W) float32 each, as in ``MatchedDisparity``."""

    disparity: Tensor
    best: Tensor
    uniqueness: Tensor


class _Strips(NamedTuple):
    """The strips of a pair, (S, rows, W): census of both images, P2 of the steps down (one row
    more) and across (one column more), and where the image has rows.
    """

    left: Tensor
    right: Tensor
    down: Tensor
    across: Tensor
    inside: Tensor


BEYOND = (0, 0, PENALTIES.p2, PENALTIES.p2, 0)
"""What the same hold beyond the image."""


def search(left: Tensor, right: Tensor, band: Band, along: Along | None = None) -> FoundDisparities:
    """``matching.sgm.search.search`` of two gray images (H, W), float32 of whole numbers 0..65535.

    along: in place of the device's own.
    """
    height, constants = len(left), compiled.CONSTANTS
    number, tiles = -(-height // constants.strip), constants.strip // TILE
    down, across = penalties(left)
    here = (census(left), census(right), down, across, torch.ones_like(left, dtype=torch.bool))
    strips = _Strips(
        *(
            _cut(rows, number, len(rows) - height, beyond)
            for rows, beyond in zip(here, BEYOND, strict=True)
        )
    )
    paths = along or paths_for(left.device)
    found = _match(strips, band, range(number), paths)
    narrow = _of_tiles(found[3].flatten(0, 1)[:height]) > constants.band_edge_pixels * TILE**2
    for s in range(number):
        own = np.zeros_like(narrow)
        own[s * tiles : (s + 1) * tiles] = narrow[s * tiles : (s + 1) * tiles]
        if narrow[s * tiles : (s + 1) * tiles].mean() > constants.band_edge_tiles:
            found[:, s] = _match(strips, band.widened(own), range(s, s + 1), paths)[:, 0]
    return FoundDisparities(*found[:3].flatten(1, 2)[:, :height])


def paths_for(device: torch.device) -> Along:
    """Triton's kernels on a CUDA device where Triton is installed; else the loops."""
    if device.type == "cuda":
        try:
            from stereo_seecolor.device.triton_paths import along as kernels
        except ImportError:
            return along
        return kernels
    return along


def along(cost: Tensor, p2: Tensor, total: Tensor, kept: slice) -> None:
    """The paths as a loop (see ``Along``), both directions (Hirschmueller 2008, eq. 13)."""
    steps = cost.shape[1]
    before = torch.zeros((2, cost.shape[0], *cost.shape[2:]), dtype=torch.int16, device=cost.device)
    for i in range(steps):
        places = i, steps - 1 - i
        here = torch.stack([cost[:, place] for place in places])
        penalty = torch.stack([p2[:, i], p2[:, steps - i]])[..., None].to(torch.int16)
        before.masked_fill_(here == FAR, FAR)  # what only the band before holds is not carried over
        least = before.amin(-1, keepdim=True)
        wide = F.pad(before, (1, 1), value=FAR)
        beside = torch.minimum(wide[..., :-2], wide[..., 2:]).add_(penalty >> P1_SHIFT)
        before = (
            torch.minimum(torch.minimum(before, beside), least + penalty)
            .sub_(least)
            .add_(here)
            .clamp_(max=FAR)
        )
        for place, path in zip(places, before, strict=True):
            if kept.start <= place < kept.stop:
                total[:, place] += path


def census(gray: Tensor) -> Tensor:
    """(H, W) int32 of a gray image, as ``matching.census.census``."""
    height, width = gray.shape
    wide = F.pad(gray[None, None], (_BORDER,) * 4, mode="replicate")[0, 0]
    bits = torch.zeros(gray.shape, dtype=torch.int32, device=gray.device)
    for dy, dx in PATTERN.tolist():
        bits = 2 * bits + (
            wide[_BORDER + dy : _BORDER + dy + height, _BORDER + dx : _BORDER + dx + width] < gray
        )
    return bits


def penalties(gray: Tensor) -> tuple[Tensor, Tensor]:
    """P2 of steps down, (H + 1, W), and across, (H, W + 1), uint8, as ``penalties.p2_maps``."""

    def p2(change: Tensor) -> Tensor:
        texture, scale = 256 * PENALTIES.texture_levels, 1 / (256 * PENALTIES.edge_levels)
        cost = PENALTIES.p2 / (1 + (change.abs() - texture).clamp(min=0) * scale)
        return cost.clamp(min=PENALTIES.p2_least).to(torch.uint8)

    down = F.pad(p2(gray[1:] - gray[:-1]), (0, 0, 1, 1), value=PENALTIES.p2)
    return down, F.pad(p2(gray[:, 1:] - gray[:, :-1]), (1, 1), value=PENALTIES.p2)


def _cut(rows: Tensor, number: int, more: int, beyond: int) -> Tensor:
    """(H + more, W) -> (number, strip + 2 halo + more, W); rows outside hold ``beyond``."""
    strip, halo = compiled.CONSTANTS.strip, compiled.CONSTANTS.halo
    whole = F.pad(rows, (0, 0, halo, number * strip + halo + more - len(rows)), value=beyond)
    return whole.unfold(0, strip + 2 * halo + more, strip)[:number].transpose(1, 2)


def _match(strips: _Strips, band: Band, which: Sequence[int], along: Along) -> Tensor:
    """(4, n, strip, W) of some strips: disparity, best, uniqueness, and 1 where the best lies on
    the edge of its band.
    """
    constants = compiled.CONSTANTS
    device, (_, tall, width) = strips.left.device, strips.left.shape
    halo, rows = constants.halo // TILE, np.arange(tall // TILE)
    of_strips = [
        np.clip(s * (constants.strip // TILE) - halo + rows, 0, len(band.lowest) - 1) for s in which
    ]
    lowest, above = (
        band.lowest[np.stack(of_strips)],
        (band.lowest + band.count)[np.stack(of_strips)],
    )
    first = int(lowest.min())
    number = -(-(int(above.max()) - first) // TILE) * TILE
    group = max(1, VOLUME_BYTES.get(device.type, VOLUME_BYTES_GPU) // (tall * width * number))
    parts = []
    for k in range(0, len(which), group):
        bands = torch.from_numpy(
            np.stack([lowest[k : k + group], above[k : k + group]]) - first
        ).to(device)
        own = _Strips(*(part[which[k] : which[k] + bands.shape[1]] for part in strips))
        parts.append(_match_group(own, bands, (first, number), along))
    return torch.cat(parts, dim=1)


def _match_group(
    strips: _Strips, bands: Tensor, disparities: tuple[int, int], along: Along
) -> Tensor:
    """As _match. bands: (2, n, tiles down, tiles across) first and last + 1 of each tile, counted
    from disparities[0] on.
    """
    constants, width = compiled.CONSTANTS, strips.left.shape[2]
    kept = slice(constants.halo, constants.halo + constants.strip)
    cost = torch.stack(
        [
            _costs(*strip, disparities)
            for strip in zip(*strips[:2], strips.inside, bands.unbind(1), strict=True)
        ]
    )
    total = torch.zeros(cost.shape, dtype=torch.int16, device=cost.device)
    along(cost, strips.down, total, kept)
    inner, rows = (part[:, kept].transpose(1, 2) for part in (cost, total))
    along(inner, strips.across[:, kept].transpose(1, 2), rows, slice(0, width))
    return torch.stack([_judge(rows, disparities[0]) for rows in total[:, kept]], dim=1)


def _costs(
    left: Tensor, right: Tensor, inside: Tensor, band: Tensor, disparities: tuple[int, int]
) -> Tensor:
    """(rows, W, D) uint8 bits in which the census differs; FAR outside of the tile's band, 0 in
    rows outside of the image: with it a path has not begun.
    """
    (first, number), (height, width) = disparities, left.shape
    before, after = max(0, first + number - 1), max(0, -first)
    start = before - first - number + 1
    met = (
        F.pad(right, (before, after))[:, start : start + width + number - 1]
        .unfold(1, number, 1)
        .flip(2)
    )
    cost = bits_in(left[..., None] ^ met)
    low, above = (
        side.repeat_interleave(TILE, 0)[:height].repeat_interleave(TILE, 1)[:, :width, None]
        for side in band
    )
    d = torch.arange(number, device=left.device, dtype=low.dtype)
    cost.masked_fill_((d < low) | (d >= above), FAR)
    return cost.masked_fill_(~inside[..., None], 0)


def bits_in(different: Tensor) -> Tensor:
    """The number of bits, uint8, of each difference of two census."""
    return _bits_of(different.device).index_select(0, different.flatten()).view(different.shape)


@functools.lru_cache(maxsize=4)
def _bits_of(device: torch.device) -> Tensor:
    """(2^22,) uint8 number of bits of each difference of two census."""
    bits = np.zeros(1 << len(PATTERN), np.uint8)
    for k in range(len(PATTERN)):
        bits[1 << k : 2 << k] = bits[: 1 << k] + 1
    return torch.from_numpy(bits).to(device)


def _judge(total: Tensor, first: int) -> Tensor:
    """(4, rows, W) of summed costs (rows, W, D), as ``_match``."""
    _, width, number = total.shape
    device = total.device
    best = total.argmin(2)
    around = (
        F.pad(total, (1, 1), value=4 * FAR)
        .gather(2, best[..., None] + torch.arange(3, device=device))
        .to(torch.int32)
    )
    below, least, above = around.unbind(2)
    d = torch.arange(number, device=device)
    second = total.masked_fill((d - best[..., None]).abs() <= 1, 4 * FAR).amin(2)
    edge = (below >= 4 * FAR) | (above >= 4 * FAR)
    uniqueness = (second - least).to(torch.float32) * np.float32(1 / PENALTIES.p2).item()
    bend = (torch.maximum(below, above) - least).clamp(min=1).to(torch.float32)
    disparity = (best + first).to(torch.float32) + 0.5 * (below - above).to(torch.float32) / bend
    met = torch.arange(width, device=device) - best - first
    chosen = _claims(total, first).gather(1, met.clamp(0, width - 1))
    possible = ~edge & (met >= 0) & (met < width)
    good = (
        possible
        & (uniqueness >= np.float32(compiled.CONSTANTS.ambiguous).item())
        & ((disparity - chosen).abs() <= 1)
    )
    unknown = torch.full_like(disparity, torch.nan)
    return torch.stack(
        [
            disparity.where(good, unknown),
            disparity.where(possible, unknown),
            uniqueness,
            edge.to(torch.float32),
        ]
    )


def _claims(total: Tensor, first: int) -> Tensor:
    """(rows, W) the disparity that each pixel of the right image chooses among all pixels of the
    left one that look at it.
    """
    height, width, number = total.shape
    before, after = max(0, -first), max(0, first + number - 1)
    wide = F.pad(total, (0, 0, before, after), value=4 * FAR + 1)
    size = wide.shape[1] * number
    looking = wide.as_strided(
        (height, width, number), (size, number, number + 1), (before + first) * number
    )
    return looking.argmin(2) + first


def _of_tiles(pixels: Tensor) -> np.ndarray:
    """Sums over tiles of an (H, W) map."""
    height, width = pixels.shape
    whole = F.pad(pixels[None], (0, -width % TILE, 0, -height % TILE))
    return F.avg_pool2d(whole, TILE)[0].cpu().numpy() * TILE**2
