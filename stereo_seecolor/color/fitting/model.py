"""The paper's two networks (DeepSeeColor, figs. backscatter-net and attenuation-net): 1x1 convolutions on a range map.

Every raw weight passes through a sigmoid (fractions of full scale) or a softplus (rates): bounded, and with a gradient everywhere.
The paper holds weights at or above zero (a rate clamped there has no gradient and never comes back) and ends in a
sigmoid (B >= 0.5).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional


class GatedExponentialDecay(nn.Module):
    """GED(x) = 1 where x <= 0, exp(-x) where x > 0."""

    def forward(self, x: Tensor) -> Tensor:
        """Elementwise."""
        return torch.exp(-x.clamp(min=0))


class ComplementaryGatedExponentialDecay(nn.Module):
    """CGED(x) = 1 - GED(x)."""

    def forward(self, x: Tensor) -> Tensor:
        """Elementwise."""
        return -torch.expm1(-x.clamp(min=0))


class RangeScale(nn.Module):
    """A 1x1 convolution without bias from the range to three channels: rate_c z. weight: (3, 1, 1, 1) before a softplus, 1/m."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(3, 1, 1, 1))

    def forward(self, range_m: Tensor) -> Tensor:
        """(B, 1, H, W) -> (B, 3, H, W)."""
        return functional.conv2d(range_m, functional.softplus(self.weight))


class Scale(nn.Module):
    """A diagonal 3x3 scaling, a grouped 1x1 convolution. weight: (3, 1, 1, 1) before a sigmoid (fraction) or a softplus (rate)."""

    def __init__(self, fraction: bool) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(3, 1, 1, 1))
        self.fraction = fraction

    def forward(self, x: Tensor) -> Tensor:
        """(B, 3, H, W) -> (B, 3, H, W)."""
        weight = torch.sigmoid(self.weight) if self.fraction else functional.softplus(self.weight)
        return functional.conv2d(x, weight, groups=3)


class BackscatterNet(nn.Module):
    """B_c(Z) = gamma_c CGED(beta_c Z) + eta_c GED(alpha_c Z), without the printed final sigmoid."""

    def __init__(self) -> None:
        super().__init__()
        self.gamma_inf, self.beta, self.eta, self.alpha = (
            Scale(fraction=True),
            RangeScale(),
            Scale(fraction=True),
            RangeScale(),
        )
        self.ged, self.cged = GatedExponentialDecay(), ComplementaryGatedExponentialDecay()

    def forward(self, range_m: Tensor) -> Tensor:
        """(B, 1, H, W) meters -> (B, 3, H, W) backscatter as a fraction of full scale."""
        saturating: Tensor = self.gamma_inf(self.cged(self.beta(range_m)))
        residual: Tensor = self.eta(self.ged(self.alpha(range_m)))
        return saturating + residual


class AttenuationNet(nn.Module):
    """A_c(Z) = GED(Z (w_c GED(v_c Z) + y_c GED(x_c Z)))."""

    def __init__(self) -> None:
        super().__init__()
        self.w, self.v, self.y, self.x = Scale(fraction=False), RangeScale(), Scale(fraction=False), RangeScale()
        self.ged = GatedExponentialDecay()

    def forward(self, range_m: Tensor) -> Tensor:
        """(B, 1, H, W) meters -> (B, 3, H, W) fraction of the light that arrives."""
        coefficient = self.w(self.ged(self.v(range_m))) + self.y(self.ged(self.x(range_m)))
        attenuation: Tensor = self.ged(range_m * coefficient)
        return attenuation
