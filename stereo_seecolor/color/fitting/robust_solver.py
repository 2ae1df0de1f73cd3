"""Damped Gauss-Newton steps for the robust fit, compiled.

Arrays are copied by loops: in one assignment, numba would compile a message about shapes, for seconds.

A parameter vector ``x`` holds logarithms: of the water's 15 parameters, of 3 P reflectances (channel after channel), of G
brightnesses.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.water_prior import RATE_OF_CHANGE, WATER
from stereo_seecolor.compute.compiled import compiled

Array = NDArray[np.float64]


class Steps(NamedTuple):
    """Levenberg's damped Gauss-Newton steps. A tuple, since compiled code cannot read a dataclass."""

    outer: int = 20
    """Most steps with new weights."""
    inner: int = 6
    """Most steps between these."""
    largest_move: float = 1.0
    """Largest change of a logarithm in one step: a factor of e."""
    first_damping: float = 1e-3
    """Initial damping, as a fraction of the matrix's diagonal."""
    more_damping: float = 8.0
    """Factor after a step that did not lower the cost."""
    less_damping: float = 0.2
    """Factor after one that did."""
    most_damping: float = 1e6
    """Largest damping: beyond, steps are too short to matter."""
    least_damping: float = 1e-6
    """Least damping: below, a step is nearly Gauss-Newton's."""
    inner_converged: float = 1e-3
    """Fraction of the cost by which a step with the same weights must lower it."""
    outer_converged: float = 3e-4
    """The same for a step with new weights."""


STEPS = Steps()
BRIGHTEST = np.exp(20.0)
"""Light above this counts as this: it is finite, and far above that of any image."""
LEAST_PIVOT = 1e-300
"""Least pivot of Cholesky's factors: a matrix that rounding made singular gives a huge step, which ``largest_move`` bounds."""


class Noise(NamedTuple):
    """Errors of a quantile; chosen on the synthetic scenes and reefs of seeds below 100 (docs/lab/color.md)."""

    content: tuple[float, ...] = (0.6, 0.6, 0.6, 0.5, 0.4, 0.25, 0.1, 0.1, 0.1)
    """Standard deviation of each quantile, dark to bright, as a fraction of the direct signal: content differs from range to range,
    dark content most. In photographs with measured depth by 0.4 to 0.6 at the dark end, 0.1 to 0.2 at the bright one."""
    all: float = 0.05
    """Fraction of all light, backscatter included."""
    outlier: float = 2.0
    """Standard deviations beyond which a quantile weighs less than half (Cauchy)."""
    floor: float = 0.001
    """Light that a camera's offset hides, against the brightest."""
    darker: float = 0.03
    """Fraction by which backscatter may exceed the darkest quantile: nothing is darker than the backscatter before it."""

    green_over_blue: float = 0.06
    """1/m, most by which attenuation of green exceeds that of blue. Pure water absorbs 0.036 more at 535 than at 460 nm (Pope, Fry
    1997), and all else in the sea absorbs blue more. Cameras, and daylight lost on its way down to what lies deeper, add some."""
    rate: float = 0.01
    """1/m, standard deviation beyond it."""


NOISE = Noise()


class Data(NamedTuple):
    """The data of the fit. range_m (G,): meters. light (3, G, P): quantiles, as fractions of the brightest. clipped (3, G, P).
    trust (G,): weight of each range, 0..1.
    """

    range_m: Array
    light: Array
    clipped: NDArray[np.bool_]
    trust: Array


class Prior(NamedTuple):
    """A Gaussian prior of the parameters: mean (n,), precision (n, n)."""

    mean: Array
    precision: Array


class Normal(NamedTuple):
    """The normal equations. matrix (n, n): lower triangle of the Gauss-Newton matrix; slope (n,): the gradient."""

    matrix: Array
    slope: Array


