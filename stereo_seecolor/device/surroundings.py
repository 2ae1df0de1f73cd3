"""Sub-pixel refinement, confidence and speckles of disparities on a device: ``matching.refine``,
``context``, ``fattening``, ``confidence`` and ``speckles`` in torch, map by map.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from stereo_seecolor.matching.confidence import BORDER_PX, WEIGHTS
from stereo_seecolor.matching.context import EVERY, NEIGHBORHOOD, ROUGHEST_PX
from stereo_seecolor.matching.fattening import ALONE_LEVELS, NOISE_LEVELS, REACH, SAME_PX, STEP_PX
from stereo_seecolor.matching.gray import LARGE_IMAGE_PX
from stereo_seecolor.matching.refine import (
    LARGEST_STEP_PX,
    MATCHING_STD_PX,
    SAMPLES,
    SMOOTHED,
    WINDOW,
)
from stereo_seecolor.matching.speckles import PER_PX

_BITS_PER_NAT = float(1 / np.log(2))


class Refined(NamedTuple):
    """(H, W) maps of ``refine_rows``: refined disparity, its standard error, support, relief."""

    disparity: Tensor
    std: Tensor
    support: Tensor
    relief: Tensor


def refine(left: Tensor, right: Tensor, disparity: Tensor, best: Tensor) -> Refined:
    """One step of registration over a window (Lucas and Kanade 1981), as
    ``matching.refine.refine_rows``.

    left, right: (H, W) gray, float32. disparity, best: (H, W) as in ``MatchedDisparity``.
    """
    base = _smoothed(disparity)
    samples = _residuals(left, right, base, contrast_gain(left, right))
    known_part, g, e, gg, ge, ee, d = F.avg_pool2d(samples[None], WINDOW, 1, WINDOW // 2)[0]
    known = 1 / known_part.clamp(min=0.02)
    g, e = g * known, e * known
    gg = (gg * known - g * g).clamp(min=1e-6)
    ge = ge * known - g * e
    noise = (ee * known - e * e - ge * ge / gg).clamp(min=1e-4)
    weight = known_part * SAMPLES / noise
    information = gg * weight + 1 / MATCHING_STD_PX**2
    step = (ge * weight / information).clamp(-LARGEST_STEP_PX, LARGEST_STEP_PX)
    here = base.where(base.isfinite(), best)
    return Refined(here + step, information.rsqrt(), known_part, (here - d * known).abs())


def contrast_gain(left: Tensor, right: Tensor) -> Tensor:
    """As ``matching.refine.contrast_gain``."""
    of_left, of_right = (
        image[::4, ::4].to(torch.float64).std(correction=0) for image in (left, right)
    )
    return (of_left / of_right.clamp(min=1e-6)).to(torch.float32)


def _smoothed(disparity: Tensor) -> Tensor:
    """The mean with neighbors within a pixel, five a row, then five rows; ends are kept."""
    reach = SMOOTHED // 2
    width = disparity.shape[1]
    inner = [disparity[:, reach + k : width - reach + k] for k in (-2, -1, 1, 2)]
    across = disparity.clone()
    across[:, reach : width - reach] = _mean_near(disparity[:, reach : width - reach], inner)
    rows = F.pad(across[None, None], (0, 0, reach, reach), mode="replicate")[0, 0]
    return _mean_near(across, [rows[reach + k : reach + k + len(across)] for k in (-2, -1, 1, 2)])


def _mean_near(center: Tensor, neighbors: list[Tensor]) -> Tensor:
    total, count = center.clone(), torch.ones_like(center)
    for other in neighbors:
        near = (other - center).abs() < 1
        total, count = total + other.where(near, 0), count + near
    return total / count


def _residuals(left: Tensor, right: Tensor, disparity: Tensor, gain: Tensor) -> Tensor:
    """(7, H, W) samples 1, g, e, g g, g e, e e, d, gray levels of 8 bits; 0 if unknown."""
    width = disparity.shape[1]
    x = torch.arange(width, device=left.device, dtype=torch.float32)
    place = x - disparity
    inside = (place >= 1) & (place < width - 3) & (x > 0) & (x < width - 1)
    whole = place.where(inside, 1).to(torch.int64)
    t = (place - whole).where(inside, 0)
    a, b, c, f = (right.gather(1, whole + k) for k in (-1, 0, 1, 2))
    # Catmull-Rom through b and c
    c1, c2, c3 = (0.5 * (c - a), a - 2.5 * b + 2 * c - 0.5 * f, 0.5 * (f - a) + 1.5 * (b - c))
    value = b + t * (c1 + t * (c2 + t * c3))
    slope = c1 + t * (2 * c2 + 3 * t * c3)
    own = F.pad(0.5 * (left[:, 2:] - left[:, :-2]), (1, 1))
    one = inside.to(torch.float32)
    g, e = one / 256 * (0.5 * gain * slope + 0.5 * own), one / 256 * (gain * value - left)
    return torch.stack([one, g, e, g * g, g * e, e * e, disparity.where(inside, 0)])


class LocalContext(NamedTuple):
    """``Context`` as tensors of samples (h, w)."""

    known: Tensor
    roughness: Tensor
    disparity: Tensor
    farthest: Tensor
    levels: Tensor


def surroundings(disparity: Tensor, best: Tensor, left: Tensor) -> LocalContext:
    """As ``Context.of``. left: (H, W) gray."""
    sampled, checked, levels = (_samples(values) for values in (best, disparity, left))
    there, known = sampled.isfinite().to(torch.float32), sampled.nan_to_num()
    mean = _blur(known, 3) / _blur(there, 3).clamp(min=0.1)
    departure = (known - mean).abs().clamp(max=ROUGHEST_PX) * there
    roughness = _blur(departure, NEIGHBORHOOD) / _blur(there, NEIGHBORHOOD).clamp(min=0.01)
    found = sampled.where(sampled.isfinite(), torch.inf)
    farthest = -F.max_pool2d(-found[None], 5, 1, 2)[0]
    return LocalContext(
        _blur(checked.isfinite().to(torch.float32), NEIGHBORHOOD),
        roughness,
        found,
        farthest,
        levels / 256,
    )


def _samples(image: Tensor) -> Tensor:
    first = EVERY // 2
    return image[first::EVERY, first::EVERY]


def _blur(image: Tensor, size: int) -> Tensor:
    wide = F.pad(image[None, None], (size // 2,) * 4, mode="reflect")
    return F.avg_pool2d(wide, size, 1)[0, 0]


def log_odds(uniqueness: Tensor, refined: Refined, around: LocalContext) -> Tensor:
    """(H, W) log odds, base 2, before fattening, as ``weigh_rows``."""
    samples = (
        WEIGHTS.known * around.known
        + WEIGHTS.roughness * (around.roughness + WEIGHTS.least_relief_px).log()
        + WEIGHTS.offset
    )
    wide = F.interpolate(samples[None, None], scale_factor=EVERY, mode="bilinear")[0, 0]
    height, width = uniqueness.shape
    wide = F.pad(
        wide[None, None],
        (0, max(0, width - wide.shape[1]), 0, max(0, height - wide.shape[0])),
        mode="replicate",
    )[0, 0]
    nats = (
        WEIGHTS.uniqueness * uniqueness.clamp(max=1).sqrt()
        + WEIGHTS.support * refined.support
        + wide[:height, :width]
    )
    return nats * _BITS_PER_NAT + WEIGHTS.relief * (refined.relief + WEIGHTS.least_relief_px).log2()


def fattening(
    best: Tensor, left: Tensor, around: LocalContext, odds: Tensor, least: float
) -> Tensor:
    """(H, W) as ``matching.fattening.fattening``."""
    height, width = best.shape
    rows, columns = (
        (torch.arange(side, device=best.device) // EVERY).clamp(max=number - 1)
        for side, number in zip(best.shape, around.farthest.shape, strict=True)
    )
    level = left / 256
    disparity, levels = (
        F.pad(around.disparity, (REACH,) * 4, value=torch.nan),
        F.pad(around.levels, (REACH,) * 4),
    )
    behind, n_behind, own, n_own = torch.zeros((4, height, width), device=best.device)
    for j in range(2 * REACH + 1):
        for i in range(2 * REACH + 1):
            there, gray = (samples[rows + j][:, columns + i] for samples in (disparity, levels))
            apart = there - best
            is_behind, is_own = apart < -STEP_PX, apart.abs() <= SAME_PX
            behind, n_behind = behind + gray * is_behind, n_behind + is_behind
            own, n_own = own + gray * is_own, n_own + is_own
    to_behind = (level - behind / n_behind.clamp(min=1)).abs() + NOISE_LEVELS
    to_own = (level - own / n_own).abs().where(n_own > 0, ALONE_LEVELS) + NOISE_LEVELS
    looked_at = (odds >= least) & (best > around.farthest[rows][:, columns] + STEP_PX)
    likeness: Tensor = (to_own / (to_behind + to_own)).where(looked_at, 0)
    return likeness


def judge(odds: Tensor, fat: Tensor, disparity: Tensor, least: float) -> tuple[Tensor, Tensor]:
    """Disparity, NaN where it is not confident enough, and confidence, as ``judge_rows``."""
    chance = torch.sigmoid((odds / _BITS_PER_NAT) + WEIGHTS.fattening * fat)
    width = disparity.shape[1]
    met = torch.arange(width, device=odds.device) - disparity
    kept = (chance >= least) & (met >= BORDER_PX) & (met <= width - 1 - BORDER_PX)
    return disparity.where(kept, torch.nan), chance


def remove_speckles(disparity: Tensor, pixels: int) -> Tensor:
    """As ``matching.speckles.remove_speckles``, into a new map. Patches are found by FastSV (Zhang,
    Azad, Hu 2020).
    """
    every = 2 if disparity.numel() > LARGE_IMAGE_PX else 1
    thin = disparity[::every, ::every]
    fixed = (thin * PER_PX).nan_to_num(nan=-1e6).to(torch.int32)
    known = thin.isfinite()
    place = torch.arange(fixed.numel(), device=fixed.device).view(fixed.shape)
    pairs = []
    for one, other in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
        ((slice(None, -1),), (slice(1, None),)),
    ):
        joined = known[one] & known[other] & ((fixed[one] - fixed[other]).abs() <= PER_PX)
        pairs += [(place[one][joined], place[other][joined])]
    ends = torch.cat([torch.stack(pair) for pair in pairs], dim=1)
    u, v = torch.cat([ends, ends.flip(0)], dim=1)
    parent = place.flatten()
    while True:
        above = parent[parent]
        lower = torch.minimum(parent, above)
        lower.scatter_reduce_(0, parent[u], above[v], "amin")
        lower.scatter_reduce_(0, u, above[v], "amin")
        if torch.equal(lower, parent):
            break
        parent = lower
    size = torch.bincount(parent, minlength=parent.numel())[parent].view(fixed.shape)
    speckle = (size <= pixels // every**2).repeat_interleave(every, 0).repeat_interleave(every, 1)
    return disparity.masked_fill(speckle[: disparity.shape[0], : disparity.shape[1]], torch.nan)
