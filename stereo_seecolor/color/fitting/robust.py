"""The default fit: the water under which the same reef, dark to bright, is seen at every range.

    quantile_p of channel c at range z = B_c(z) + white_c A_c(z) exp(reflectance_cp + brightness_z),
    B_c(z) = gamma_inf_c (1 - exp(-beta_c z)),  A_c(z) = exp(-z (far_c + (near_c - far_c) exp(-z / 4 m)))

Content and light may change with range (brightness_z) as long as they change alike in all channels. Reflectances are nearly
those of natural scenes, a little warm, and the brighter the nearer to gray. Water is near water that exists (``jerlov``). All of
this is one regularized least squares over at most 20 ranges, solved by Gauss-Newton steps; its curvature gives the errors.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.jerlov import RATE_OF_CHANGE, water_prior
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.order_statistics import SHARES, OrderStatistics, summarize
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water

Vector = NDArray[np.float64]

WATER = 15
"""Parameters of the water: log far, log(near / far), log beta, log(gamma_inf / white), log white, each for R, G, B."""

REFLECTANCE = np.log([0.009, 0.012, 0.022, 0.06, 0.12, 0.22, 0.45, 0.75, 1.0])
"""A scene's quantiles (SHARES of order_statistics) against its brightest thousandth."""
NATURAL = np.array([0.2, 0.0, -0.25])
"""Natural scenes are not gray but warm: sand, rock, algae and coral reflect more red than blue (logarithm against green; coral
sand is at 0.16, 0, -0.27, and the mean of photographs in daylight, ImageNet's sRGB 0.485, 0.456, 0.406, at 0.13, 0, -0.25)."""
NATURAL_SHARE = np.array([1, 1, 1, 1, 1, 1, 0.8, 0.5, 0.2])
"""The brighter, the nearer to gray: what is brightest is white, or shines."""
CAST = np.array([0.8, 0.7, 0.5, 0.35, 0.28, 0.25, 0.21, 0.18, 0.17])
"""Standard deviation of a channel's quantile about that, logarithm: dark things have any color, bright ones less."""
TOGETHER, BRIGHTNESS = 0.7, 0.5
"""Standard deviations of what all channels share: a quantile's reflectance, a range's brightness (light, shade, content)."""
NOISE = np.array([0.2, 0.05, 2.0, 0.001, 0.03])
"""Of a quantile: share of its direct signal that content varies by, share of all by which a veil may; beyond how many of these it
counts as an outlier; the light that a camera's offset hides, against the brightest; share by which a veil may pass the darkest."""
FEW_PIXELS = 200.0
"""Quantiles of this many pixels count half: neighbors are often of one thing."""
OUTER, INNER = 20, 6
"""Most steps: of weighing anew, and between."""
NOTHING_LEARNED = 0.9
"""A standard error that is at least this share of the prior's says that the image told nothing."""
LITTLE_RELIEF = 1.2
"""Farthest against nearest range; below, a fit's attenuation is known waters' more than the image's."""


def fit(table: MomentTable, config: ColorConfig, start: Water | None = None) -> Water:
    """The water of a table with at least one pixel, with standard errors; warnings where the table cannot carry its own.

    start: a water to begin from; it changes the time the fit takes, not where it ends. The white point's level is such that
    a scene's brightest thousandth is near full scale at exposure 1.
    """
    seen = summarize(table, config.input_encoding)
    scale = max(float(seen.light[..., -2].max()), 1e-6)
    light = seen.light / scale
    mean, precision, prior_error = _prior(len(seen.range_m), config)
    x = mean.copy()
    x[12:WATER] = np.log(light[:, :, -2].mean(axis=1) + NOISE[3])
    if start is not None and (start.v == RATE_OF_CHANGE).all():
        x[:WATER] = _numbers(start, scale)
    _begin_content(x, seen.range_m, light)
    trust = seen.pixels / (seen.pixels + FEW_PIXELS) * (not seen.clipped.all())
    x, curvature = _minimize(x, seen.range_m, light, seen.clipped, trust, mean, precision, NOISE)
    return replace(_water(x, curvature, scale, prior_error, config), warnings=_warnings(seen))


