"""The paper's fit from moment tables: for each channel four numbers of backscatter, then four of attenuation, by quasi-Newton.

No loss of the paper couples two channels, so what looks like 24 parameters are six problems of four.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.parameters import ATTENUATION, BACKSCATTER, rates, raw_rates, raw_shares, shares, water_of
from stereo_seecolor.color.fitting.table_losses import Channel, Direct, attenuation_loss, backscatter_loss, direct_sums, sums_below
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_bins
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Water

Four = NDArray[np.float64]
"""The four parameters of one channel's backscatter or attenuation."""

COLD_STEPS, WARM_STEPS = 120, 25
MOST_RESTARTS, LEAST_GAIN = 4, 1e-4
CLAMP_DEVIATIONS = 5.0
"""The direct signal is clamped to this many standard deviations about its mean before attenuation is fitted."""

DIFFERENCE = 0.05
"""Step of raw weights for second derivatives: the backscatter loss has a kink at each value, and wants to be seen from afar."""

LEAST_CURVATURE, MOST_ERROR = 1e-7, 3.0
"""A direction this much flatter than the steepest is not seen; an error of a raw weight beyond this is a factor of twenty."""

IS_SHARE = np.array([True, False, True, False])
NOTHING = Direct(np.zeros(0), np.zeros((0, 2)), 0.0, 1.0, 0.0)

LONGEST_STEP = 2.0
"""No raw weight moves farther at once: beyond, a sigmoid or softplus is flat and a weight may not come back."""


def fit(table: MomentTable, penalty: float, encoding: InputEncoding, start: Water | None = None) -> Water:
    """The water that minimizes the paper's losses over the table's pixels, of which there must be some; with standard errors."""
    found, errors = np.empty((8, 3)), np.empty((8, 3))
    for c, channel in enumerate(channels(table, encoding)):
        veil, dimming = (None, None) if start is None else (_parameters(start, BACKSCATTER, c), _parameters(start, ATTENUATION, c))
        found[:4, c], errors[:4, c] = fit_backscatter(channel, penalty, veil)
        found[4:, c], errors[4:, c] = fit_attenuation(channel, direct_signal(channel, found[:4, c]), dimming)
    return replace(water_of(found, encoding), standard_errors=dict(zip(BACKSCATTER + ATTENUATION, errors, strict=True)))


def fit_backscatter(channel: Channel, penalty: float, start: Four | None) -> tuple[Four, Four]:
    """Gamma, beta, eta, alpha of one channel at the least loss, and their standard errors."""
    guesses = [_raw_backscatter(guess) for guess in _backscatter_guesses(channel, penalty)]
    raw = _best(0, None if start is None else _raw_backscatter(start), guesses, channel, NOTHING, penalty)
    found = np.where(IS_SHARE, shares(raw), rates(raw))
    slope = np.where(IS_SHARE, found * (1 - found), shares(raw))
    return found, slope * _standard_errors(0, raw, channel, NOTHING, penalty)


def fit_attenuation(channel: Channel, direct: Direct, start: Four | None) -> tuple[Four, Four]:
    """Parameters w, v, y, x of one channel at the least loss, and their standard errors."""
    guesses = [raw_rates(guess) for guess in _attenuation_guesses(channel, direct)]
    raw = _best(1, None if start is None else raw_rates(start), guesses, channel, direct, 0.0)
    return rates(raw), shares(raw) * _standard_errors(1, raw, channel, direct, 0.0)


