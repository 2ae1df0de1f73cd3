"""The lag of one signal behind another, to a fraction of a sample, with its standard error."""

from dataclasses import dataclass

import numpy as np

from calibration.robust_statistics import deviation
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class LagLimits:
    """Decides what counts as evidence."""

    # of the grid of the first search: a third of a frame at 30 frames a second
    step_s: float = 0.01
    overlap_s: float = 3.0  # shorter overlaps agree by chance
    overlap_fraction: float = 0.25  # of the shorter recording
    # of the best lag; of unrelated motion the best of all lags has 0.2 to 0.5
    correlation: float = 0.6
    # the best lag's correlation less that of any other peak: a swell of one period repeats itself
    lead: float = 0.15
    # so near the top of a peak noise makes no other one: slow motion has peaks seconds wide
    peak_s: float = 0.1
    # clocks of two cameras differ by some 10 ppm (quartz: at most 50); a drift known worse than
    # this is not used
    drift: float = 50e-6
    # the fine search stays so near the coarse lag, whose steps are a hundredth of a second
    rest_s: float = 0.25
    # rigs move at up to some 2 Hz: what is faster is noise of the measured motion
    smooth_s: float = 0.15
    # samples on either side of a step
    least: int = 8


LIMITS = LagLimits()


@dataclass(frozen=True)
class Lag:
    """An event at ``t`` on the first clock is at ``t + offset_s + drift (t - center_s)`` on the
    second.

    std_s: standard error of offset_s, drift_std: of drift. center_s: where the two are independent.
    """

    offset_s: float
    std_s: float
    drift: float = 0.0
    drift_std: float = 0.0
    center_s: float = 0.0

    def at(self, times_s: Array) -> Array:
        """Convert times of the first clock to the second."""
        return np.asarray(times_s + self.offset_s + self.drift * (times_s - self.center_s))


def coarse_lag(times: tuple[Array, Array], signals: tuple[Array, Array]) -> float | None:
    """The offset, seconds, at which two signals fit best; None where no lag stands out.

    times: of either signal's samples, rising. signals: (n, k), the same k quantities. All lags are
    tried at which enough overlaps.
    """
    step_s = LIMITS.step_s
    grids = [np.arange(t[0], t[-1], step_s) for t in times]
    if min(len(grid) for grid in grids) * step_s < LIMITS.overlap_s:
        return None
    values = [
        _standard(np.column_stack([np.interp(g, t, column) for column in s.T]))
        for g, t, s in zip(grids, times, signals, strict=True)
    ]
    lags, correlation = _correlations(*values)
    best = int(np.argmax(correlation))
    if (
        correlation[best] < LIMITS.correlation
        or correlation[best] - _runner_up(correlation, best) < LIMITS.lead
    ):
        return None
    return float(lags[best] * step_s + grids[1][0] - grids[0][0])


def fine_lag(
    times: tuple[Array, Array], signals: tuple[Array, Array], coarse_s: float
) -> Lag | None:
    """Fit offset and drift that make the second signal agree with the first, by least squares from
    a coarse lag; None where it fails.

    A gain and a constant of each quantity are free. The standard error counts neighboring residuals
    that are alike once.
    """
    from scipy.interpolate import CubicSpline
    from scipy.optimize import least_squares

    spline = CubicSpline(times[1], signals[1], extrapolate=False)
    margin_s = 0.5
    inside = (times[0] + coarse_s > times[1][0] + margin_s) & (
        times[0] + coarse_s < times[1][-1] - margin_s
    )
    at, wanted = times[0][inside], signals[0][inside]
    if len(at) < 20:
        return None
    center_s, k, scale = float(at.mean()), wanted.shape[1], wanted.std(axis=0) + 1e-12

    def residuals(p: Array) -> Array:
        """p: gains, constants, offset in 10 ms, drift in 100 ppm where it is free."""
        drift = p[2 * k + 1] * 1e-4 if len(p) > 2 * k + 1 else 0.0
        found = spline(at + coarse_s + p[2 * k] * 1e-2 + drift * (at - center_s))
        return np.asarray((wanted - p[:k] * found - p[k : 2 * k]) / scale).ravel()

    fits = []
    for free in (1, 2):
        start = np.concatenate([np.ones(k), np.zeros(k + free)])
        fit = least_squares(residuals, start, loss="soft_l1", f_scale=0.1, max_nfev=60)
        fits.append((fit.x, _standard_errors(np.asarray(fit.jac), residuals(fit.x), k)))
    (x, error), (x_drift, error_drift) = fits
    if error_drift[-1] * 1e-4 > LIMITS.drift:
        x_drift, error_drift = np.append(x, 0.0), np.append(error, LIMITS.drift * 1e4)
    if abs(x_drift[2 * k]) * 1e-2 > LIMITS.rest_s:
        return None
    offset_s = coarse_s + x_drift[2 * k] * 1e-2
    return Lag(
        offset_s,
        error_drift[2 * k] * 1e-2,
        x_drift[-1] * 1e-4,
        error_drift[-1] * 1e-4,
        center_s,
    )