def _warnings(seen: OrderStatistics) -> tuple[str, ...]:
    """What a person should know before trusting the water."""
    if seen.clipped.all():
        return ("every pixel is at full scale: the water is known waters' (Jerlov's types), not measured",)
    near_m, far_m = seen.range_m[0], seen.range_m[-1]
    if far_m > LITTLE_RELIEF * near_m:
        return ()
    return (f"little relief, {near_m:.2f} to {far_m:.2f} m: attenuation leans on known waters; use color.lock=survey",)


def _begin_content(x: Vector, range_m: Vector, light: NDArray[np.float64]) -> None:
    """Reflectances and brightnesses that suit the water in ``x``: means over ranges and over the rest of the direct signal."""
    log_far, log_near, log_beta, log_veil, log_white = x[:WATER].reshape(5, 3, 1)
    backscatter = np.exp(log_veil + log_white) * -np.expm1(-np.exp(log_beta) * range_m)
    loss = range_m * np.exp(log_far) * (1 + np.expm1(log_near) * np.exp(-RATE_OF_CHANGE * range_m))
    direct = np.log(np.maximum(light - backscatter[..., None], 0.05 * light) + NOISE[3]) + (loss - log_white)[..., None]
    reflectance = x[WATER : WATER + direct[:, 0].size].reshape(3, 1, -1)
    brightness = (direct - reflectance).mean(axis=(0, 2))
    x[WATER + reflectance.size :] = brightness - brightness.mean()
    x[WATER : WATER + reflectance.size] = (direct - x[WATER + reflectance.size :, None]).mean(axis=1).ravel()


def _numbers(water: Water, scale: float) -> Vector:
    """The fifteen numbers of a water, its intensities as shares of ``scale``."""
    veil = np.log(water.gamma_inf / water.white)
    return np.concatenate([np.log(water.y), np.log1p(water.w / water.y), np.log(water.beta), veil, np.log(water.white / scale)])


def _water(x: Vector, curvature: NDArray[np.float64], scale: float, prior_error: NDArray[np.float64], config: ColorConfig) -> Water:
    log_far, log_near, log_beta, log_veil, log_white = x[:WATER].reshape(5, 3)
    error = _errors(np.linalg.solve(curvature, np.eye(len(x), WATER))[:WATER])
    learned = error < NOTHING_LEARNED * prior_error
    far, beta, white = np.exp(log_far), np.exp(log_beta), np.exp(log_white) * scale
    gamma_inf = np.exp(log_veil) * white
    unit = {"y": far, "w": far * np.exp(log_near), "beta": beta, "gamma_inf": gamma_inf, "white": white}
    return Water(
        gamma_inf=gamma_inf,
        beta=beta,
        eta=np.zeros(3),
        alpha=np.ones(3),
        w=far * np.expm1(log_near),
        v=np.full(3, RATE_OF_CHANGE),
        y=far,
        x=np.zeros(3),
        white=white,
        standard_errors={name: np.where(learned[i], error[i] * by, np.nan) for i, (name, by) in enumerate(unit.items())},
        input_encoding=config.input_encoding,
    )


def _errors(covariance: NDArray[np.floating]) -> NDArray[np.float64]:
    """(5, 3) standard errors of the water's numbers; of the white point's without its level, which is exposure."""
    variance = np.diag(covariance)[:WATER].copy()
    colors = np.eye(3) - 1 / 3
    variance[12:] = np.diag(colors @ covariance[12:WATER, 12:WATER] @ colors)
    return np.asarray(np.sqrt(variance).reshape(5, 3), dtype=np.float64)


