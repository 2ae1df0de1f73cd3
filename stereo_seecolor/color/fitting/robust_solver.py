"""Levenberg's damped Gauss-Newton steps for the robust fit, for many frames at once; autograd
computes derivatives of the water.

A parameter vector ``x`` holds logarithms: of the water's 15 parameters, of 3 P reflectances
(channel after channel), of G brightnesses. Every range of a channel has its own copy of the five
numbers of the channel, so that the gradients of sum(log A white) and of sum(B) are the whole
Jacobian: two backward passes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from stereo_seecolor.color.device import one_thread
from stereo_seecolor.color.fitting.water_prior import LARGEST_LOG_NEAR, RATE_OF_CHANGE, WATER
from stereo_seecolor.water.physics import backscatter, optical_depth

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Steps:
    """Settings of the damped steps; weights are computed anew after each step."""

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
    """Largest damping: above it, steps are too short to matter."""
    least_damping: float = 1e-6
    """Least damping: below it, a step is nearly a Gauss-Newton step."""
    converged: float = 1e-4
    """The fit ends with a step that lowers the cost and changes all logarithms by less."""


STEPS = Steps()
BRIGHTEST = 20.0
"""Largest logarithm of light, far above that of any image."""


@dataclass(frozen=True)
class Noise:
    """Errors of a quantile; chosen on synthetic scenes of seeds below 100 (docs/lab/color.md)."""

    content: tuple[float, ...] = (0.6, 0.6, 0.6, 0.5, 0.4, 0.25, 0.1, 0.1, 0.1)
    """Standard deviation of each quantile, dark to bright, as a fraction of the direct signal:
    content differs between ranges, dark content most: in photographs with measured depth by 0.4 to
    0.6 at the dark end, 0.1 to 0.2 at the bright one.
    """
    all: float = 0.05
    """Fraction of all light, backscatter included."""
    outlier: float = 2.0
    """Standard deviations beyond which a quantile has less than half its weight (Cauchy)."""
    odd: float = 4.0
    """Mean squared error of all quantiles of a range, in variances, above which the range gets less
    weight (a fish, wrong ranges). Reefs reach 2. With 4, Sea-thru's frame of 2 to 15 m (real) is
    0.6 degrees better than with 2.5.
    """
    floor: float = 0.001
    """Light that the offset of a camera hides, relative to the brightest."""
    darker: float = 0.015
    """Fraction by which backscatter may exceed the darkest quantile."""
    green_over_blue: float = 0.06
    """1/m, largest excess of the attenuation of green over that of blue. Pure water absorbs 0.036
    more at 535 than at 460 nm (Pope, Fry 1997), and all other substances in the sea absorb blue
    more. Cameras, and the loss of daylight toward deeper parts of the scene, add to it.
    """
    rate: float = 0.01
    """1/m, standard deviation of a larger excess."""


NOISE = Noise()
CONTENT = torch.tensor(NOISE.content, dtype=torch.float64)


class FitProblem(NamedTuple):
    """range_m (G,): meters. light (3, G, P): quantiles over the brightest. clipped (3, G, P). trust
    (G,): weight of each range, 0..1. mean (n,), precision (n, n): of the Gaussian prior.
    """

    range_m: Array
    light: Array
    clipped: NDArray[np.bool_]
    trust: Array
    mean: Array
    precision: Array


class Normal(NamedTuple):
    """cost (N,): with new weights; cost_before: with the given ones. weights (N, 3, G, P). matrix
    (N, n, n): Gauss-Newton's. slope (N, n): the gradient.
    """

    cost: Tensor
    cost_before: Tensor
    weights: Tensor
    matrix: Tensor
    slope: Tensor

    def where(self, better: Tensor, other: "Normal") -> "Normal":
        """Return the frames of this where ``better`` (N,) is True, those of ``other`` elsewhere."""
        if better.all():
            return self
        chosen = (
            torch.where(better.view(-1, *(1,) * (a.dim() - 1)), a, b)
            for a, b in zip(self, other, strict=True)
        )
        return Normal(*chosen)


@dataclass(frozen=True, eq=False)
class Batch:
    """z, trust (N, 1, G); log_light, clipped (N, 3, G, P); mean (N, n); precision (N, n, n)."""

    z: Tensor
    trust: Tensor
    log_light: Tensor
    clipped: Tensor
    mean: Tensor
    precision: Tensor

    @classmethod
    def of(cls, problems: Sequence[FitProblem]) -> Self:
        """Combine several problems, padded to equal numbers of ranges by ranges of trust 0."""
        groups = max(len(problem.range_m) for problem in problems)
        parts = zip(*(_padded(problem, groups) for problem in problems), strict=True)
        z, light, clipped, trust, mean, precision = (
            torch.from_numpy(np.stack(part)) for part in parts
        )
        return cls(
            z[:, None], trust[:, None], (light + NOISE.floor).log(), clipped, mean, precision
        )

    def at(self, keep: Tensor) -> Self:
        """Return the problems of a mask (N,)."""
        return type(self)(**{part.name: getattr(self, part.name)[keep] for part in fields(self)})

    def normal(self, x: Tensor, odd: float, last: Normal | None = None) -> Normal:
        """Compute costs and normal equations at x (N, n). odd: as in ``Noise``. last: where a step
        came from; ``cost_before`` has its weights, None = new ones. Where the step lowers no cost,
        nobody needs the equations, and those of ``last`` are returned.
        """
        number, _, groups, quantiles = self.log_light.shape
        p, *with_graph = self._water(x)
        log_transmitted, veil = (part.detach() for part in with_graph)
        reflectance = x[:, WATER:-groups].view(number, 3, 1, quantiles)
        brightness = x[:, None, -groups:, None]
        direct = (log_transmitted[..., None] + brightness + reflectance).clamp(max=BRIGHTEST).exp()
        u = 1 / (direct + veil[..., None] + NOISE.floor)
        q, r = direct * u, -u.log() - self.log_light
        variance = (CONTENT * q) ** 2 + NOISE.all**2
        trust = self.trust
        if odd < torch.inf:
            misfit = (r**2 / variance).mean((1, 3)).clamp(min=odd)
            trust = trust * ((odd / misfit) ** 2)[:, None]
        w = trust[..., None] / (variance + (r / NOISE.outlier) ** 2)
        w = w.masked_fill(self.clipped & (r > 0), 0)
        over = ((veil + NOISE.floor).log() - self.log_light[..., 0]).clamp(min=0) * ~self.clipped[
            ..., 0
        ]
        w_over = trust / NOISE.darker**2
        rates, excess = _excess(x)
        away = x - self.mean
        pull = (self.precision @ away[..., None])[..., 0]
        rest = 0.5 * ((w_over * over**2).sum((1, 2)) + (excess**2).sum(1) + (away * pull).sum(1))
        cost = 0.5 * (w * r * r).sum((1, 2, 3)) + rest
        before = (
            cost.clone() if last is None else 0.5 * (last.weights * r * r).sum((1, 2, 3)) + rest
        )
        if last is not None and not (before < last.cost).any():
            return last._replace(cost_before=before)

        # log A white and B have copies of their own in p: one backward pass tells them apart
        ((by_a, by_b),) = torch.autograd.grad((with_graph[0] + with_graph[1]).sum(), p)
        wq, wu, k = w * q, w * u, w_over * (over > 0) / (veil + NOISE.floor)
        qq, qu, wqq = (wq * q).sum(3), (wq * u).sum(3), wq * q
        uu, qr = (wu * u).sum(3) + k / (veil + NOISE.floor), (wq * r).sum(3)
        ur = (wu * r).sum(3) + k * over
        by_light = by_a * qq[:, :, None] + by_b * qu[:, :, None]
        water = by_light @ by_a.mT + (by_a * qu[:, :, None] + by_b * uu[:, :, None]) @ by_b.mT
        by_content = by_a @ wqq + by_b @ (wq * u)
        by_bright = by_light.transpose(1, 2).flatten(1, 2)
        along = (by_a * qr[:, :, None] + by_b * ur[:, :, None]).sum(3).mT
        matrix, slope = self.precision.clone(), pull.clone()
        # (N, 5, 3, 5, 3) and (N, 5, 3, 3, P): a channel has no part in another's
        own = matrix[:, :WATER, :WATER].view(number, 5, 3, 5, 3)
        own.diagonal(dim1=2, dim2=4).add_(water.permute(0, 2, 3, 1))
        content_of = slice(WATER, -groups)
        for other in (matrix, matrix.mT):
            mine = other[:, :WATER, content_of].view(number, 5, 3, 3, quantiles)
            mine.diagonal(dim1=2, dim2=3).add_(by_content.permute(0, 2, 3, 1))
            other[:, :WATER, -groups:] += by_bright
            other[:, content_of, -groups:] += wqq.mT.flatten(1, 2)
        slope[:, :WATER] += along.flatten(1)
        matrix.diagonal(dim1=1, dim2=2)[:, WATER:] += torch.cat(
            [wqq.sum(2).reshape(number, -1), qq.sum(1)], 1
        )
        slope[:, WATER:] += torch.cat([(wq * r).sum(2).reshape(number, -1), qr.sum(1)], 1)
        if (excess > 0).any():
            by_rates = _slopes(rates, excess)
            matrix[:, :6, :6] += by_rates.mT @ by_rates
            slope[:, :6] += (by_rates.mT @ excess[..., None])[..., 0]
        return Normal(cost, before, w, matrix, slope)

    def _water(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The five logarithms (2, N, 3, 5, G), for log(A white) and for B; those (N, 3, G)."""
        number, _, groups, _ = self.log_light.shape
        by_channel = x[:, :WATER].view(number, 5, 3, 1).transpose(1, 2)
        p = by_channel.expand(2, number, 3, 5, groups).clone().requires_grad_()
        far, near, _, _, white = p[0].unbind(2)
        y = far.exp()
        log_transmitted = white - optical_depth(
            self.z, torch.expm1(near) * y, RATE_OF_CHANGE, y, 0.0
        )
        _, _, beta, scatter, white = p[1].unbind(2)
        veil = backscatter(self.z, (scatter + white).exp(), beta.exp(), 0.0, 0.0)
        return p, log_transmitted, veil


