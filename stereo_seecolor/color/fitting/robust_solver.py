"""Damped Gauss-Newton steps for the robust fit, compiled.

Arrays are copied by loops: in one assignment, numba would compile a message about shapes, for seconds.

A parameter vector ``x`` holds logarithms: of the water's 15 parameters, of 3 P reflectances (channel after channel), of G
brightnesses.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.water_prior import RATE_OF_CHANGE
from stereo_seecolor.compute.compiled import compiled

Array = NDArray[np.float64]

WATER = 15


class Steps(NamedTuple):
    """Levenberg's damped Gauss-Newton steps. A tuple, since compiled code cannot read a dataclass."""

    outer: int = 20
    """Most steps with new weights."""
    inner: int = 6
    """Most steps between these."""
    largest_move: float = 1.0
    """Of a logarithm in one step: a factor of e."""
    first_damping: float = 1e-3
    """Of the matrix's diagonal."""
    more_damping: float = 8.0
    """Factor after a step that did not lower the cost."""
    less_damping: float = 0.2
    """Factor after one that did."""
    most_damping: float = 1e6
    """Beyond, steps are too short to matter."""
    least_damping: float = 1e-6
    """Below, a step is nearly Gauss-Newton's."""
    inner_converged: float = 1e-3
    """Fraction of the cost by which a step with the same weights must lower it."""
    outer_converged: float = 3e-4
    """The same for a step with new weights."""


STEPS = Steps()
BRIGHTEST = 20.0
"""Logarithms of light beyond count as this: exp(20) is finite, and no image's."""
LEAST_PIVOT = 1e-300
"""Of Cholesky's factors: a matrix that rounding made singular gives a huge step, which ``largest_move`` bounds."""


class Noise(NamedTuple):
    """What a quantile may be off by; chosen on the drawn scenes and reefs of seeds below 100 (docs/color-quality.md)."""

    content: tuple[float, ...] = (0.6, 0.6, 0.6, 0.5, 0.4, 0.25, 0.1, 0.1, 0.1)
    """Of each quantile, dark to bright, fraction of the direct signal: content differs from range to range, dark content most. In
    photographs with measured depth by 0.4 to 0.6 at the dark end, 0.1 to 0.2 at the bright one."""
    all: float = 0.05
    """Fraction of all light, backscatter included."""
    outlier: float = 2.0
    """Standard deviations beyond which a quantile weighs less than half (Cauchy)."""
    floor: float = 0.001
    """Light that a camera's offset hides, against the brightest."""
    darker: float = 0.03
    """Fraction by which backscatter may exceed the darkest quantile: nothing is darker than the backscatter before it."""


NOISE = Noise()


class Data(NamedTuple):
    """range_m (G,). light (3, G, P): quantiles against the brightest. clipped (3, G, P). trust (G,): weight of each range, 0..1."""

    range_m: Array
    light: Array
    clipped: NDArray[np.bool_]
    trust: Array


class Prior(NamedTuple):
    """mean (n,), precision (n, n)."""

    mean: Array
    precision: Array


class Normal(NamedTuple):
    """matrix (n, n): Gauss-Newton's; slope (n,): the gradient. Empty where neither is wanted."""

    matrix: Array
    slope: Array


@compiled
def minimize(x: Array, data: Data, prior: Prior, noise: Noise) -> tuple[Array, Array]:
    """Levenberg's damped Gauss-Newton steps: the parameters at the least cost, and the Gauss-Newton matrix there."""
    n = x.size
    normal, nothing = Normal(np.zeros((n, n)), np.zeros(n)), Normal(np.zeros((0, 0)), np.zeros(0))
    weights = np.empty(data.light.shape)
    trial, damping = x.copy(), STEPS.first_damping
    for _ in range(STEPS.outer):
        _weigh(x, data, noise, weights)
        cost = _cost(x, data, prior, weights, noise, normal)
        start = cost
        for _ in range(STEPS.inner):
            damped = normal.matrix.copy()
            for i in range(n):
                damped[i, i] *= 1 + damping
            move = _solve(damped, normal.slope)
            for i in range(n):
                trial[i] = x[i] - min(max(move[i], -STEPS.largest_move), STEPS.largest_move)
            new = _cost(trial, data, prior, weights, noise, nothing)
            if new >= cost:
                damping = min(damping * STEPS.more_damping, STEPS.most_damping)
                continue
            small = cost - new < STEPS.inner_converged * cost
            for i in range(n):
                x[i] = trial[i]
            cost = new
            damping = max(damping * STEPS.less_damping, STEPS.least_damping)
            if small:
                break
            _cost(x, data, prior, weights, noise, normal)
        if start - cost < STEPS.outer_converged * start:
            break
    _cost(x, data, prior, weights, noise, normal)
    return x, normal.matrix


def cost_at(x: Array, data: Data, prior: Prior, noise: Noise) -> float:
    """Half the weighted sum of squares at ``x``, the prior's included."""
    weights = np.empty(data.light.shape)
    _weigh(x, data, noise, weights)
    return float(_cost(x, data, prior, weights, noise, Normal(np.zeros((0, 0)), np.zeros(0))))