def losses(table: MomentTable, water: Water, penalty: float) -> tuple[float, float]:
    """The paper's backscatter and attenuation losses of a water over the table's pixels, of which there must be some."""
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
    """D = I - B, clamped to five standard deviations about its mean, then to [0, 1], with what the losses need of it."""
    gamma, beta, eta, alpha = parameters
    backscatter = gamma * -np.expm1(-beta * channel.z) + eta * np.exp(-alpha * channel.z)
    number = 1.0 / (3.0 * channel.scale)
    total = channel.below[:, -1]
    mean = float((total[:, 1] - backscatter * total[:, 0]).sum() / number)
    square = float((total[:, 2] - 2 * backscatter * total[:, 1] + backscatter**2 * total[:, 0]).sum() / number)
    width = CLAMP_DEVIATIONS * np.sqrt(max(square - mean**2, 0.0))
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
    """The lowest minimum: from ``warm`` in a few steps where it begins lower than every guess, else from each of the guesses."""
    slopes, gradient = np.empty((channel.z.size, 4)), np.empty(4)
    begin = [_loss(which, raw, channel, direct, penalty, slopes, gradient) for raw in guesses]
    if warm is not None and _loss(which, warm, channel, direct, penalty, slopes, gradient) <= min(begin):
        return _minimum(which, warm, channel, direct, penalty, WARM_STEPS)[1]
    minima = [_minimum(which, raw, channel, direct, penalty, COLD_STEPS) for raw in guesses]
    loss, best = min(minima, key=lambda minimum: minimum[0])
    for _ in range(MOST_RESTARTS):  # a kink can hold the search; without what it learned of the curvature it may get away
        again, found = _minimum(which, best, channel, direct, penalty, COLD_STEPS)
        if again > (1 - LEAST_GAIN) * loss:
            break
        loss, best = again, found
    return best


def _minimum(which: int, raw: Four, channel: Channel, direct: Direct, penalty: float, steps: int) -> tuple[float, Four]:
    loss, found = minimize(which, raw, channel, direct, penalty, steps)
    return loss, found


def _standard_errors(which: int, raw: NDArray[np.float64], channel: Channel, direct: Direct, penalty: float) -> NDArray[np.float64]:
    """(4,) standard errors of raw weights at a minimum, NaN where the levels cannot tell a weight.

    The sandwich of an M-estimator (Huber 1967), H^-1 (sum of g g^T) H^-1, with the levels of range as its independent parts g:
    pixels of one range err together, by the same range error and the same lack of something dark.
    """
    levels = channel.z.size
    if levels <= 2 * raw.size:
        return np.full(raw.size, np.nan)
    slopes, hessian = np.empty((levels, 4)), np.empty((4, 4))
    curvature(which, raw, channel, direct, penalty, slopes, hessian)
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
    seen = values > LEAST_CURVATURE * max(values[-1], 1e-300)
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    errors = np.sqrt(np.diag(inverse @ (slopes.T @ slopes) @ inverse) * levels / (levels - raw.size))
    told = (vectors[:, ~seen] ** 2).sum(axis=1) < 0.01
    return np.where(told & (errors < MOST_ERROR), errors, np.nan)


def _parameters(water: Water, names: tuple[str, ...], channel: int) -> NDArray[np.float64]:
    return np.array([getattr(water, name)[channel] for name in names])