def minimize(
    problems: Sequence[FitProblem], start: Sequence[Array], enough: float = 0.0
) -> tuple[list[Array], list[Array], Array]:
    """Minimize each problem from its start; return parameters, Gauss-Newton matrices and costs.

    enough: the fit ends with a step that lowers the cost by less, if only costs are needed.
    """
    groups = max(len(problem.range_m) for problem in problems)
    both = zip(start, problems, strict=True)
    padded = np.stack([np.pad(x, (0, groups - len(problem.range_m))) for x, problem in both])
    with one_thread():
        batch, x = Batch.of(problems), _monotonic(torch.from_numpy(padded))
        # from the start, ranges may be odd because the water is: so first with all of them
        for odd in (torch.inf, NOISE.odd):
            now = _descend(batch, x, odd, enough)
    sizes = [len(problem.mean) for problem in problems]
    ends = list(zip(x.numpy(), now.matrix.numpy(), sizes, strict=True))
    found, curvature = [x[:n].copy() for x, _, n in ends], [H[:n, :n].copy() for _, H, n in ends]
    return found, curvature, now.cost.numpy()


def _descend(batch: Batch, x: Tensor, odd: float, enough: float) -> Normal:
    """Move x (N, n) to the minimum, in place; returns what is there. odd: of ``Noise``."""
    found = now = batch.normal(x, odd)
    going, at = torch.arange(len(x)), x.clone()
    damping = x.new_full((len(x),), STEPS.first_damping)
    for step in range(STEPS.most):
        damped = now.matrix.clone()
        damped.diagonal(dim1=1, dim2=2).add_(damping[:, None] * now.matrix.diagonal(dim1=1, dim2=2))
        move = _solved(damped, now.slope).clamp(-STEPS.largest_move, STEPS.largest_move)
        moved = _monotonic(at - move)
        trial = batch.normal(moved, odd, now)
        better = trial.cost_before < now.cost
        small = better & (
            (move[:, :WATER].abs().amax(1) < STEPS.converged)
            | (now.cost - trial.cost_before < enough)
        )
        at, now = torch.where(better[:, None], moved, at), trial.where(better, now)
        damping = torch.where(
            better,
            (STEPS.less_damping * damping).clamp(min=STEPS.least_damping),
            STEPS.more_damping * damping,
        )
        ends = small | (damping >= STEPS.most_damping) | (step == STEPS.most - 1)
        if ends.any():
            x[going[ends]] = at[ends]
            for whole, part in zip(found, now, strict=True):
                whole[going[ends]] = part[ends]
            if ends.all():
                break
            batch, now = batch.at(~ends), Normal(*(part[~ends] for part in now))
            going, at, damping = going[~ends], at[~ends], damping[~ends]
    return found


