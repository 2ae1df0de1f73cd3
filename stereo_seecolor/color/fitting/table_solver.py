"""The paper's fit from moment tables: for each channel four parameters of backscatter, then four of attenuation, by quasi-Newton.

No loss of the paper couples channels, so that the 24 parameters are six problems of four.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.paper_losses import PAPER
from stereo_seecolor.color.fitting.parameters import (
    ATTENUATION,
    BACKSCATTER,
    COLD,
    fractions,
    rates,
    raw_fractions,
    raw_rates,
    water_of,
)
from stereo_seecolor.color.fitting.table_losses import Channel, Direct, attenuation_loss, backscatter_loss, direct_sums, sums_below
from stereo_seecolor.color.fitting.table_search import SEARCH, curvature, loss_of, minimize
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_bins
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.records import Water

Four = NDArray[np.float64]
"""The four parameters of one channel's backscatter or attenuation."""


@dataclass(frozen=True)
class ErrorSettings:
    """Standard errors at a minimum: which weights the image constrains."""

    least_curvature: float = 1e-7
    """Fraction of the steepest direction's curvature; a flatter direction is not constrained by the image."""
    most_unconstrained: float = 0.01
    """Squared cosine of a weight with such directions, above which its error is unknown."""
    most_error: float = 3.0
    """Largest standard error of a raw weight: a factor of twenty of the parameter, which is no measurement."""


ERRORS = ErrorSettings()


@dataclass(frozen=True)
class Guesses:
    """Where searches begin; the lowest of the minima that they lead to is taken."""

    above_darkest: float = 0.02
    """Backscatter far away above the mean of the darkest pixels, fraction of full scale."""
    flat: float = 0.2
    """Optical depth of backscatter at the mean range for the flat guess; 1 for the steep one."""
    attenuation: tuple[tuple[float, float, float, float], ...] = (
        (0.5, 0.1, 0.5, 0.1),
        (0.3, 0.02, 2.0, 2.0),
        (0.5, 0.02, 20.0, 4.0),
    )
    """w, v, y, x of three guesses, flat to steep; w and y in rates that lift the mean to a half, v and x in 1 / mean range."""
    least_mean: float = 1e-3
    """Fraction of full scale that a black channel's mean counts as."""
    least_depth: float = 0.1
    """Least optical depth at the mean range: a bright image, too, is seen through water."""


GUESSES = Guesses()
IS_FRACTION = np.array([True, False, True, False])
NOTHING = Direct(np.zeros(0), np.zeros((0, 2)), 0.0, 1.0, 0.0)


def fit(table: MomentTable, penalty: float, encoding: InputEncoding, start: Water | None = None) -> Water:
    """The water that minimizes the paper's losses over the table's pixels (at least one), with standard errors."""
    found, errors = np.empty((8, 3)), np.empty((8, 3))
    for c, channel in enumerate(channels(table, encoding)):
        backscatter, attenuation = (
            (None, None) if start is None else (_parameters(start, BACKSCATTER, c), _parameters(start, ATTENUATION, c))
        )
        found[:4, c], errors[:4, c] = fit_backscatter(channel, penalty, backscatter)
        found[4:, c], errors[4:, c] = fit_attenuation(channel, direct_signal(channel, found[:4, c]), attenuation)
    return replace(water_of(found, encoding), standard_errors=dict(zip(BACKSCATTER + ATTENUATION, errors, strict=True)))


def fit_backscatter(channel: Channel, penalty: float, start: Four | None) -> tuple[Four, Four]:
    """gamma_inf, beta, eta, alpha of one channel at the least loss, and their standard errors."""
    guesses = [_raw_backscatter(guess) for guess in _backscatter_guesses(channel, penalty)]
    raw = _best(0, None if start is None else _raw_backscatter(start), guesses, channel, NOTHING, penalty)
    found = np.where(IS_FRACTION, fractions(raw), rates(raw))
    slope = np.where(IS_FRACTION, found * (1 - found), fractions(raw))
    return found, slope * _standard_errors(0, raw, channel, NOTHING, penalty)


def fit_attenuation(channel: Channel, direct: Direct, start: Four | None) -> tuple[Four, Four]:
    """Parameters w, v, y, x of one channel at the least loss, and their standard errors."""
    guesses = [raw_rates(guess) for guess in _attenuation_guesses(channel, direct)]
    raw = _best(1, None if start is None else raw_rates(start), guesses, channel, direct, 0.0)
    return rates(raw), fractions(raw) * _standard_errors(1, raw, channel, direct, 0.0)


def losses(table: MomentTable, water: Water, penalty: float) -> tuple[float, float]:
    """The paper's backscatter and attenuation losses of a water over the table's pixels (at least one)."""
    backscatter, attenuation = 0.0, 0.0
    for c, channel in enumerate(channels(table, water.input_encoding)):
        four, slopes = _parameters(water, BACKSCATTER, c), np.empty((channel.z.size, 4))
        backscatter += backscatter_loss(_raw_backscatter(four), channel, penalty, slopes)
        direct = direct_signal(channel, four)
        attenuation += attenuation_loss(raw_rates(_parameters(water, ATTENUATION, c)), channel, direct, slopes)
    return backscatter, attenuation


def channels(table: MomentTable, encoding: InputEncoding) -> list[Channel]:
    """The table's three channels, in linear light, with their running sums."""
    occupied = np.flatnonzero(table.pixels)
    light = decoded_bins(table.bit_depth, encoding)
    scale = 1.0 / (3.0 * table.pixels.sum())
    z = table.range_m[occupied]
    return [Channel(z, light, sums_below(table.counts[c, occupied], light), scale) for c in range(3)]


