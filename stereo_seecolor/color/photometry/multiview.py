"""The water from places seen at two ranges or more: what changes between sightings of one place is the water, whatever its color.

    light_kc = S_c A_c(z_k) + B_c(z_k),   A = exp(-z far (1 + (FALL - 1) exp(-z / 4 m))),   B = gamma_inf (1 - exp(-beta z))

for a place of unknown brightness S (its reflectance and the light on it) seen at ranges z_k: ratios of sightings hold A alone, with
no gray world in them. Sightings measure the slope of log A over the ranges that they span; how it bends (FALL, a rate near against
far) is nearly the same in all waters, and taken from them. S enters linearly and is eliminated (variable projection: Golub and
Pereyra 2003), the nine numbers of the water follow by damped Gauss-Newton steps. Light that moves scales all channels of a sighting
alike: that scatter is measured and given to all three together, so that it blurs how dark the water is but hardly its color. Wrong
matches weigh less (Cauchy).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.color.fitting.water_prior import RATE_OF_CHANGE, water_prior
from stereo_seecolor.color.photometry.sightings import KeyFrame, Sightings, find_sightings
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Water

Array = NDArray[np.float64]

LEAST_SIGHTINGS = 200
LEAST_RATIO = 1.1
"""Far over near of the sightings of a place, at the 90 % quantile, below which they hold nothing of the water."""
VEIL_MEAN, VEIL_DEVIATION = np.log(0.05), 2.0
"""Prior of log gamma_inf: next to nothing is known before."""
FLOOR = 0.001
"""Least standard deviation of a sighting's light, share of full scale."""
OUTLIER = 3.0
"""Beyond this many standard deviations a sighting weighs less than half."""
NOTHING_LEARNED = 0.9
"""A standard error of at least this share of the prior's says that the sightings told nothing."""
STEPS = 40


def fit_multiview(frames: Sequence[KeyFrame], geometry: RectifiedPair, encoding: InputEncoding) -> Water:
    """Attenuation and backscatter of the water between the frames; its white point stays 1, as no ratio can tell it.

    Raises ColorError where too few places are seen, or all at one range.
    """
    return fit_sightings(find_sightings(frames, geometry, encoding), encoding)


def fit_sightings(sightings: Sightings, encoding: InputEncoding) -> Water:
    """As fit_multiview, from sightings already found."""
    _check(sightings)
    mean, precision = _prior()
    x, damping = mean.copy(), 1e-2
    fit = _Fit.at(x, sightings, _Scatter(0.05, 0.05), None)
    for step in range(STEPS):
        fit = _Fit.at(x, sightings, fit.scatter_now() if step else fit.scatter, fit if step else None)
        normal, slope = fit.normal() + precision, fit.slope() - precision @ (x - mean)
        cost = fit.cost() + (x - mean) @ precision @ (x - mean)
        for _ in range(8):
            move = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
            trial = x + np.clip(move, -0.7, 0.7)
            there = _Fit.with_weights(trial, sightings, fit.weights, fit.scatter)
            if there.cost() + (trial - mean) @ precision @ (trial - mean) <= cost:
                damping = max(damping * 0.3, 1e-8)
                break
            damping *= 5
        else:
            break
        moved, x = float(np.abs(trial - x).max()), trial
        fit = there
        if moved < 1e-4 and step > 5:
            break
    covariance = _covariance(fit, precision)
    return _water(x, np.sqrt(np.diag(covariance)), np.sqrt(np.diag(np.linalg.inv(precision))), encoding)


def with_white_of(water: Water, scene: Water, sightings: Sightings) -> Water:
    """``water`` with the white point that gives a middling sighting the color that ``scene``, fitted to images, gives it."""
    z: Array = np.array(np.median(sightings.range_m))
    light: Array = np.array(np.median(sightings.light, axis=0))
    direct, scene_direct = (np.maximum(light - w.backscatter(z), 0.05 * light) for w in (water, scene))
    white = scene.white * (direct / scene_direct) * scene.attenuation(z) / water.attenuation(z)
    errors = water.standard_errors | {"white": scene.standard_errors.get("white", np.full(3, np.nan))}
    return replace(water, white=white, standard_errors=errors)


