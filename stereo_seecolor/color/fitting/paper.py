"""The paper's method (DeepSeeColor; Jamieson, How, Girdhar 2023): two small networks over range,
trained by Adam.

    I = B(z) + D,  D = A(z) J

The first network is B(z), trained to leave D small but not negative; the second is A(z), trained so
that J = D / A has the contrast of D, a mean of a half, and no values above full scale. A 1x1
convolution of a range map is a product, so the networks are the functions of ``water.physics`` with
raw weights before a sigmoid or a softplus. A loss is a sum over pixels of a function of channel,
range and
value: running sums of a moment table give its exact value and gradient without the pixels
(docs/lab/theory.md).
"""

import time
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import pad, softplus

from stereo_seecolor.color.device import one_thread
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_bins
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import PaperConfig
from stereo_seecolor.records import Water
from stereo_seecolor.water import physics

BACKSCATTER, ATTENUATION = ("gamma_inf", "beta", "eta", "alpha"), ("w", "v", "y", "x")
"""The four weights a channel of each network."""
FRACTIONS = ("gamma_inf", "eta")
"""Weights that are fractions of full scale; the others are rates, 1/m."""
COLD = {
    "gamma_inf": 0.1,
    "beta": 0.2,
    "eta": 0.02,
    "alpha": 1.0,
    "w": 0.1,
    "v": 0.1,
    "y": 0.1,
    "x": 0.1,
}
"""The water before any training: thin backscatter, attenuation of 0.2 per meter."""
LEAST = 1e-6
"""Fractions stay at least this far from 0 and 1, rates above it, so that raw weights are finite."""
CLAMP_DEVIATIONS = 5.0
"""The direct signal is clamped to so many standard deviations about its mean (row 5)."""
PENALTY = 1000.0
"""k of the backscatter loss: cost of a negative direct signal relative to a positive one (row 1).
"""
LEARNING_RATE = 0.03
"""Adam's."""
TARGET = 0.5
"""Mean of a corrected channel in the intensity loss, fraction of full scale (row 6)."""
LEAST_VARIANCE = 1e-24
"""Added under the root of a standard deviation, so that an image of one color has a gradient."""
LEAST_TRANSMISSION = 1e-26
"""Least A: its inverse is finite, far above any useful gain."""


def fit(
    table: MomentTable,
    config: PaperConfig,
    encoding: InputEncoding,
    start: Water | None = None,
    until_s: float | None = None,
) -> Water:
    """Train the networks: ``config.iterations`` steps, ``iterations_per_frame`` from ``start``, the
    water of a frame of the same scene. until_s: of ``time.perf_counter``, after which no step but
    the first begins. Returns the water of the last weights, without standard errors.
    """
    with one_thread():
        training = Training(table, config, encoding, start)
        for _ in range(config.iterations if start is None else config.iterations_per_frame):
            training.step()
            if until_s is not None and time.perf_counter() > until_s:
                break
        return training.water


class Training:
    """The training of both networks on one moment table; ``water`` is available after any step."""

    def __init__(
        self,
        table: MomentTable,
        config: PaperConfig,
        encoding: InputEncoding,
        start: Water | None = None,
    ) -> None:
        self._config, self._encoding, self._sums = config, encoding, Sums(table, encoding)
        start = (
            start
            if start is not None and (start.final_sigmoid > 0) == config.final_sigmoid
            else None
        )
        self._backscatter = Adam(raw_weights(BACKSCATTER, start), LEARNING_RATE)
        self._attenuation = Adam(raw_weights(ATTENUATION, start), LEARNING_RATE)

    def step(self) -> None:
        """Make one step of Adam for each network; attenuation is trained on the direct signal."""
        sums, raw = self._sums, self._backscatter.weights
        self._backscatter.step(
            backscatter_loss(sums, backscatter(raw, sums.z, self._config.final_sigmoid), PENALTY)
        )
        with torch.no_grad():
            direct = Direct(sums, backscatter(raw, sums.z, self._config.final_sigmoid))
        self._attenuation.step(
            attenuation_loss(sums, direct, 1 / attenuation(self._attenuation.weights, sums.z))
        )

    @property
    def water(self) -> Water:
        """Return the water of the present weights."""
        final = self._config.final_sigmoid
        values = (
            *_values(self._backscatter.weights.detach(), final),
            *softplus(self._attenuation.weights.detach()),
        )
        named = {
            name: value[:, 0].numpy()
            for name, value in zip(BACKSCATTER + ATTENUATION, values, strict=True)
        }
        return Water(**named, input_encoding=self._encoding, final_sigmoid=float(final))