@compiled
def minimize(x: Array, data: Data, prior: Prior, noise: Noise) -> tuple[Array, Array]:
    """Minimize the cost by Levenberg's damped Gauss-Newton steps; returns the parameters and the Gauss-Newton matrix there."""
    n = x.size
    here, there = Normal(np.zeros((n, n)), np.zeros(n)), Normal(np.zeros((n, n)), np.zeros(n))
    weights = np.empty(data.light.shape)
    trial, damping = x.copy(), STEPS.first_damping
    yes, no = n > 0, n < 0  # for the literals True and False, numba would compile the cost twice
    for _ in range(STEPS.outer):
        cost = _cost(x, data, prior, weights, noise, yes, here)
        start = cost
        for _ in range(STEPS.inner):
            damped = here.matrix.copy()
            for i in range(n):
                damped[i, i] *= 1 + damping
            move = _solve(damped, here.slope)
            for i in range(n):
                trial[i] = x[i] - min(max(move[i], -STEPS.largest_move), STEPS.largest_move)
            new = _cost(trial, data, prior, weights, noise, no, there)
            if new >= cost:
                damping = min(damping * STEPS.more_damping, STEPS.most_damping)
                continue
            small = cost - new < STEPS.inner_converged * cost
            x, trial, here, there, cost = trial, x, there, here, new
            damping = max(damping * STEPS.less_damping, STEPS.least_damping)
            if small:
                break
        if start - cost < STEPS.outer_converged * start:
            break
    _mirror(here.matrix)
    return x, here.matrix


def cost_at(x: Array, data: Data, prior: Prior, noise: Noise) -> float:
    """Half the weighted sum of squares at ``x``, the prior's included."""
    n = x.size
    return float(_cost(x, data, prior, np.empty(data.light.shape), noise, True, Normal(np.zeros((n, n)), np.zeros(n))))


@compiled
def _at(x: Any, c: int, z: float) -> Any:
    """For channel c at range z: optical depth, its derivative by log(near / far), backscatter, and its derivative by log beta."""
    far, near, beta = np.exp(x[c]), np.exp(x[3 + c]), np.exp(x[6 + c])
    saturated, decay = np.exp(x[9 + c] + x[12 + c]), np.exp(-RATE_OF_CHANGE * z)
    rest = np.exp(-beta * z)
    return z * far * (1 + (near - 1) * decay), z * far * near * decay, saturated * (1 - rest), saturated * rest * beta * z


@compiled(shared=True)
def _cost(x: Any, data: Any, prior: Any, weights: Any, noise: Any, renew: bool, normal: Any) -> Any:
    """Half the sum of squares; into ``normal`` its matrix and slope.

    renew: into ``weights`` (3, G, P) go those of the quantiles under ``x``. Of a quantile's model, q is the fraction that is direct
    signal, and u is one over it: five sums of their products give what a range adds for the water and the range's brightness.
    """
    channels, groups, quantiles = data.light.shape
    cost = _prior_cost(x, prior, normal) + _rate_cost(x, noise, normal)
    reflectance = np.empty(channels * quantiles)
    for i in range(reflectance.size):
        reflectance[i] = np.exp(x[WATER + i])
    for c in range(channels):
        for g in range(groups):
            depth, near_part, backscatter, rising = _at(x, c, data.range_m[g])
            by_direct, by_backscatter = (-depth, -near_part, 0.0, 0.0, 1.0), (0.0, 0.0, rising, backscatter, backscatter)
            bright, qq, qu, uu, qr, ur = WATER + channels * quantiles + g, 0.0, 0.0, 0.0, 0.0, 0.0
            arriving = np.exp(x[12 + c] - depth + x[bright])
            over = np.log((backscatter + noise.floor) / (data.light[c, g, 0] + noise.floor))
            if over > 0.0 and not data.clipped[c, g, 0]:
                u, weight = 1 / (backscatter + noise.floor), data.trust[g] / noise.darker**2
                uu, ur, cost = weight * u * u, weight * u * over, cost + 0.5 * weight * over * over
            for p in range(quantiles):
                content = WATER + c * quantiles + p
                direct = min(arriving * reflectance[content - WATER], BRIGHTEST)
                u = 1 / (direct + backscatter + noise.floor)
                q, r = direct * u, -np.log((data.light[c, g, p] + noise.floor) * u)
                if renew:
                    weights[c, g, p] = data.trust[g] * _weight(noise.content[p] * q, r, data.clipped[c, g, p], noise)
                weight = weights[c, g, p]
                wq, wu, cost = weight * q, weight * u, cost + 0.5 * weight * r * r
                qq, qu, uu, qr, ur = qq + wq * q, qu + wq * u, uu + wu * u, qr + wq * r, ur + wu * r
                _add_row(content, c, wq * q, wq * u, by_direct, by_backscatter, normal)
                normal.matrix[content, content] += wq * q
                normal.matrix[bright, content] += wq * q
                normal.slope[content] += wq * r
            for i in range(5):
                a, b = by_direct[i], by_backscatter[i]
                _add_row(3 * i + c, c, a * qq + b * qu, a * qu + b * uu, by_direct, by_backscatter, normal)
                normal.slope[3 * i + c] += a * qr + b * ur
            _add_row(bright, c, qq, qu, by_direct, by_backscatter, normal)
            normal.matrix[bright, bright] += qq
            normal.slope[bright] += qr
    return cost