def _raw_backscatter(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(IS_SHARE, raw_shares(parameters), raw_rates(parameters))


def _backscatter_guesses(channel: Channel, penalty: float) -> list[NDArray[np.float64]]:
    """From the darkest of each level, which is what the loss looks for: at one level its optimum is the 1 / (1 + k) quantile."""
    number = channel.below[:, -1, 0]
    reached = channel.below[:, 1:, 0] > (number / (1 + penalty))[:, None]
    darkest = channel.light[reached.argmax(axis=1)]
    middle = float(np.average(channel.z, weights=number))
    low = float(np.average(darkest, weights=number))
    steep, flat = [low + 0.02, 1 / middle, low, 1 / middle], [low + 0.02, 0.2 / middle, 0.5 * low, 0.2 / middle]
    return [np.array(steep), np.array(flat), np.array([0.1, 0.2, 0.02, 1.0])]


def _attenuation_guesses(channel: Channel, direct: Direct) -> list[NDArray[np.float64]]:
    """From the rate that would lift the mean to a half at the mean range."""
    middle = float(np.average(channel.z, weights=channel.below[:, -1, 0]))
    mean = float(direct.sums[:, 0].sum()) * 3 * channel.scale
    rate = max(float(np.log(0.5 / max(mean, 1e-3))), 0.1) / middle
    flat, steep = [0.5 * rate, 0.1 / middle, 0.5 * rate, 0.1 / middle], [0.3 * rate, 0.02 / middle, 2 * rate, 2 / middle]
    steeper = [0.5 * rate, 0.02 / middle, 20 * rate, 4 / middle]
    return [np.array(flat), np.array(steep), np.array(steeper)]


@compiled
def _loss(which, raw, channel, direct, penalty, slopes, gradient):  # type: ignore[no-untyped-def]
    loss = backscatter_loss(raw, channel, penalty, slopes) if which == 0 else attenuation_loss(raw, channel, direct, slopes)
    gradient[:] = 0.0
    for level in range(slopes.shape[0]):
        for i in range(4):
            gradient[i] += slopes[level, i]
    return loss


@compiled
def curvature(which, raw, channel, direct, penalty, slopes, hessian):  # type: ignore[no-untyped-def]
    """The Hessian by central differences of the gradient, and the gradient's parts by level, at ``raw``."""
    forward, back = np.empty(4), np.empty(4)
    for i in range(4):
        moved = raw.copy()
        moved[i] = raw[i] + DIFFERENCE
        _loss(which, moved, channel, direct, penalty, slopes, forward)
        moved[i] = raw[i] - DIFFERENCE
        _loss(which, moved, channel, direct, penalty, slopes, back)
        for j in range(4):
            hessian[i, j] = (forward[j] - back[j]) / (2.0 * DIFFERENCE)
    _loss(which, raw, channel, direct, penalty, slopes, forward)


@compiled
def minimize(which, raw, channel, direct, penalty, most_steps):  # type: ignore[no-untyped-def]
    """BFGS with a weak Wolfe line search, which also holds on losses with kinks (Lewis and Overton 2013).

    Gives the loss and the raw weights.
    """
    n = raw.size
    x, gradient, slopes = raw.copy(), np.empty(n), np.empty((channel.z.size, n))
    loss = _loss(which, x, channel, direct, penalty, slopes, gradient)
    inverse = np.eye(n) * (0.2 / max(np.sqrt(np.sum(gradient * gradient)), 1e-12))
    trial_gradient, small = np.empty(n), 0
    for _ in range(most_steps):
        direction = -_times(inverse, gradient)
        longest = np.max(np.abs(direction))
        if longest > LONGEST_STEP:
            direction *= LONGEST_STEP / longest
        slope = np.sum(direction * gradient)
        if not slope < 0.0:
            break
        step, low, high = 1.0, 0.0, np.inf
        trial, trial_loss = x, loss
        for _ in range(25):
            trial = x + step * direction
            trial_loss = _loss(which, trial, channel, direct, penalty, slopes, trial_gradient)
            if trial_loss > loss + 1e-4 * step * slope:
                high = step
            elif np.sum(trial_gradient * direction) < 0.9 * slope and step * longest < 10 * LONGEST_STEP:
                low = step
            else:
                break
            step = 0.5 * (low + high) if high < np.inf else 2.0 * step
        if not trial_loss < loss:
            break
        small = small + 1 if loss - trial_loss <= 1e-7 * abs(loss) else 0
        _update(inverse, trial - x, trial_gradient - gradient)
        x, loss = trial, trial_loss
        gradient[:] = trial_gradient
        if small == 2:
            break
    return loss, x


@compiled
def _times(matrix, vector):  # type: ignore[no-untyped-def]
    out = np.zeros(vector.size)
    for i in range(vector.size):
        for j in range(vector.size):
            out[i] += matrix[i, j] * vector[j]
    return out


@compiled
def _update(inverse, step, change):  # type: ignore[no-untyped-def]
    """The BFGS update of the inverse Hessian, left out where the curvature is not positive."""
    curvature = np.sum(step * change)
    if curvature <= 1e-14 * np.sqrt(np.sum(step * step) * np.sum(change * change)):
        return
    across = _times(inverse, change)
    weight = (1.0 + np.sum(change * across) / curvature) / curvature
    for i in range(step.size):
        for j in range(step.size):
            inverse[i, j] += weight * step[i] * step[j] - (across[i] * step[j] + step[i] * across[j]) / curvature