@compiled
def _at(x: Any, c: int, z: float) -> Any:
    """Of channel c at range z: optical depth, what of it falls with log(near / far), backscatter, what of that is still to come."""
    far, near, beta = np.exp(x[c]), np.exp(x[3 + c]), np.exp(x[6 + c])
    saturated, decay = np.exp(x[9 + c] + x[12 + c]), np.exp(-RATE_OF_CHANGE * z)
    rest = np.exp(-beta * z)
    return z * far * (1 + (near - 1) * decay), z * far * near * decay, saturated * (1 - rest), saturated * rest * beta * z


@compiled
def _direct(x: Any, c: int, g: int, p: int, depth: float, shape: Any) -> Any:
    """The direct signal of quantile p of channel c at range g."""
    channels, _, quantiles = shape
    return np.exp(min(x[12 + c] - depth + x[WATER + c * quantiles + p] + x[WATER + channels * quantiles + g], BRIGHTEST))


@compiled(shared=True)
def _weigh(x: Any, data: Any, noise: Any, weights: Any) -> None:
    """Into ``weights`` (3, G, P) the inverse variances of the quantiles under ``x``, less for outliers (Cauchy), times trust.

    Light at full scale may have been brighter: no model above it is wrong.
    """
    channels, groups, quantiles = data.light.shape
    for c in range(channels):
        for g in range(groups):
            depth, _, backscatter, _ = _at(x, c, data.range_m[g])
            for p in range(quantiles):
                direct = _direct(x, c, g, p, depth, data.light.shape)
                model = direct + backscatter + noise.floor
                r = np.log(model / (data.light[c, g, p] + noise.floor))
                variance = (noise.content[p] * direct / model) ** 2 + noise.all**2
                brighter = data.clipped[c, g, p] and r > 0.0
                weight = data.trust[g] / variance / (1 + r * r / (noise.outlier**2 * variance))
                weights[c, g, p] = 0.0 if brighter else weight


@compiled(shared=True)
def _cost(x: Any, data: Any, prior: Any, weights: Any, noise: Any, normal: Any) -> Any:
    """Half the sum of squares; into ``normal`` its matrix and slope, unless that is empty."""
    channels, groups, quantiles = data.light.shape
    cost = _prior_cost(x, prior, normal)
    at, d = np.zeros(7, np.int64), np.zeros(7)
    for c in range(channels):
        for i in range(5):
            at[i] = 3 * i + c
        for g in range(groups):
            at[6] = WATER + channels * quantiles + g
            depth, near_part, backscatter, rising = _at(x, c, data.range_m[g])
            over = np.log((backscatter + noise.floor) / (data.light[c, g, 0] + noise.floor))
            if over > 0.0 and not data.clipped[c, g, 0]:
                d[2] = rising / (backscatter + noise.floor)
                d[3] = d[4] = backscatter / (backscatter + noise.floor)
                cost += _square(data.trust[g] / noise.darker**2, over, at[2:5], d[2:5], normal)
            for p in range(quantiles):
                at[5] = WATER + c * quantiles + p
                direct = _direct(x, c, g, p, depth, data.light.shape)
                model = direct + backscatter + noise.floor
                d[0], d[1] = -direct * depth / model, -direct * near_part / model
                d[2], d[3], d[4] = rising / model, backscatter / model, (direct + backscatter) / model
                d[5] = d[6] = direct / model
                cost += _square(weights[c, g, p], np.log(model / (data.light[c, g, p] + noise.floor)), at, d, normal)
    for i in range(normal.slope.size):
        for j in range(i):
            normal.matrix[j, i] = normal.matrix[i, j]
    return cost


@compiled
def _prior_cost(x: Any, prior: Any, normal: Any) -> Any:
    """Half the squared distance from the prior's mean; its matrix and slope begin ``normal``."""
    cost = 0.0
    for i in range(x.size):
        pull = 0.0
        for j in range(x.size):
            pull += prior.precision[i, j] * (x[j] - prior.mean[j])
        cost += 0.5 * pull * (x[i] - prior.mean[i])
        if normal.slope.size:
            normal.slope[i] = pull
            for j in range(x.size):
                normal.matrix[i, j] = prior.precision[i, j]
    return cost


@compiled
def _square(weight: float, residual: float, at: Any, derivative: Any, normal: Any) -> Any:
    """Half a weighted square; its part of the slope, and of the matrix's lower triangle (``at`` ascends), are added."""
    if normal.slope.size:
        for i in range(at.size):
            normal.slope[at[i]] += weight * derivative[i] * residual
            for j in range(i + 1):
                normal.matrix[at[i], at[j]] += weight * derivative[i] * derivative[j]
    return 0.5 * weight * residual * residual


@compiled(fastmath=True)
def _solve(matrix: Any, vector: Any) -> Any:
    """Solves a symmetric positive definite system by Cholesky's factors, in place."""
    n = vector.size
    out = vector.copy()
    for j in range(n):
        s = matrix[j, j]
        for k in range(j):
            s -= matrix[j, k] * matrix[j, k]
        root = np.sqrt(max(s, LEAST_PIVOT))
        matrix[j, j] = root
        for i in range(j + 1, n):
            s = matrix[i, j]
            for k in range(j):
                s -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = s / root
    for i in range(n):
        for k in range(i):
            out[i] -= matrix[i, k] * out[k]
        out[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            out[i] -= matrix[k, i] * out[k]
        out[i] /= matrix[i, i]
    return out
