"""The water from patches seen at two ranges or more: differences between observations of one patch
are due to the water.

    light_kc = S_c A_c(z_k) + B_c(z_k), A = exp(-z far (1 + (FALL - 1) exp(-z / 4 m))), B =
        gamma_inf (1 - exp(-beta z))

for a patch of unknown brightness S (its reflectance and the light on it) seen at ranges z_k: ratios
of observations depend on A alone, without an assumption on the scene's colors. Observations measure
the slope of log A over the ranges that they span; its bend (FALL, a rate near against far) is
nearly the same in all waters and taken from known ones. S enters linearly and is eliminated
(variable projection: Golub and Pereyra 2003); the nine parameters of the water follow by damped
Gauss-Newton steps. Light that moves scales all channels of an observation alike. That scatter is
measured and modeled as common to the three channels: it blurs the brightness of the water, but
hardly its color.
Wrong matches weigh less (Cauchy).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration import RectifiedPair
from stereo_seecolor.color.fitting.water_prior import RATE_OF_CHANGE, water_prior
from stereo_seecolor.color.photometry.observations import (
    KeyFrame,
    Observations,
    PhotometricView,
    observations_of,
)
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.errors import ColorError
from stereo_seecolor.extras.evaluation.multiview_system import (
    NOISE,
    MultiviewFit,
    Scatter,
    model_of,
    near_against_far,
)
from stereo_seecolor.records import Array, Water


@dataclass(frozen=True)
class MultiviewSettings:
    """Assumptions, and limits of refusal; tested on synthetic waters and the sample dive."""

    least_observations: int = 200
    """Fewer do not determine nine numbers and their scatter: the fit is refused."""
    least_range_ratio: float = 1.1
    """Least far over near range of a patch, at ``range_ratio_quantile`` of the patches."""
    range_ratio_quantile: float = 0.9
    """A tenth of the patches may be wrong matches, whose ratio says nothing."""
    backscatter_mean: float = float(np.log(0.05))
    """Prior mean of log gamma_inf (fraction of full scale): a guess, made weak by its deviation."""
    backscatter_deviation: float = 2.0
    """Prior standard deviation of log gamma_inf: a factor of 7 up or down."""
    nothing_learned: float = 0.9
    """A standard error of at least this fraction of the prior's was not measured."""
    least_direct: float = 0.05
    """Direct signal left at least, fraction of the light: a logarithm needs some."""
    most_patches: int = 20_000
    """Largest number of patches of all frames together, which limits memory and time."""
    most_patches_a_frame: int = 1600
    """Largest number of patches of a frame: a grid of about 40 by 40."""


@dataclass(frozen=True)
class StepSettings:
    """Damped Gauss-Newton steps (Levenberg 1944; Marquardt 1963)."""

    most_steps: int = 40
    """Most steps with new weights, if it does not converge before."""
    least_steps: int = 6
    """The robust weights have settled by then."""
    first_damping: float = 1e-2
    """Initial damping, as a fraction of the diagonal."""
    least_damping: float = 1e-8
    """Least damping: below, a step is nearly Gauss-Newton's."""
    less_damping: float = 0.3
    """Factor after a step that lowered the cost."""
    more_damping: float = 5.0
    """Factor after one that did not."""
    most_trials: int = 8
    """Dampings tried before the fit ends where it is: then the damping is 5**8 times the first."""
    longest_step: float = 0.7
    """Largest change of a logarithm in one step: a factor of 2."""
    converged: float = 1e-4
    """Change of a logarithm below which the fit has converged: 0.01 % of a parameter."""


SETTINGS = MultiviewSettings()
STEPS = StepSettings()