def lags_at_step(times: tuple[Array, Array], signals: tuple[Array, Array], whole: Lag) -> list[Lag]:
    """The lags before and after the one moment at which a step of the lag explains most of what
    ``whole`` leaves; none for too few samples.

    A gain and a constant of each quantity are free. Finds frames that are lost near an end, where
    the lag of so few samples alone is not known.
    """
    from scipy.interpolate import CubicSpline
    from scipy.ndimage import uniform_filter1d

    at_s = whole.at(times[0])
    inside = (at_s >= times[1][0]) & (at_s <= times[1][-1])
    own_s, at_s = times[0][inside], at_s[inside]
    if len(own_s) < 4 * LIMITS.least:
        return []
    spline = CubicSpline(times[1], signals[1])
    few = max(1, round(LIMITS.smooth_s / float(np.median(np.diff(own_s)))))
    wanted, found, slope = (
        uniform_filter1d(values, few, axis=0, mode="nearest")
        for values in (signals[0][inside], spline(at_s), spline(at_s, 1))
    )
    wanted, found = wanted - wanted.mean(axis=0), found - found.mean(axis=0)
    gain = (wanted * found).sum(axis=0) / ((found**2).sum(axis=0) + 1e-12)
    rest, slope = wanted - gain * found, gain * slope
    rest = rest - np.median(rest, axis=0)
    top, bottom = (np.cumsum((values * slope).sum(axis=1)) for values in (rest, slope))
    last = len(own_s) - 1
    k = np.arange(LIMITS.least, last - LIMITS.least)
    parts = np.stack([top[k], top[last] - top[k]]), np.stack([bottom[k], bottom[last] - bottom[k]])
    steps_s = parts[0] / (parts[1] + 1e-12)
    best = int(np.argmax((steps_s * parts[0]).sum(axis=0)))
    is_after = np.arange(len(own_s)) > k[best]
    jacobian = np.stack([slope * side[:, None] for side in (~is_after, is_after)], axis=-1).reshape(
        -1, 2
    )
    errors = _standard_errors(jacobian, rest.ravel() - jacobian @ steps_s[:, best], rest.shape[1])
    centers_s = [own_s[~is_after].mean(), own_s[is_after].mean()]
    offsets_s = whole.at(np.array(centers_s)) - centers_s + steps_s[:, best]
    return [
        Lag(float(offset_s), float(error_s), center_s=float(center_s))
        for offset_s, error_s, center_s in zip(offsets_s, errors, centers_s, strict=True)
    ]


def straight_lag(at: Array, offsets_s: Array, floor_s: float) -> Lag | None:
    """The line through offsets at several times, without outliers; None for fewer than three."""
    keep = np.abs(offsets_s - np.median(offsets_s)) < max(5 * deviation(offsets_s), 2 * floor_s)
    if keep.sum() < 3:
        return None
    at, offsets_s = at[keep], offsets_s[keep]
    center_s = float(at.mean())
    A = np.column_stack([np.ones(len(at)), at - center_s])
    for columns in (2, 1):
        A = A[:, :columns]
        solution = np.linalg.lstsq(A, offsets_s, rcond=None)[0]
        rest_s = np.sqrt(((offsets_s - A @ solution) ** 2).sum() / max(1, len(at) - columns))
        errors = np.hypot(rest_s, floor_s) * np.sqrt(np.diag(np.linalg.pinv(A.T @ A)))
        if columns == 2 and errors[1] <= LIMITS.drift and len(at) > 3:
            return Lag(
                float(solution[0]), float(errors[0]), float(solution[1]), float(errors[1]), center_s
            )
    return Lag(float(solution[0]), float(errors[0]), 0.0, LIMITS.drift, center_s)


def _correlations(first: Array, second: Array) -> tuple[Array, Array]:
    """(lags in steps, correlation) of all lags with enough overlap: second[i + lag], first[i]."""
    n, m = len(first), len(second)
    size = 1 << (n + m - 1).bit_length()

    def cross(a: Array, b: Array) -> Array:
        spectrum = np.conj(np.fft.rfft(a, size, axis=0)) * np.fft.rfft(b, size, axis=0)
        return np.asarray(np.fft.irfft(spectrum, size, axis=0).sum(axis=1))

    ones = [np.ones((len(x), first.shape[1])) for x in (first, second)]
    product, energy_first, energy_second = (
        cross(first, second),
        cross(first**2, ones[1]),
        cross(ones[0], second**2),
    )
    overlap = cross(ones[0][:, :1], ones[1][:, :1])
    lags = np.arange(size)
    lags = np.where(lags > m, lags - size, lags)
    least = max(LIMITS.overlap_s / LIMITS.step_s, LIMITS.overlap_fraction * min(n, m))
    good = overlap > least
    correlation = np.where(
        good, product / np.sqrt(np.maximum(energy_first * energy_second, 1e-9)), -1.0
    )
    order = np.argsort(lags)
    return lags[order].astype(float), correlation[order]


def _runner_up(correlation: Array, best: int) -> float:
    """The highest correlation beyond the foot of the best peak, whose top may be uneven."""
    near = round(LIMITS.peak_s / LIMITS.step_s)
    left, right = max(best - near, 0), min(best + near, len(correlation) - 1)
    while left > 0 and correlation[left - 1] < correlation[left] + 1e-9:
        left -= 1
    while right < len(correlation) - 1 and correlation[right + 1] < correlation[right] + 1e-9:
        right += 1
    return float(max(correlation[:left].max(initial=-1), correlation[right + 1 :].max(initial=-1)))


def _standard_errors(jacobian: Array, residuals: Array, quantities: int) -> Array:
    """Standard errors of a least-squares fit whose residuals are correlated in time."""
    rows = residuals.reshape(-1, quantities)
    rho = float(np.clip((rows[1:] * rows[:-1]).sum() / max((rows**2).sum(), 1e-12), 0.0, 0.95))
    variance = (
        (residuals**2).sum() / max(1, residuals.size - jacobian.shape[1]) * (1 + rho) / (1 - rho)
    )
    covariance: Array = np.linalg.pinv(jacobian.T @ jacobian) * variance
    return np.asarray(np.sqrt(np.diag(covariance)))


def _standard(values: Array) -> Array:
    spread = values.std(axis=0)
    return np.asarray((values - values.mean(axis=0)) / np.where(spread > 0, spread, 1.0))