@dataclass(frozen=True)
class _Scatter:
    """Relative standard deviation of a sighting's direct signal: of each channel by itself, and of all together."""

    each: float
    together: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """The sightings under one water, with the best brightness of each place.

    transmission, direct, residual: (N, 3). weights: (N, 3, 3) inverse covariances. change: (N, 3, 3) of a channel's light by the
    logarithms of its far, beta, gamma_inf. place_weights: (P, 3, 3).
    """

    sightings: Sightings
    scatter: _Scatter
    transmission: Array
    direct: Array
    residual: Array
    weights: Array
    change: Array
    place_weights: Array

    @classmethod
    def at(cls, x: Array, sightings: Sightings, scatter: _Scatter, before: "_Fit | None") -> "_Fit":
        """Weights from the scatter of the direct signal that was found ``before``, and less for what was far off then."""
        _, backscatter, _ = _model(x, sightings.range_m)
        direct = np.maximum(sightings.light - backscatter if before is None else before.direct, 0.0)
        alone = 1.0 / (FLOOR**2 + (scatter.each * direct) ** 2)
        pulled = alone * direct
        shared = scatter.together**2 / (1.0 + scatter.together**2 * (pulled * direct).sum(axis=1))
        weights = alone[:, :, None] * np.eye(3) - shared[:, None, None] * pulled[:, :, None] * pulled[:, None, :]
        if before is not None:
            off = np.einsum("kc,kce,ke->k", before.residual, weights, before.residual) / 3.0
            weights /= (1.0 + off / OUTLIER**2)[:, None, None]
        return cls.with_weights(x, sightings, weights, scatter)

    @classmethod
    def with_weights(cls, x: Array, sightings: Sightings, weights: Array, scatter: _Scatter) -> "_Fit":
        """The same with the weights kept."""
        transmission, backscatter, change = _model(x, sightings.range_m)
        above = sightings.light - backscatter
        place_weights = _by_place(sightings, transmission[:, :, None] * weights * transmission[:, None, :])
        along = _by_place(sightings, transmission * np.einsum("kce,ke->kc", weights, above))
        brightness = np.linalg.solve(place_weights, along[..., None])[..., 0]
        direct = brightness[sightings.place] * transmission
        light_change = change[0] * direct[..., None] + change[1]
        return cls(sightings, scatter, transmission, direct, above - direct, weights, light_change, place_weights)

    def cost(self) -> float:
        """Sum of squares, weighted."""
        return float(np.einsum("kc,kce,ke->", self.residual, self.weights, self.residual))

    def normal(self) -> Array:
        """(9, 9) Gauss-Newton matrix with the brightnesses eliminated."""
        weighted = self.weights[..., None] * self.change[:, None]
        full = np.einsum("kci,kcej->icje", self.change, weighted).reshape(9, 9)
        shared = _by_place(self.sightings, self.transmission[:, :, None, None] * weighted)
        shared = shared.transpose(0, 1, 3, 2).reshape(-1, 3, 9)
        return np.asarray(full - np.einsum("pai,paj->ij", shared, np.linalg.solve(self.place_weights, shared)))

    def slope(self) -> Array:
        """(9,) along which the cost falls; the brightnesses are at their best, so they add nothing."""
        pull = np.einsum("kce,ke->kc", self.weights, self.residual)
        return np.asarray(np.einsum("kci,kc->ic", self.change, pull).reshape(9))

    def slope_by_frame(self) -> Array:
        """(F, 9) what each frame adds to the slope."""
        pull = np.einsum("kce,ke->kc", self.weights, self.residual)
        each = (self.change * pull[..., None]).transpose(0, 2, 1).reshape(-1, 9)
        frames = int(self.sightings.frame.max()) + 1
        return np.stack([np.bincount(self.sightings.frame, column, minlength=frames) for column in each.T], axis=1)

    def scatter_now(self) -> _Scatter:
        """From the residuals of the brighter half: what differs between channels is each one's own, the rest is all together."""
        bright = self.direct.min(axis=1) > np.median(self.direct.min(axis=1))
        relative = self.residual[bright] / self.direct[bright]
        each = min(_deviation(relative[:, c] - relative[:, (c + 1) % 3]) for c in range(3)) / np.sqrt(2.0)
        every = _deviation(relative.mean(axis=1))
        together = np.sqrt(max(every**2 - each**2 / 3.0, 0.0))
        return _Scatter(float(np.clip(each, 0.003, 0.3)), float(np.clip(together, 0.003, 0.5)))