def find_observations(
    frames: Sequence[KeyFrame], geometry: RectifiedPair, encoding: InputEncoding
) -> Observations:
    """Find observations of patches that several frames show; frames are read twice."""
    number = min(SETTINGS.most_patches_a_frame, SETTINGS.most_patches // max(len(frames), 1))
    points_m = np.concatenate(
        [PhotometricView.of(frame, geometry, None).patches_m(number) for frame in frames]
    )
    views = (PhotometricView.of(frame, geometry, encoding) for frame in frames)
    return observations_of(points_m, views, range(len(frames)))


def fit_observations(observations: Observations, encoding: InputEncoding) -> Water:
    """Fit attenuation and backscatter of the water to observations. The white point is 1, as no
    ratio determines it.

    Raises ColorError where there are too few observations, or all are at nearly one range.
    """
    _check(observations)
    mean, precision = _prior()
    x, damping = mean.copy(), STEPS.first_damping
    first = Scatter(NOISE.first_scatter, NOISE.first_scatter)
    fit = MultiviewFit.of(model_of(x, observations.range_m), observations, first)
    for step in range(STEPS.most_steps):
        if step:
            fit = MultiviewFit.of(fit.model, observations, fit.scatter_now(), fit)
        better = _lower(fit, x, damping, (mean, precision))
        if better is None:
            break
        trial, fit, damping = better
        moved, x = float(np.abs(trial - x).max()), trial
        if moved < STEPS.converged and step >= STEPS.least_steps:
            break
    covariance = _covariance(fit, precision)
    return _water(
        x, np.sqrt(np.diag(covariance)), np.sqrt(np.diag(np.linalg.inv(precision))), encoding
    )


def with_white_of(water: Water, scene: Water, observations: Observations) -> Water:
    """``water`` with the white point under which the median observation gets the color that
    ``scene``, fitted to images, gives it.
    """
    z: Array = np.array(np.median(observations.range_m))
    light: Array = np.array(np.median(observations.light, axis=0))
    direct, scene_direct = (
        np.maximum(light - w.backscatter(z), SETTINGS.least_direct * light) for w in (water, scene)
    )
    white = scene.white * (direct / scene_direct) * scene.attenuation(z) / water.attenuation(z)
    errors = water.standard_errors | {
        "white": scene.standard_errors.get("white", np.full(3, np.nan))
    }
    return replace(water, white=white, standard_errors=errors)


def _lower(
    fit: MultiviewFit, x: Array, damping: float, prior: tuple[Array, Array]
) -> tuple[Array, MultiviewFit, float] | None:
    """The next parameters, fit and damping; None where none is better. prior: mean, precision."""
    mean, precision = prior
    normal, slope = fit.normal() + precision, fit.slope() - precision @ (x - mean)
    cost = fit.cost() + (x - mean) @ precision @ (x - mean)
    for _ in range(STEPS.most_trials):
        move = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
        trial = x + np.clip(move, -STEPS.longest_step, STEPS.longest_step)
        model = model_of(trial, fit.observations.range_m)
        there = MultiviewFit.with_weights(model, fit.observations, fit.weights, fit.scatter)
        if there.cost() + (trial - mean) @ precision @ (trial - mean) <= cost:
            return trial, there, max(damping * STEPS.less_damping, STEPS.least_damping)
        damping *= STEPS.more_damping
    return None


def _prior() -> tuple[Array, Array]:
    """Mean (9,) and precision (9, 9): known waters for the rates, a wide prior for backscatter."""
    mean, covariance = water_prior()
    rates = [0, 1, 2, 6, 7, 8]
    spread = np.zeros((9, 9))
    spread[:6, :6] = covariance[np.ix_(rates, rates)]
    spread[6:, 6:] = SETTINGS.backscatter_deviation**2 * np.eye(3)
    return np.concatenate([mean[rates], np.full(3, SETTINGS.backscatter_mean)]), np.asarray(
        np.linalg.inv(spread), dtype=np.float64
    )


def _covariance(fit: MultiviewFit, precision: Array) -> Array:
    """(9, 9) covariance, clustered by frame: errors that a frame's observations share (its
    exposure, pose and light) count once.
    """
    inverse = np.linalg.inv(fit.normal() + precision)
    by_frame = fit.slope_by_frame()
    used = int(np.any(by_frame != 0, axis=1).sum())
    meat = by_frame.T @ by_frame * used / max(used - 1, 1)
    return np.asarray(inverse @ (meat + precision) @ inverse)


def _check(observations: Observations) -> None:
    if len(observations.patch) < SETTINGS.least_observations:
        raise ColorError(
            f"only {len(observations.patch)} observations of patches of the reef that several "
            "frames see: the frames do not overlap, or the trajectory belongs to another dive"
        )
    first = np.flatnonzero(np.diff(observations.patch, prepend=-1))
    near, far = (
        extreme.reduceat(observations.range_m, first) for extreme in (np.minimum, np.maximum)
    )
    ratio = float(np.quantile(far / near, SETTINGS.range_ratio_quantile))
    if ratio < SETTINGS.least_range_ratio:
        raise ColorError(
            f"all patches are seen at nearly one range only (far over near {ratio:.2f}): fly at "
            "two altitudes"
        )


def _water(x: Array, error: Array, before: Array, encoding: InputEncoding) -> Water:
    """The water of (9,) logarithms and their standard errors, after the fit and ``before`` it."""
    far, beta, gamma_inf = np.exp(x).reshape(3, 3)
    fall = near_against_far()
    learned = (error < SETTINGS.nothing_learned * before).reshape(3, 3)
    scales = {"y": far, "beta": beta, "gamma_inf": gamma_inf}
    errors = {
        name: np.where(learned[i], error.reshape(3, 3)[i] * scale, np.nan)
        for i, (name, scale) in enumerate(scales.items())
    }
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
