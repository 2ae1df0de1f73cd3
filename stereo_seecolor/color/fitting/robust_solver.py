"""Levenberg's damped Gauss-Newton steps for the robust fit, of many frames at once.

A parameter vector ``x`` holds logarithms: of the water's 15 parameters, of 3 P reflectances
(channel after channel), of G brightnesses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.water_prior import RATE_OF_CHANGE, WATER
from stereo_seecolor.compute.process import one_thread_in_products
from stereo_seecolor.water.physics import cged, ged

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Steps:
    """Levenberg's damped Gauss-Newton steps; weights are renewed after each."""

    most: int = 400
    """Most steps."""
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
    converged: float = 1e-4
    """A step down that moves no logarithm of the water by as much is the last."""


STEPS = Steps()
BRIGHTEST = 20.0
"""Logarithm of light above which all counts as this: it is finite, and far above that of any
image.
"""


@dataclass(frozen=True)
class Noise:
    """Errors of a quantile; chosen on the synthetic scenes and reefs of seeds below 100
    (docs/lab/color.md).
    """

    content: tuple[float, ...] = (0.6, 0.6, 0.6, 0.5, 0.4, 0.25, 0.1, 0.1, 0.1)
    """Standard deviation of each quantile, dark to bright, as a fraction of the direct signal:
    content differs from range to range, dark content most. In photographs with measured depth by
    0.4 to 0.6 at the dark end, 0.1 to 0.2 at the bright one.
    """
    all: float = 0.05
    """Fraction of all light, backscatter included."""
    outlier: float = 2.0
    """Standard deviations beyond which a quantile weighs less than half (Cauchy)."""
    floor: float = 0.001
    """Light that a camera's offset hides, against the brightest."""
    darker: float = 0.03
    """Fraction by which backscatter may exceed the darkest quantile: nothing is darker than the
    backscatter before it.
    """

    green_over_blue: float = 0.06
    """1/m, most by which attenuation of green exceeds that of blue. Pure water absorbs 0.036 more
    at 535 than at 460 nm (Pope, Fry 1997), and all else in the sea absorbs blue more. Cameras, and
    daylight lost on its way down to what lies deeper, add some.
    """
    rate: float = 0.01
    """1/m, standard deviation beyond it."""


NOISE = Noise()


class Problem(NamedTuple):
    """A frame's data and prior. range_m (G,): meters. light (3, G, P): quantiles, as fractions of
    the brightest.

    clipped (3, G, P). trust (G,): weight of each range, 0..1. mean (n,), precision (n, n): of the
    Gaussian prior.
    """

    range_m: Array
    light: Array
    clipped: NDArray[np.bool_]
    trust: Array
    mean: Array
    precision: Array


