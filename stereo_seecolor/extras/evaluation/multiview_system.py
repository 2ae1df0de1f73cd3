"""The observations of patches under one water: residuals, weights and the Gauss-Newton system of
``multiview``'s nine parameters.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibration.robust_statistics import deviation
from stereo_seecolor.color.fitting.water_prior import RATE_OF_CHANGE, water_prior
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.records import Array
from stereo_seecolor.water.physics import backscatter, optical_depth


@dataclass(frozen=True)
class SightingNoise:
    """Errors of an observation's light; tested on synthetic waters and on the sample dive."""

    noise_floor: float = 0.001
    """Least standard deviation of an observation's light: a quarter of a step of 8 bits."""
    outlier: float = 3.0
    """Standard deviations beyond which an observation weighs less than half (Cauchy)."""
    first_scatter: float = 0.05
    """Relative scatter of the direct signal before any residual is known."""
    scatter_each: tuple[float, float] = (0.003, 0.3)
    """Limits of a channel's own relative scatter: quantization of 8 bits, and no measurement."""
    scatter_together: tuple[float, float] = (0.003, 0.5)
    """Limits of the scatter that all channels have in common: moving light makes it larger."""


NOISE = SightingNoise()


@dataclass(frozen=True)
class Scatter:
    """Relative standard deviation of an observation's direct signal: of each channel by itself, and
    of all together.
    """

    each: float
    together: float


class Model(NamedTuple):
    """The water at the ranges of the observations. transmission, backscatter: (N, 3). changes: of
    log transmission and of backscatter by the nine logarithms, (N, 3, 3).
    """

    transmission: Array
    backscatter: Array
    changes: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class MultiviewFit:
    """The observations under one water, with the best brightness of each patch.

    direct, residual: (N, 3). weights: (N, 3, 3) inverse covariances. change: (N, 3, 3) of a
    channel's light by the logarithms of its far, beta, gamma_inf. patch_weights: (P, 3, 3).
    """

    observations: Observations
    scatter: Scatter
    model: Model
    direct: Array
    residual: Array
    weights: Array
    change: Array
    patch_weights: Array

    @classmethod
    def of(
        cls,
        model: Model,
        observations: Observations,
        scatter: Scatter,
        before: "MultiviewFit | None" = None,
    ) -> "MultiviewFit":
        """The fit under water parameters, with weights from the fit ``before``, if any."""
        direct = np.maximum(
            observations.light - model.backscatter if before is None else before.direct, 0.0
        )
        alone = 1.0 / (NOISE.noise_floor**2 + (scatter.each * direct) ** 2)
        pulled = alone * direct
        shared = scatter.together**2 / (1.0 + scatter.together**2 * (pulled * direct).sum(axis=1))
        weights = (
            alone[:, :, None] * np.eye(3)
            - shared[:, None, None] * pulled[:, :, None] * pulled[:, None, :]
        )
        if before is not None:
            off = np.einsum("kc,kce,ke->k", before.residual, weights, before.residual) / 3.0
            weights /= (1.0 + off / NOISE.outlier**2)[:, None, None]
        return cls.with_weights(model, observations, weights, scatter)

    @classmethod
    def with_weights(
        cls, model: Model, observations: Observations, weights: Array, scatter: Scatter
    ) -> "MultiviewFit":
        """The fit under water parameters with given weights."""
        transmission, backscatter, change = model
        above = observations.light - backscatter
        patch_weights = sums_by_patch(
            observations, transmission[:, :, None] * weights * transmission[:, None, :]
        )
        along = sums_by_patch(observations, transmission * np.einsum("kce,ke->kc", weights, above))
        brightness = np.linalg.solve(patch_weights, along[..., None])[..., 0]
        direct = brightness[observations.patch] * transmission
        light_change = change[0] * direct[..., None] + change[1]
        return cls(
            observations,
            scatter,
            model,
            direct,
            above - direct,
            weights,
            light_change,
            patch_weights,
        )

    def cost(self) -> float:
        """The weighted sum of squares."""
        return float(np.einsum("kc,kce,ke->", self.residual, self.weights, self.residual))

    def normal(self) -> Array:
        """(9, 9) Gauss-Newton matrix with the brightnesses eliminated."""
        weighted = self.weights[..., None] * self.change[:, None]
        full = np.einsum("kci,kcej->icje", self.change, weighted).reshape(9, 9)
        shared = sums_by_patch(
            self.observations, self.model.transmission[:, :, None, None] * weighted
        )
        shared = shared.transpose(0, 1, 3, 2).reshape(-1, 3, 9)
        return np.asarray(
            full - np.einsum("pai,paj->ij", shared, np.linalg.solve(self.patch_weights, shared))
        )

    def slope(self) -> Array:
        """(9,) negative half gradient of the cost; optimal brightnesses add nothing."""
        pull = np.einsum("kce,ke->kc", self.weights, self.residual)
        return np.asarray(np.einsum("kci,kc->ic", self.change, pull).reshape(9))

    def slope_by_frame(self) -> Array:
        """(F, 9) contribution of each frame to the slope."""
        pull = np.einsum("kce,ke->kc", self.weights, self.residual)
        each = (self.change * pull[..., None]).transpose(0, 2, 1).reshape(-1, 9)
        frames = int(self.observations.frame.max()) + 1
        return np.stack(
            [np.bincount(self.observations.frame, column, minlength=frames) for column in each.T],
            axis=1,
        )

    def scatter_now(self) -> Scatter:
        """Scatter of the brighter half: between channels is a channel's own, the rest common."""
        bright = self.direct.min(axis=1) > np.median(self.direct.min(axis=1))
        relative = self.residual[bright] / self.direct[bright]
        each = min(
            deviation(relative[:, c] - relative[:, (c + 1) % 3]) for c in range(3)
        ) / np.sqrt(2.0)
        every = deviation(relative.mean(axis=1))
        together = np.sqrt(max(every**2 - each**2 / 3.0, 0.0))
        return Scatter(
            float(np.clip(each, *NOISE.scatter_each)),
            float(np.clip(together, *NOISE.scatter_together)),
        )


def model_of(x: Array, range_m: Array) -> Model:
    """The water of nine logarithms."""
    import torch

    z, fall = torch.from_numpy(range_m)[:, None], torch.from_numpy(near_against_far())
    # an observation's own copies
    logarithms = (
        torch.from_numpy(x).view(3, 1, 3).expand(3, len(range_m), 3).clone().requires_grad_()
    )
    far, beta, saturated = logarithms.exp()
    log_a = -optical_depth(z, far * (fall - 1), RATE_OF_CHANGE, far, 0.0)
    veil = backscatter(z, saturated, beta, 0.0, 0.0)
    by_a, by_b = (
        np.moveaxis(
            torch.autograd.grad(part.sum(), logarithms, retain_graph=True)[0].numpy(), 0, -1
        )
        for part in (log_a, veil)
    )
    return Model(log_a.detach().exp().numpy(), veil.detach().numpy(), (by_a, by_b))


def near_against_far() -> Array:
    """(3,) a channel's rate of attenuation near against far, in the mean of known waters."""
    return np.exp(water_prior()[0][3:6])


def sums_by_patch(observations: Observations, values: Array) -> Array:
    """Sums over the observations of each patch; patches are sorted."""
    first = np.flatnonzero(np.diff(observations.patch, prepend=-1))
    return np.asarray(np.add.reduceat(values, first, axis=0))