def backscatter(raw: Tensor, z: Tensor, final_sigmoid: bool = False) -> Tensor:
    """The backscatter network (fig. backscatter-net): (3, L), of weights (4, 3, 1) at (L,) ranges.

    final_sigmoid: the sigmoid is the last layer, as printed, and gamma_inf and eta have any sign.
    """
    found = physics.backscatter(z, *_values(raw, final_sigmoid))
    return cast(Tensor, torch.sigmoid(found) if final_sigmoid else found)


def attenuation(raw: Tensor, z: Tensor) -> Tensor:
    """The attenuation network (fig. attenuation-net): (3, L), of (4, 3, 1) at (L,) ranges."""
    return cast(Tensor, physics.attenuation(z, *softplus(raw)).clamp(min=LEAST_TRANSMISSION))


def _values(raw: Tensor, final_sigmoid: bool) -> tuple[Tensor, ...]:
    """gamma_inf, beta, eta, alpha of raw weights."""
    rates, light = softplus(raw), raw if final_sigmoid else torch.sigmoid(raw)
    return light[0], rates[1], light[2], rates[3]


def raw_weights(names: tuple[str, ...], water: Water | None) -> Tensor:
    """Convert parameters of a water, or COLD, to weights before sigmoid or softplus: (4, 3, 1)."""

    def raw(name: str) -> NDArray[np.float64]:
        value = np.full(3, COLD[name]) if water is None else getattr(water, name)
        if name not in FRACTIONS:
            above = np.maximum(value, LEAST)
            return np.asarray(above + np.log(-np.expm1(-above)))
        if water is not None and water.final_sigmoid:
            return np.asarray(value)
        inside = np.clip(value, LEAST, 1 - LEAST)
        return np.asarray(np.log(inside) - np.log1p(-inside))

    return torch.from_numpy(np.stack([raw(name) for name in names])[..., None])


class Adam:
    """Adam's steps (Kingma, Ba 2015, algorithm 1); torch.optim takes 1 s to import."""

    def __init__(self, weights: Tensor, learning_rate: float) -> None:
        self.weights = weights.requires_grad_()
        self._rate, self._steps = learning_rate, 0
        self._mean, self._square = torch.zeros_like(weights), torch.zeros_like(weights)

    def step(self, loss: Tensor) -> None:
        """Make one step down the gradient of this loss."""
        (gradient,) = torch.autograd.grad(loss, self.weights)
        self._steps += 1
        with torch.no_grad():
            self._mean.mul_(0.9).add_(gradient, alpha=0.1)
            self._square.mul_(0.999).addcmul_(gradient, gradient, value=0.001)
            size = (self._square / (1 - 0.999**self._steps)).sqrt_().add_(1e-8)
            self.weights.addcdiv_(self._mean, size, value=-self._rate / (1 - 0.9**self._steps))