def _model(x: Array, range_m: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """A, B (N, 3), and the change of log A and of B by the nine logarithms, both (N, 3, 3)."""
    log_far, log_beta, log_veil = x.reshape(3, 3)
    z = range_m[:, None]
    loss = z * np.exp(log_far) * (1.0 + (_fall() - 1.0) * np.exp(-RATE_OF_CHANGE * z))
    fog = np.exp(-np.exp(log_beta) * z)
    backscatter = np.exp(log_veil) * (1.0 - fog)
    nothing = np.zeros_like(loss)
    by_attenuation = np.stack([-loss, nothing, nothing], axis=-1)
    by_backscatter = np.stack([nothing, np.exp(log_veil + log_beta) * z * fog, backscatter], axis=-1)
    return np.exp(-loss), backscatter, (by_attenuation, by_backscatter)


def _fall() -> Array:
    """(3,) a channel's rate of attenuation near against far, in the mean of known waters."""
    return np.exp(water_prior()[0][3:6])


def _by_place(sightings: Sightings, values: Array) -> Array:
    """Sums over the sightings of each place; places are sorted."""
    first = np.flatnonzero(np.diff(sightings.place, prepend=-1))
    return np.asarray(np.add.reduceat(values, first, axis=0))


def _deviation(values: Array) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _prior() -> tuple[Array, Array]:
    """Mean (9,) and precision (9, 9): water that exists for the rates, nearly nothing for the veil."""
    mean, covariance = water_prior()
    rates = [0, 1, 2, 6, 7, 8]
    spread = np.zeros((9, 9))
    spread[:6, :6] = covariance[np.ix_(rates, rates)]
    spread[6:, 6:] = VEIL_DEVIATION**2 * np.eye(3)
    return np.concatenate([mean[rates], np.full(3, VEIL_MEAN)]), np.asarray(np.linalg.inv(spread), dtype=np.float64)


def _covariance(fit: _Fit, precision: Array) -> Array:
    """(9, 9) with errors that a frame's sightings share (its exposure, its pose, its light) counted once: clustered by frame."""
    inverse = np.linalg.inv(fit.normal() + precision)
    by_frame = fit.slope_by_frame()
    used = int(np.any(by_frame != 0, axis=1).sum())
    meat = by_frame.T @ by_frame * used / max(used - 1, 1)
    return np.asarray(inverse @ (meat + precision) @ inverse)


def _check(sightings: Sightings) -> None:
    if len(sightings.place) < LEAST_SIGHTINGS:
        raise ColorError(
            f"only {len(sightings.place)} sightings of places that several frames see: "
            "the frames do not overlap, or the trajectory is not theirs"
        )
    first = np.flatnonzero(np.diff(sightings.place, prepend=-1))
    near, far = (extreme.reduceat(sightings.range_m, first) for extreme in (np.minimum, np.maximum))
    ratio = float(np.quantile(far / near, 0.9))
    if ratio < LEAST_RATIO:
        raise ColorError(f"the same places are seen at nearly one range only (far over near {ratio:.2f}): fly at two altitudes")


def _water(x: Array, error: Array, before: Array, encoding: InputEncoding) -> Water:
    far, beta, gamma_inf = np.exp(x).reshape(3, 3)
    fall = _fall()
    learned = (error < NOTHING_LEARNED * before).reshape(3, 3)
    scales = {"y": far, "beta": beta, "gamma_inf": gamma_inf}
    errors = {name: np.where(learned[i], error.reshape(3, 3)[i] * scale, np.nan) for i, (name, scale) in enumerate(scales.items())}
    errors["w"] = errors["y"] * np.abs(fall - 1.0)
    return Water(
        gamma_inf=gamma_inf,
        beta=beta,
        eta=np.zeros(3),
        alpha=np.ones(3),
        w=far * (fall - 1.0),
        v=np.full(3, RATE_OF_CHANGE),
        y=far,
        x=np.zeros(3),
        standard_errors=errors | {"white": np.full(3, np.nan)},
        input_encoding=encoding,
    )
