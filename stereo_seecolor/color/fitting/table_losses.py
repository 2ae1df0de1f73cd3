"""The paper's losses and their gradients, computed exactly from the sums of a moment table, without its pixels.

For one channel, range bin l and threshold t let S_p(l, t) be the sum of v**p over the pixels of the bin with value v >= t. Then
    sum max(v - B, 0)        = S_1(B) - B S_0(B),
    sum max(v - B, 0)**2     = S_2(B) - 2 B S_1(B) + B**2 S_0(B),
    sum max(G d - 1, 0)**2   over d = v - B  = the same at the threshold B + 1/G, times G**2,
and every loss of the paper is made of such sums. See docs/theory.md.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.paper_losses import PAPER
from stereo_seecolor.compute.compiled import compiled

STEEPEST = 60.0
"""Optical depths beyond this count as this: exp(60) is finite, and far above any gain that a fit could want."""
FLAT = 1e-12
"""Standard deviation of J, fraction of full scale, below which it has no slope: an image of one color."""


class Channel(NamedTuple):
    """The sums of one channel that the losses are computed from.

    z: (L,) range of each occupied bin, meters. light: (V,) value of each bin. below: (L, V + 1, 3) sums of light**p, p = 0, 1, 2,
    over the bins before each. scale: 1 / (3 N), N the image's pixels.
    """

    z: NDArray[np.float64]
    light: NDArray[np.float64]
    below: NDArray[np.float64]
    scale: float


class Direct(NamedTuple):
    """The clamped direct signal D of one channel, for the attenuation loss.

    backscatter: (L,). sums: (L, 2) of D and D**2. floor, ceiling: the clamp. deviation: standard deviation of D.
    """

    backscatter: NDArray[np.float64]
    sums: NDArray[np.float64]
    floor: float
    ceiling: float
    deviation: float


@compiled
def sums_below(counts, light):  # type: ignore[no-untyped-def]
    """(L, V + 1, 3) sums of light**p over the bins before each, from counts (L, V)."""
    bins, values = counts.shape
    below = np.zeros((bins, values + 1, 3))
    for range_bin in range(bins):
        zeroth, first, second = 0.0, 0.0, 0.0
        for value in range(values):
            number = counts[range_bin, value]
            if number > 0:
                zeroth += number
                first += number * light[value]
                second += number * light[value] * light[value]
            below[range_bin, value + 1, 0] = zeroth
            below[range_bin, value + 1, 1] = first
            below[range_bin, value + 1, 2] = second
    return below


@compiled
def _first_at(light, threshold):  # type: ignore[no-untyped-def]
    """The first bin whose light is at least the threshold."""
    low, high = 0, light.size
    while low < high:
        middle = (low + high) >> 1
        if light[middle] < threshold:
            low = middle + 1
        else:
            high = middle
    return low


@compiled
def sigmoid(x):  # type: ignore[no-untyped-def]
    """1 / (1 + exp(-x)), without overflow."""
    return 1.0 / (1.0 + np.exp(-x)) if x > -700.0 else 0.0


@compiled
def softplus(x):  # type: ignore[no-untyped-def]
    """log(1 + exp(x)), without overflow."""
    return max(x, 0.0) + np.log1p(np.exp(-abs(x)))


@compiled
def backscatter_loss(raw, channel, penalty, slopes):  # type: ignore[no-untyped-def]
    """Mean of max(D, 0) - k min(D, 0), D = I - B(z), of one channel; its gradient by range bin in ``slopes`` (L, 4).

    raw: gamma and eta before a sigmoid, beta and alpha before a softplus, in the order gamma, beta, eta, alpha.
    """
    gamma, beta, eta, alpha = sigmoid(raw[0]), softplus(raw[1]), sigmoid(raw[2]), softplus(raw[3])
    to_gamma, to_beta, to_eta, to_alpha = gamma * (1.0 - gamma), sigmoid(raw[1]), eta * (1.0 - eta), sigmoid(raw[3])
    loss, last = 0.0, channel.light.size
    for range_bin in range(channel.z.size):
        z = channel.z[range_bin]
        path, residual = np.exp(-beta * z), np.exp(-alpha * z)
        backscatter = gamma * (1.0 - path) + eta * residual
        below, total = channel.below[range_bin, _first_at(channel.light, backscatter)], channel.below[range_bin, last]
        above_number, above_sum = total[0] - below[0], total[1] - below[1]
        loss += above_sum - backscatter * above_number + penalty * (backscatter * below[0] - below[1])
        slope = (penalty * below[0] - above_number) * channel.scale
        slopes[range_bin, 0] = slope * (1.0 - path) * to_gamma
        slopes[range_bin, 1] = slope * gamma * z * path * to_beta
        slopes[range_bin, 2] = slope * residual * to_eta
        slopes[range_bin, 3] = -slope * eta * z * residual * to_alpha
    return loss * channel.scale


@compiled
def direct_sums(channel, backscatter, floor, ceiling):  # type: ignore[no-untyped-def]
    """(L, 2) sums of D and D**2 over each range bin, D = min(max(I - B, floor), ceiling)."""
    sums = np.zeros((channel.z.size, 2))
    last = channel.light.size
    for range_bin in range(channel.z.size):
        b = backscatter[range_bin]
        low = channel.below[range_bin, _first_at(channel.light, b + floor)]
        high = channel.below[range_bin, _first_at(channel.light, b + ceiling)]
        number, first, second = high[0] - low[0], high[1] - low[1], high[2] - low[2]
        above = channel.below[range_bin, last, 0] - high[0]
        sums[range_bin, 0] = first - b * number + floor * low[0] + ceiling * above
        sums[range_bin, 1] = second - 2.0 * b * first + b * b * number + floor * floor * low[0] + ceiling * ceiling * above
    return sums


@compiled
def attenuation_loss(raw, channel, direct, slopes):  # type: ignore[no-untyped-def]
    """Saturation, intensity and variation of one channel of J = D / A(z), a third of each.

    slopes (L, 4): filled with the gradient by range bin.

    raw: w, v, y, x before a softplus.
    """
    w, v, y, x = softplus(raw[0]), softplus(raw[1]), softplus(raw[2]), softplus(raw[3])
    bins, number = channel.z.size, 1.0 / (3.0 * channel.scale)
    gain = np.empty(bins)
    mean, square = 0.0, 0.0
    for range_bin in range(bins):
        z = channel.z[range_bin]
        gain[range_bin] = np.exp(min(z * (w * np.exp(-v * z) + y * np.exp(-x * z)), STEEPEST))
        mean += gain[range_bin] * direct.sums[range_bin, 0]
        square += gain[range_bin] * gain[range_bin] * direct.sums[range_bin, 1]
    mean, square = mean / number, square / number
    deviation = np.sqrt(max(square - mean * mean, 0.0))
    loss = ((mean - PAPER.target) ** 2 + (deviation - direct.deviation) ** 2) / 3.0
    pull = (deviation - direct.deviation) / deviation if deviation > FLAT else 0.0
    to_w, to_v, to_y, to_x = sigmoid(raw[0]), sigmoid(raw[1]), sigmoid(raw[2]), sigmoid(raw[3])
    for range_bin in range(bins):
        z, g = channel.z[range_bin], gain[range_bin]
        first, second = direct.sums[range_bin, 0], direct.sums[range_bin, 1]
        by_gain = 2.0 / 3.0 / number * ((mean - PAPER.target) * first + pull * (g * second - mean * first))
        if g * direct.ceiling > 1.0:
            excess, slope = _saturation(channel, direct, range_bin, g)
            loss += excess * channel.scale
            by_gain += slope * channel.scale
        near, far = np.exp(-v * z), np.exp(-x * z)
        by_rate = by_gain * g * z if z * (w * near + y * far) < STEEPEST else 0.0
        slopes[range_bin, 0] = by_rate * near * to_w
        slopes[range_bin, 1] = -by_rate * w * z * near * to_v
        slopes[range_bin, 2] = by_rate * far * to_y
        slopes[range_bin, 3] = -by_rate * y * z * far * to_x
    return loss


@compiled
def _saturation(channel, direct, range_bin, gain):  # type: ignore[no-untyped-def]
    """Sum of max(gain D - 1, 0)**2 over a range bin, and its slope by the gain."""
    b = direct.backscatter[range_bin]
    threshold = max(1.0 / gain, direct.floor)
    low = channel.below[range_bin, _first_at(channel.light, b + threshold)]
    high = channel.below[range_bin, _first_at(channel.light, b + direct.ceiling)]
    number, value, value_square = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    first = value - b * number
    second = value_square - 2.0 * b * value + b * b * number
    above = channel.below[range_bin, channel.light.size, 0] - high[0]
    first += above * direct.ceiling
    second += above * direct.ceiling**2
    number += above
    if gain * direct.floor > 1.0:
        number += low[0]
        first += low[0] * direct.floor
        second += low[0] * direct.floor**2
    return gain * gain * second - 2.0 * gain * first + number, 2.0 * (gain * second - first)