@lru_cache(maxsize=64)
def _prior(groups: int, config: ColorConfig) -> tuple[Vector, NDArray[np.float64], NDArray[np.float64]]:
    """Mean and precision of all parameters (water, reflectances, brightnesses), and (5, 3) the water's errors before any image."""
    number = SHARES.size
    size = WATER + 3 * number + groups
    content, brightness = slice(WATER, WATER + 3 * number), slice(WATER + 3 * number, size)
    mean, precision = np.zeros(size), np.zeros((size, size))
    mean[:WATER], covariance = _water_prior(config)
    precision[:WATER, :WATER] = np.linalg.inv(covariance)
    warm = NATURAL if config.robust.scene_colors == "natural" else 0 * NATURAL
    mean[content] = (REFLECTANCE + warm[:, None] * NATURAL_SHARE).ravel()
    covariance = np.kron(np.eye(3), np.diag(CAST**2)) + TOGETHER**2 * np.kron(np.ones((3, 3)), np.eye(number))
    precision[content, content] = np.linalg.inv(covariance)
    precision[brightness, brightness] = np.eye(groups) / BRIGHTNESS**2 + 100.0  # their mean is the exposure's
    return mean, precision, _errors(np.linalg.inv(precision))


def _water_prior(config: ColorConfig) -> tuple[Vector, NDArray[np.float64]]:
    """What is known of the fifteen numbers, and what the config pins of them."""
    settings = config.robust
    mean, covariance = (part.copy() for part in water_prior(settings.water_depth_m))
    if settings.attenuation == "constant":
        mean, covariance = _pinned(mean, covariance, slice(3, 6), np.zeros(3), level=0.0)
    if settings.white_point != "scene":
        white = np.zeros(3) if settings.white_point == "none" else np.log(settings.white_point)
        mean, covariance = _pinned(mean, covariance, slice(12, WATER), white - white.mean(), level=4.0)
    return mean, covariance


def _pinned(
    mean: Vector, covariance: NDArray[np.float64], where: slice, values: Vector, level: float
) -> tuple[Vector, NDArray[np.float64]]:
    """A Gaussian with some of its numbers as good as known, but for what all of them share (variance ``level``)."""
    noise = 1e-6 * np.eye(3) + level
    gain = covariance[:, where] @ np.linalg.inv(covariance[where, where] + noise)
    mean = mean + gain @ (values - mean[where])
    return mean, covariance - gain @ covariance[where]


@compiled
def _minimize(x, z, light, clipped, trust, mean, precision, noise):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Levenberg's damped Gauss-Newton steps: the parameters at the least cost, and the Gauss-Newton matrix there."""
    n = x.size
    normal, slope = np.zeros((n, n)), np.zeros(n)
    unused_normal, unused_slope = np.zeros((1, 1)), np.zeros(1)
    weights = np.empty(light.shape)
    over = np.where(clipped[:, :, 0], 0.0, trust / noise[4] ** 2)
    trial = x.copy()
    damping = 1e-3
    for _ in range(OUTER):
        _weigh(x, z, light, clipped, trust, noise, weights)
        cost = _cost(x, z, light, mean, precision, weights, over, noise[3], normal, slope, True)
        start = cost
        for _ in range(INNER):
            damped = normal.copy()
            for i in range(n):
                damped[i, i] *= 1 + damping
            move = _solve(damped, slope)
            for i in range(n):
                trial[i] = x[i] - min(max(move[i], -1.0), 1.0)
            new = _cost(trial, z, light, mean, precision, weights, over, noise[3], unused_normal, unused_slope, False)
            if new < cost:
                small = cost - new < 1e-3 * cost
                x[:], cost = trial, new
                damping = max(damping * 0.2, 1e-6)
                if small:
                    break
                _cost(x, z, light, mean, precision, weights, over, noise[3], normal, slope, True)
            else:
                damping = min(damping * 8, 1e6)
        if start - cost < 3e-4 * start:
            break
    _cost(x, z, light, mean, precision, weights, over, noise[3], normal, slope, True)
    return x, normal