def direct_signal(channel: Channel, parameters: NDArray[np.float64]) -> Direct:
    """D = I - B, clamped to five standard deviations about its mean, then to [0, 1], as the sums of the attenuation loss."""
    gamma, beta, eta, alpha = parameters
    backscatter = gamma * -np.expm1(-beta * channel.z) + eta * np.exp(-alpha * channel.z)
    number = 1.0 / (3.0 * channel.scale)
    total = channel.below[:, -1]
    mean = float((total[:, 1] - backscatter * total[:, 0]).sum() / number)
    square = float((total[:, 2] - 2 * backscatter * total[:, 1] + backscatter**2 * total[:, 0]).sum() / number)
    width = PAPER.clamp_deviations * np.sqrt(max(square - mean**2, 0.0))
    floor, ceiling = (float(np.clip(limit, 0.0, 1.0)) for limit in (mean - width, mean + width))
    sums = direct_sums(channel, backscatter, floor, ceiling)
    mean, square = sums.sum(axis=0) / number
    return Direct(backscatter, sums, floor, ceiling, float(np.sqrt(max(square - mean**2, 0.0))))


def _best(
    which: int,
    warm: Four | None,
    guesses: list[Four],
    channel: Channel,
    direct: Direct,
    penalty: float,
) -> Four:
    """The lowest minimum. The search starts from ``warm`` if its loss is below that of every guess, else from each guess."""
    slopes, gradient = np.empty((channel.z.size, 4)), np.empty(4)
    begin = [loss_of(which, raw, channel, direct, penalty, slopes, gradient) for raw in guesses]
    if warm is not None and loss_of(which, warm, channel, direct, penalty, slopes, gradient) <= min(begin):
        return _minimum(which, warm, channel, direct, penalty, SEARCH.warm_steps)[1]
    minima = [_minimum(which, raw, channel, direct, penalty, SEARCH.cold_steps) for raw in guesses]
    loss, best = min(minima, key=lambda minimum: minimum[0])
    for _ in range(SEARCH.most_restarts):  # a kink can hold the search; without what it learned of the curvature it may get away
        again, found = _minimum(which, best, channel, direct, penalty, SEARCH.cold_steps)
        if again > (1 - SEARCH.least_gain) * loss:
            break
        loss, best = again, found
    return best


def _minimum(which: int, raw: Four, channel: Channel, direct: Direct, penalty: float, steps: int) -> tuple[float, Four]:
    loss, found = minimize(which, raw, channel, direct, penalty, steps)
    return loss, found


def _standard_errors(which: int, raw: NDArray[np.float64], channel: Channel, direct: Direct, penalty: float) -> NDArray[np.float64]:
    """(4,) standard errors of raw weights at a minimum, NaN where the image does not constrain a weight.

    The sandwich of an M-estimator (Huber 1967), H^-1 (sum of g g^T) H^-1, with the range bins as its independent parts g:
    pixels of one range err together, by the same range error and the same lack of something dark.
    """
    bins = channel.z.size
    if bins <= 2 * raw.size:
        return np.full(raw.size, np.nan)
    slopes, hessian = np.empty((bins, 4)), np.empty((4, 4))
    curvature(which, raw, channel, direct, penalty, slopes, hessian)
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
    seen = values > ERRORS.least_curvature * max(values[-1], 1e-300)
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    errors = np.sqrt(np.diag(inverse @ (slopes.T @ slopes) @ inverse) * bins / (bins - raw.size))
    constrained = (vectors[:, ~seen] ** 2).sum(axis=1) < ERRORS.most_unconstrained
    return np.where(constrained & (errors < ERRORS.most_error), errors, np.nan)


def _parameters(water: Water, names: tuple[str, ...], channel: int) -> NDArray[np.float64]:
    return np.array([getattr(water, name)[channel] for name in names])


def _raw_backscatter(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(IS_FRACTION, raw_fractions(parameters), raw_rates(parameters))


def _backscatter_guesses(channel: Channel, penalty: float) -> list[NDArray[np.float64]]:
    """From the darkest of each range bin, which is what the loss looks for: in one bin its optimum is the 1 / (1 + k) quantile."""
    number = channel.below[:, -1, 0]
    reached = channel.below[:, 1:, 0] > (number / (1 + penalty))[:, None]
    darkest = channel.light[reached.argmax(axis=1)]
    middle_m = float(np.average(channel.z, weights=number))
    low = float(np.average(darkest, weights=number))
    gamma = low + GUESSES.above_darkest
    steep, flat = [gamma, 1 / middle_m, low, 1 / middle_m], [gamma, GUESSES.flat / middle_m, 0.5 * low, GUESSES.flat / middle_m]
    return [np.array(steep), np.array(flat), np.array([COLD.gamma_inf, COLD.beta, COLD.eta, COLD.alpha])]


def _attenuation_guesses(channel: Channel, direct: Direct) -> list[NDArray[np.float64]]:
    """From the rate that would lift the mean to a half at the mean range."""
    middle_m = float(np.average(channel.z, weights=channel.below[:, -1, 0]))
    mean = float(direct.sums[:, 0].sum()) * 3 * channel.scale
    rate = max(float(np.log(PAPER.target / max(mean, GUESSES.least_mean))), GUESSES.least_depth) / middle_m
    return [np.array([w * rate, v / middle_m, y * rate, x / middle_m]) for w, v, y, x in GUESSES.attenuation]
