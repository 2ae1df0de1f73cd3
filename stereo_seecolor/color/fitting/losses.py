"""The paper's losses per pixel, as means, so that neither k nor the learning rate depends on an image's size."""

import torch
from torch import Tensor

from stereo_seecolor.color.fitting.paper_losses import PAPER

LEAST_VARIANCE = 1e-24
"""Under the root of a standard deviation: gives one color a gradient."""


def backscatter_loss(direct: Tensor, penalty: float) -> Tensor:
    """Mean of max(D, 0) - k min(D, 0); the paper's eq. bs-loss prints + k min(D, 0), which rewards negative D without bound.

    direct: (B, 3, H, W) = I - B.
    """
    return (direct.clamp(min=0) - penalty * direct.clamp(max=0)).mean()


def clamp_direct(direct: Tensor) -> Tensor:
    """D within five standard deviations of its channel's mean, and within [0, 1]."""
    mean, deviation = direct.mean(dim=(2, 3), keepdim=True), _deviation(direct)[..., None, None]
    low, high = (mean - PAPER.clamp_deviations * deviation).clamp(0, 1), (mean + PAPER.clamp_deviations * deviation).clamp(0, 1)
    return torch.minimum(torch.maximum(direct, low), high)


def attenuation_loss(true_color: Tensor, direct: Tensor) -> Tensor:
    """Saturation + intensity + variation of J against the clamped direct signal D, both (B, 3, H, W)."""
    saturation = (true_color - 1).clamp(min=0).square().mean()
    intensity = (true_color.mean(dim=(2, 3)) - PAPER.target).square().mean()
    variation = (_deviation(true_color) - _deviation(direct)).square().mean()
    return saturation + intensity + variation


def _deviation(x: Tensor) -> Tensor:
    """(B, 3) standard deviation of each channel (over N, so that one pixel has 0), with a gradient where it is 0."""
    mean = x.mean(dim=(2, 3), keepdim=True)
    return (x - mean).square().mean(dim=(2, 3)).clamp(min=LEAST_VARIANCE).sqrt()