def _monotonic(x: Tensor) -> Tensor:
    """Parameters whose attenuation is monotonic in range."""
    return torch.cat([x[:, :3], x[:, 3:6].clamp(max=LARGEST_LOG_NEAR), x[:, 6:]], dim=1)


def _solved(matrix: Tensor, vector: Tensor) -> Tensor:
    """Solutions of (N, n, n) systems; the steepest descent where rounding made one singular."""
    factor, failed = torch.linalg.cholesky_ex(matrix)
    solved = torch.cholesky_solve(vector[..., None], factor)[..., 0]
    if not failed.any():
        return solved
    steepest = vector / matrix.diagonal(dim1=1, dim2=2)
    return torch.where(failed[:, None] > 0, steepest, solved)


def _excess(x: Tensor) -> tuple[Tensor, Tensor]:
    """Attenuation far and near (N, 2, 3), green's excess over blue's (N, 2), in deviations."""
    rates = torch.stack([x[:, :3], x[:, :3] + x[:, 3:6]], 1).exp() / NOISE.rate
    return rates, (rates[:, :, 1] - rates[:, :, 2] - NOISE.green_over_blue / NOISE.rate).clamp(
        min=0
    )


def _slopes(rates: Tensor, excess: Tensor) -> Tensor:
    """Derivatives of ``_excess`` by the first six logarithms: (N, 2, 6)."""
    slopes = rates.new_zeros(len(rates), 2, 6)
    slopes[:, :, 1], slopes[:, :, 2] = rates[:, :, 1], -rates[:, :, 2]
    slopes[:, 1, 4:6] = slopes[:, 1, 1:3]
    return slopes * (excess > 0)[..., None]


def _padded(problem: FitProblem, groups: int) -> tuple[NDArray[np.generic], ...]:
    """A problem's arrays with ``groups`` ranges; added ones have no trust and their own prior."""
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
