"""The paper's networks and losses over every pixel, by torch's own layers and optimizer: what
moment tables must equal.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

TARGET, DEVIATIONS, LEAST_VARIANCE = 0.5, 5.0, 1e-24


def ged(x: Tensor) -> Tensor:
    return torch.exp(-x.clamp(min=0))


class Network(nn.Module):
    """raw: (4, 3, 1) weights before a sigmoid or a softplus, each (3, 1, 1, 1) kernel of a 1x1
    convolution.
    """

    def __init__(self, raw: Tensor) -> None:
        super().__init__()
        self.raw = nn.Parameter(raw.detach().clone())

    def scaled(self, z: Tensor, which: int) -> Tensor:
        return functional.conv2d(z, functional.softplus(self.raw[which])[..., None, None])

    def weighed(self, x: Tensor, which: int, positive=functional.softplus) -> Tensor:
        return functional.conv2d(x, positive(self.raw[which])[..., None, None], groups=3)


class Backscatter(Network):
    """(B, 1, H, W) meters -> (B, 3, H, W)."""

    final_sigmoid = False

    def forward(self, z: Tensor) -> Tensor:
        inner = (lambda x: x) if self.final_sigmoid else torch.sigmoid
        found = self.weighed(1 - ged(self.scaled(z, 1)), 0, inner) + self.weighed(
            ged(self.scaled(z, 3)), 2, inner
        )
        return torch.sigmoid(found) if self.final_sigmoid else found


class Attenuation(Network):
    """(B, 1, H, W) meters -> (B, 3, H, W)."""

    def forward(self, z: Tensor) -> Tensor:
        return ged(
            z * (self.weighed(ged(self.scaled(z, 1)), 0) + self.weighed(ged(self.scaled(z, 3)), 2))
        )


def backscatter_loss(direct: Tensor, penalty: float) -> Tensor:
    return (direct.clamp(min=0) - penalty * direct.clamp(max=0)).mean()


def clamp_direct(direct: Tensor) -> Tensor:
    mean, width = (
        direct.mean(dim=(2, 3), keepdim=True),
        DEVIATIONS * deviation(direct)[..., None, None],
    )
    return torch.minimum(
        torch.maximum(direct, (mean - width).clamp(0, 1)), (mean + width).clamp(0, 1)
    )


def attenuation_loss(true_color: Tensor, direct: Tensor) -> Tensor:
    saturation = (true_color - 1).clamp(min=0).square().mean()
    intensity = (true_color.mean(dim=(2, 3)) - TARGET).square().mean()
    return saturation + intensity + (deviation(true_color) - deviation(direct)).square().mean()


def deviation(x: Tensor) -> Tensor:
    mean = x.mean(dim=(2, 3), keepdim=True)
    return (x - mean).square().mean(dim=(2, 3)).clamp(min=LEAST_VARIANCE).sqrt()


def train(
    light: Tensor,
    z: Tensor,
    veil: Backscatter,
    dimming: Attenuation,
    steps: int,
    penalty: float = 1000.0,
) -> None:
    """Steps of both networks by torch.optim.Adam. light (1, 3, H, W), z (1, 1, H, W)."""
    of_veil, of_dimming = (
        torch.optim.Adam(network.parameters(), lr=0.03) for network in (veil, dimming)
    )
    for _ in range(steps):
        of_veil.zero_grad()
        backscatter_loss(light - veil(z), penalty).backward()
        of_veil.step()
        direct = clamp_direct(light - veil(z)).detach()
        of_dimming.zero_grad()
        attenuation_loss(direct / dimming(z), direct).backward()
        of_dimming.step()