class Sums:
    """A moment table's running sums. z (L,): meters. light (V,). pixels: their number. below (3, L,
    V + 1, 3): sums of light to the powers 0, 1, 2 over the values before each.
    """

    def __init__(self, table: MomentTable, encoding: InputEncoding) -> None:
        occupied = np.flatnonzero(table.pixels)
        self.z, self.pixels = torch.from_numpy(table.range_m[occupied]), int(table.pixels.sum())
        self.light = torch.from_numpy(decoded_bins(table.bit_depth, encoding))
        powers = torch.stack([torch.ones_like(self.light), self.light, self.light**2], -1)
        counts = torch.from_numpy(table.counts[:, occupied].astype(np.float64))
        self.below = pad((counts[..., None] * powers).cumsum(2), (0, 0, 1, 0))
        self.total = self.below[:, :, -1]

    def under(self, threshold: Tensor) -> Tensor:
        """(3, L, 3) sums over the values below a threshold (3, L)."""
        first = torch.searchsorted(self.light, threshold.detach().contiguous())
        return self.below.gather(2, first[..., None, None].expand(-1, -1, 1, 3))[:, :, 0]


def backscatter_loss(sums: Sums, veil: Tensor, penalty: float) -> Tensor:
    """Compute the mean of max(D, 0) - k min(D, 0), D = I - veil (3, L); penalty: k. The paper
    prints + k min(D, 0) (eq. bs-loss), which rewards negative D.
    """
    below = sums.under(veil)
    above = sums.total - below
    total = above[..., 1] - veil * above[..., 0] + penalty * (veil * below[..., 0] - below[..., 1])
    return total.sum() / (3 * sums.pixels)


class Direct:
    """D = I - B within five standard deviations of its channel's mean, and within [0, 1].

    floor, ceiling (3, 1): these limits. sums (3, L, 2): of D and its square. deviation (3,).
    """

    def __init__(self, sums: Sums, veil: Tensor) -> None:
        number, first, second = sums.total.unbind(-1)
        mean = (first - veil * number).sum(1, True) / sums.pixels
        variance = (second - 2 * veil * first + veil**2 * number).sum(
            1, True
        ) / sums.pixels - mean**2
        width = CLAMP_DEVIATIONS * variance.clamp(min=0).sqrt()
        self.veil = veil
        self.floor = (mean - width).clamp(0, 1)
        self.ceiling = (mean + width).clamp(0, 1)
        self.low, self._high = sums.under(veil + self.floor), sums.under(veil + self.ceiling)
        self._above = number - self._high[..., 0]
        at_floor = torch.stack(
            [self.floor * self.low[..., 0], self.floor**2 * self.low[..., 0]], -1
        )
        self.sums = self.above(self.low)[..., 1:] + at_floor
        mean, square = (self.sums.sum(1) / sums.pixels).unbind(-1)
        self.deviation = (square - mean**2).clamp(min=0).sqrt()

    def above(self, low: Tensor) -> Tensor:
        """(3, L, 3) pixels and sums of D and D^2, without those in ``low`` (3, L, 3)."""
        number, first, second = (self._high - low).unbind(-1)
        direct = first - self.veil * number + self.ceiling * self._above
        square = (
            second - 2 * self.veil * first + self.veil**2 * number + self.ceiling**2 * self._above
        )
        return torch.stack([number + self._above, direct, square], -1)


def attenuation_loss(sums: Sums, direct: Direct, gain: Tensor) -> Tensor:
    """Saturation + intensity + variation of J = gain D (the paper's). gain (3, L): 1 / A."""
    first = (gain * direct.sums[..., 0]).sum(1) / sums.pixels
    square = (gain**2 * direct.sums[..., 1]).sum(1) / sums.pixels
    deviation = (square - first**2).clamp(min=LEAST_VARIANCE).sqrt()
    low = sums.under(direct.veil + torch.maximum(1 / gain, direct.floor))
    number, light, light2 = direct.above(low).unbind(-1)
    at_floor = (gain * direct.floor > 1) * direct.low[..., 0]
    number = number + at_floor
    light = light + at_floor * direct.floor
    light2 = light2 + at_floor * direct.floor**2
    over = (gain**2 * light2 - 2 * gain * light + number) * (gain * direct.ceiling > 1)
    return (
        over.sum() / (3 * sums.pixels)
        + ((first - TARGET) ** 2 + (deviation - direct.deviation) ** 2).mean()
    )