@compiled
def _weigh(x, z, light, clipped, trust, noise, weights):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Into ``weights`` (3, G, P) the inverse variances of the quantiles under ``x``, less for outliers (Cauchy), times trust.

    Light at full scale may have been brighter: no model above it is wrong.
    """
    channels, groups, shares = light.shape
    for c in range(channels):
        far, near, beta, veil, white = np.exp(x[c]), np.exp(x[3 + c]), np.exp(x[6 + c]), np.exp(x[9 + c]), np.exp(x[12 + c])
        for g in range(groups):
            loss = z[g] * far * (1 + (near - 1) * np.exp(-RATE_OF_CHANGE * z[g]))
            backscatter = veil * white * (1 - np.exp(-beta * z[g]))
            for p in range(shares):
                direct = np.exp(min(x[12 + c] - loss + x[WATER + c * shares + p] + x[WATER + channels * shares + g], 20.0))
                model = direct + backscatter + noise[3]
                r = np.log(model / (light[c, g, p] + noise[3]))
                variance = (noise[0] * direct / model) ** 2 + noise[1] ** 2
                weights[c, g, p] = (
                    0.0 if clipped[c, g, p] and r > 0.0 else trust[g] / variance / (1 + r * r / (noise[2] ** 2 * variance))
                )


@compiled
def _cost(x, z, light, mean, precision, weights, over, floor, normal, slope, derivatives):  # type: ignore[no-untyped-def]  # noqa: C901  # pragma: no cover
    """Half the sum of squares; into ``normal`` and ``slope`` the Gauss-Newton matrix and the gradient.

    Besides the quantiles: nothing is darker than the veil before it, so a veil above the darkest quantile costs, by ``over``.
    """
    channels, groups, shares = light.shape
    n = x.size
    cost = 0.0
    if derivatives:
        normal[:] = precision
    for i in range(n):
        pull = 0.0
        for j in range(n):
            pull += precision[i, j] * (x[j] - mean[j])
        cost += 0.5 * pull * (x[i] - mean[i])
        if derivatives:
            slope[i] = pull
    at, d = np.zeros(7, np.int64), np.zeros(7)
    for c in range(channels):
        far, near, beta, veil, white = np.exp(x[c]), np.exp(x[3 + c]), np.exp(x[6 + c]), np.exp(x[9 + c]), np.exp(x[12 + c])
        for k in range(5):
            at[k] = 3 * k + c
        for g in range(groups):
            loss = z[g] * far * (1 + (near - 1) * np.exp(-RATE_OF_CHANGE * z[g]))
            fog = np.exp(-beta * z[g])
            backscatter = veil * white * (1 - fog)
            at[6] = WATER + channels * shares + g
            veil_over = np.log((backscatter + floor) / (light[c, g, 0] + floor))
            if veil_over > 0.0:
                d[2] = veil * white * fog * beta * z[g] / (backscatter + floor)
                d[3] = d[4] = backscatter / (backscatter + floor)
                cost += 0.5 * over[c, g] * veil_over * veil_over
                if derivatives:
                    for i in range(2, 5):
                        slope[at[i]] += over[c, g] * d[i] * veil_over
                        for j in range(2, i + 1):
                            normal[at[i], at[j]] += over[c, g] * d[i] * d[j]
            for p in range(shares):
                at[5] = WATER + c * shares + p
                direct = np.exp(min(x[12 + c] - loss + x[at[5]] + x[at[6]], 20.0))
                model = direct + backscatter + floor
                r = np.log(model / (light[c, g, p] + floor))
                weight = weights[c, g, p]
                cost += 0.5 * weight * r * r
                if not derivatives:
                    continue
                d[0] = -direct * loss / model
                d[1] = -direct * z[g] * far * near * np.exp(-RATE_OF_CHANGE * z[g]) / model
                d[2] = veil * white * fog * beta * z[g] / model
                d[3] = backscatter / model
                d[4] = (direct + backscatter) / model
                d[5] = direct / model
                d[6] = d[5]
                for i in range(7):
                    slope[at[i]] += weight * d[i] * r
                    for j in range(i + 1):  # at is ascending: the lower triangle
                        normal[at[i], at[j]] += weight * d[i] * d[j]
    if derivatives:
        for i in range(n):
            for j in range(i):
                normal[j, i] = normal[i, j]
    return cost


@compiled(fastmath=True)
def _solve(matrix, vector):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Solves a symmetric positive definite system by Cholesky's factors, in place."""
    n = vector.size
    out = vector.copy()
    for j in range(n):
        s = matrix[j, j]
        for k in range(j):
            s -= matrix[j, k] * matrix[j, k]
        root = np.sqrt(max(s, 1e-300))
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