@compiled
def _mirror(matrix: Any) -> None:
    """Fill the upper triangle from the lower one."""
    for i in range(matrix.shape[0]):
        for j in range(i):
            matrix[j, i] = matrix[i, j]


@compiled
def _weight(content: float, residual: float, clipped: bool, noise: Any) -> Any:
    """A quantile's inverse variance, less for an outlier (Cauchy). A model above light at full
    scale is not penalized: that may be clipped. content: standard deviation by differences of the scene between ranges."""
    if clipped and residual > 0.0:
        return 0.0
    return 1 / (content**2 + noise.all**2 + (residual / noise.outlier) ** 2)


@compiled
def _add_row(row: int, c: int, q: float, u: float, by_direct: Any, by_backscatter: Any, normal: Any) -> None:
    """Adds to a row of the matrix at the five parameters of a channel's water."""
    for i in range(5):
        normal.matrix[row, 3 * i + c] += by_direct[i] * q + by_backscatter[i] * u


@compiled(fastmath=True)
def _prior_cost(x: Any, prior: Any, normal: Any) -> Any:
    """Half the squared distance from the prior's mean; its matrix and slope begin ``normal``."""
    cost, away = 0.0, np.empty(x.size)
    for i in range(x.size):
        away[i] = x[i] - prior.mean[i]
    for i in range(x.size):
        pull = 0.0
        for j in range(x.size):
            pull += prior.precision[i, j] * away[j]
            normal.matrix[i, j] = prior.precision[i, j]
        cost += 0.5 * pull * away[i]
        normal.slope[i] = pull
    return cost


@compiled
def _rate_cost(x: Any, noise: Any, normal: Any) -> Any:
    """Half the squared excess of green's attenuation over blue's, far and near, above what water can have; adds to ``normal``."""
    cost = 0.0
    for near in range(2):
        green, blue = np.exp(x[1] + near * x[4]), np.exp(x[2] + near * x[5])
        over = (green - blue - noise.green_over_blue) / noise.rate
        if over > 0.0:
            cost += 0.5 * over * over
            at, by = (1, 2, 4, 5), (green / noise.rate, -blue / noise.rate, near * green / noise.rate, -near * blue / noise.rate)
            for i in range(4):
                normal.slope[at[i]] += over * by[i]
                for j in range(i + 1):
                    normal.matrix[at[i], at[j]] += by[i] * by[j]
    return cost


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