class Normal(NamedTuple):
    """Frames at some parameters. cost (N,): with renewed weights; cost_before: with those given.
    weights (N, 3, G, P).

    matrix (N, n, n): Gauss-Newton's; slope (N, n): the gradient.
    """

    cost: Array
    cost_before: Array
    weights: Array
    matrix: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class Batch:
    """Problems side by side. z, trust (N, 1, G); log_light, clipped (N, 3, G, P); mean (N, n);
    precision (N, n, n).
    """

    z: Array
    trust: Array
    log_light: Array
    clipped: NDArray[np.bool_]
    mean: Array
    precision: Array

    @classmethod
    def of(cls, problems: Sequence[Problem]) -> Self:
        """Several problems, padded to the ranges of the one that has most: ranges without trust,
        which move nothing.
        """
        groups = max(len(problem.range_m) for problem in problems)
        parts = zip(*(_padded(problem, groups) for problem in problems), strict=True)
        z, light, clipped, trust, mean, precision = (np.stack(part) for part in parts)
        return cls(
            z[:, None], trust[:, None], np.log(light + NOISE.floor), clipped, mean, precision
        )

    def at(self, keep: NDArray[np.bool_]) -> Self:
        """The problems of a mask (N,)."""
        return type(self)(*(getattr(self, part.name)[keep] for part in fields(self)))

    def normal(self, x: Array, weights: Array | None = None) -> Normal:
        """Costs and normal equations at x (N, n). weights: those of ``cost_before``; None: the
        renewed ones.
        """
        number, _, groups, quantiles = self.log_light.shape
        log_transmitted, veil, by_a, by_b = self.water(x)
        reflectance = x[:, WATER:-groups].reshape(number, 3, 1, quantiles)
        brightness = x[:, None, -groups:, None]
        direct = np.exp(
            np.minimum(log_transmitted[..., None] + brightness + reflectance, BRIGHTEST)
        )
        hidden = veil + NOISE.floor
        light = direct + hidden[..., None]
        u = 1 / light
        q, r = direct * u, np.log(light) - self.log_light
        w = self.trust[..., None] / (
            np.square(np.array(NOISE.content) * q) + NOISE.all**2 + np.square(r / NOISE.outlier)
        )
        w[self.clipped & (r > 0)] = 0
        over = np.maximum(np.log(hidden) - self.log_light[..., 0], 0) * ~self.clipped[..., 0]
        w_over = self.trust / NOISE.darker**2
        excess, by_rates = _excess(x)
        away = x - self.mean
        pull = (self.precision @ away[..., None])[..., 0]
        rest = 0.5 * ((w_over * over**2).sum((1, 2)) + (excess**2).sum(1) + (away * pull).sum(1))
        cost = 0.5 * (w * r * r).sum((1, 2, 3)) + rest
        before = cost.copy() if weights is None else 0.5 * (weights * r * r).sum((1, 2, 3)) + rest

        wq, wu, k = w * q, w * u, w_over * (over > 0) / hidden
        wqq, wqu, wqr = wq * q, wq * u, wq * r
        qq, qu, qr = (part.sum(3)[:, :, None] for part in (wqq, wqu, wqr))
        uu = ((wu * u).sum(3) + k / hidden)[:, :, None]
        ur = ((wu * r).sum(3) + k * over)[:, :, None]
        by_bright = by_a * qq + by_b * qu
        by_water = by_bright @ by_a.mT + (by_a * qu + by_b * uu) @ by_b.mT
        by_content = by_a @ wqq + by_b @ wqu
        along = (by_a * qr + by_b * ur).sum(3)
        matrix, slope = self.precision.copy(), pull
        for c in range(3):
            own = slice(c, WATER, 3)
            mine = slice(WATER + c * quantiles, WATER + (c + 1) * quantiles)
            matrix[:, own, own] += by_water[:, c]
            for one, other, block in (
                (own, mine, by_content),
                (own, slice(-groups, None), by_bright),
                (mine, slice(-groups, None), wqq.mT),
            ):
                matrix[:, one, other] += block[:, c]
                matrix[:, other, one] += block[:, c].mT
            slope[:, own] += along[:, c]
        rest_of_x = np.arange(WATER, x.shape[1])
        matrix[:, rest_of_x, rest_of_x] += np.concatenate(
            [wqq.sum(2).reshape(number, -1), qq.sum((1, 2))], axis=1
        )
        slope[:, WATER:] += np.concatenate([wqr.sum(2).reshape(number, -1), qr.sum((1, 2))], axis=1)
        matrix[:, :6, :6] += by_rates.mT @ by_rates
        slope[:, :6] += (by_rates.mT @ excess[..., None])[..., 0]
        return Normal(cost, before, w, matrix, slope)

    def water(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """log(A white) and B (N, 3, G), and their derivatives by the five logarithms of their
        channel, (N, 3, 5, G).
        """
        far, near, beta, scatter, white = x[:, :WATER].reshape(-1, 5, 3, 1).transpose(1, 0, 2, 3)
        y, rate, saturated = np.exp(far), np.exp(beta), np.exp(scatter + white)
        fading = self.z * ged(RATE_OF_CHANGE * self.z)
        lost = y * (np.expm1(near) * fading + self.z)
        veil = saturated * cged(rate * self.z)
        by_a, by_b = np.zeros((2, len(x), 3, 5, self.z.shape[-1]))
        by_a[:, :, 0], by_a[:, :, 1], by_a[:, :, 4] = -lost, -np.exp(far + near) * fading, 1
        by_b[:, :, 2] = saturated * rate * self.z * ged(rate * self.z)
        by_b[:, :, 3] = by_b[:, :, 4] = veil
        return white - lost, veil, by_a, by_b


def minimize(
    problems: Sequence[Problem], start: Sequence[Array], enough: float = 0.0
) -> tuple[list[Array], list[Array], Array]:
    """Minimize each problem's cost from its start; returns parameters, Gauss-Newton matrices and
    costs at the minima.

    enough: a step down that lowers a cost by less is its last, where costs alone are wanted.
    Problems that have converged are left out of further steps.
    """
    groups = max(len(problem.range_m) for problem in problems)
    x = np.stack(
        [
            np.pad(x, (0, groups - len(problem.range_m)))
            for x, problem in zip(start, problems, strict=True)
        ]
    )
    # steps that go too far may overflow: their cost is no lower, and they are not taken
    with one_thread_in_products(), np.errstate(all="ignore"):
        now = _descend(Batch.of(problems), x, enough)
    sizes = [len(problem.mean) for problem in problems]
    found = [one[:size].copy() for one, size in zip(x, sizes, strict=True)]
    return (
        found,
        [one[:size, :size].copy() for one, size in zip(now.matrix, sizes, strict=True)],
        now.cost,
    )


def _descend(batch: Batch, x: Array, enough: float) -> Normal:
    """Step from x (N, n), which is changed, to the minima."""
    going, damping = np.arange(len(x)), np.full(len(x), STEPS.first_damping)
    now = batch.normal(x)
    here, known = batch, now
    for _ in range(STEPS.most):
        at, damp, diagonal = x[going], damping[going], np.arange(x.shape[1])
        damped = known.matrix.copy()
        damped[:, diagonal, diagonal] *= 1 + damp[:, None]
        move = np.clip(_solved(damped, known.slope), -STEPS.largest_move, STEPS.largest_move)
        trial = here.normal(at - move, known.weights)
        better = trial.cost_before < known.cost
        small = better & (
            (np.abs(move[:, :WATER]).max(axis=1) < STEPS.converged)
            | (known.cost - trial.cost_before < enough)
        )
        x[going[better]] = (at - move)[better]
        damping[going] = np.where(
            better,
            np.maximum(STEPS.less_damping * damp, STEPS.least_damping),
            STEPS.more_damping * damp,
        )
        for whole, part in zip(now, trial, strict=True):
            whole[going[better]] = part[better]
        left = ~small & (damping[going] < STEPS.most_damping)
        if not left.any():
            break
        here = here if left.all() else here.at(left)
        going = going[left]
        known = Normal(*(part[going] for part in now))
    return now


def _solved(matrix: Array, vector: Array) -> Array:
    """Solves (N, n, n) symmetric positive definite systems; where rounding made one singular, by
    the step of steepest descent.
    """
    try:
        np.linalg.cholesky(matrix)
        return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return vector / matrix.diagonal(axis1=1, axis2=2)
        return np.concatenate(
            [_solved(matrix[i : i + 1], vector[i : i + 1]) for i in range(len(matrix))]
        )


def _excess(x: Array) -> tuple[Array, Array]:
    """(N, 2) excess of green's attenuation over blue's, far and near, above what water can have,
    and its slopes (N, 2, 6).
    """
    rates = np.exp(np.stack([x[:, :3], x[:, :3] + x[:, 3:6]], axis=1)) / NOISE.rate
    excess = np.maximum(rates[:, :, 1] - rates[:, :, 2] - NOISE.green_over_blue / NOISE.rate, 0)
    slopes = np.zeros((len(x), 2, 6))
    slopes[:, :, 1], slopes[:, :, 2] = rates[:, :, 1], -rates[:, :, 2]
    slopes[:, 1, 4:6] = slopes[:, 1, 1:3]
    return excess, slopes * (excess > 0)[..., None]


def _padded(problem: Problem, groups: int) -> tuple[NDArray[np.generic], ...]:
    """A problem's arrays with ``groups`` ranges; those that are added have no trust, and a prior by
    themselves.
    """
    more, size = groups - len(problem.range_m), len(problem.mean)
    precision = np.eye(size + more)
    precision[:size, :size] = problem.precision
    in_groups = ((0, 0), (0, more), (0, 0))
    return (
        np.pad(problem.range_m, (0, more), constant_values=1.0),
        np.pad(problem.light, in_groups, constant_values=1.0),
        np.pad(problem.clipped, in_groups),
        np.pad(problem.trust, (0, more)),
        np.pad(problem.mean, (0, more)),
        precision,
    )
