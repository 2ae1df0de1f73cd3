"""The default fit: the water for which the scene has the same colors at every range.

    quantile_p of channel c at range z = B_c(z) + white_c A_c(z) exp(reflectance_cp + brightness_z),
    B_c(z) = gamma_inf_c (1 - exp(-beta_c z)), A_c(z) = exp(-z (far_c + (near_c - far_c) exp(-z / 4
        m)))

Content and light may change with range (brightness_z), equally in all channels. The prior of
reflectances is that of natural scenes (``scene_colors``): a little warm, brighter ones closer to
gray. The prior of the water is ``water_prior``. This is one regularized least-squares problem over
some 20 ranges, solved by Gauss-Newton steps; the inverse of its curvature is the covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.robust_solver import NOISE, FitProblem, minimize
from stereo_seecolor.color.fitting.scene_colors import sea_floor
from stereo_seecolor.color.fitting.scene_prior import deviations, whole_prior
from stereo_seecolor.color.fitting.water_prior import RATE_OF_CHANGE, WATER
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_quantiles import RangeQuantiles, quantiles_by_range
from stereo_seecolor.config import ColorConfig, RobustConfig
from stereo_seecolor.records import Water
from stereo_seecolor.water.limits import LITTLE_RELIEF, SHARE
from stereo_seecolor.water.physics import backscatter, optical_depth

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class RobustSettings:
    """Weights of quantiles, and limits of warnings."""

    few_pixels: float = 200.0
    """Quantiles of so many pixels have half the weight: neighbors often show one object."""
    alike: float = 4.0
    """Variance of the mean color of a range's quantiles, relative to independent ones, because they
    show the same things: 4.1 in photographs with measured ranges, 3.3 on a synthetic reef.
    """
    nothing_learned: float = 0.9
    """With a standard error of this fraction of the prior's, the image adds no information."""
    little_relief: float = 1.2
    """Ratio of farthest to nearest range; below it, the prior dominates the attenuation."""
    least_direct: float = 0.05
    """Least direct signal at the start, fraction of the light: its logarithm must be finite."""
    least_light: float = 1e-6
    """Least scale of light, fraction of full scale: a tenth of a 16-bit value, for black images."""
    red_highlights: float = 0.55
    """Excess of red of the brightest hundredth over the middle half, relative to natural scenes,
    that causes a warning: logarithm of R/B. FLSea and 3374 have -0.2 to 0.15, frames with lamp-lit
    particles or little light mostly 0.5 to 1.3.
    """
    shared: float = 0.05
    """Standard deviation of the logarithms of a water that frames share: not visible in a color."""
    exposure: float = 2.0
    """Standard deviation of the logarithm of a frame's exposure: it says nothing of the water."""


SETTINGS = RobustSettings()
COLOR_AXES = np.array([[3**0.5, 0.0, -(3**0.5)], [1.0, -2.0, 1.0]]).T / 6**0.5
"""(3, 2) orthonormal axes of colors: warm-cool and green-magenta, perpendicular to brightness."""
LEAST_PRECISION = 1e-6
"""Least precision of a logarithm along an axis: an image without information about it."""
NAMES = ("y", "w", "beta", "gamma_inf", "white")
"""The water's parameters, in the order of their logarithms."""
ENOUGH = 0.1
"""A fit of costs ends with a step that lowers the cost by less: their limits are 25 and more."""
MIDDLE, HIGHLIGHTS = slice(3, 6), slice(7, 9)
"""The middle half and the brightest hundredth, among the nine quantiles."""
RED_HIGHLIGHTS = (
    "the brightest points are redder than the scene (particles in lamp light, strong JPEG "
    "compression, little light): "
    "colors may come out too green; set color.robust.white_point or use a chart"
)


def fit(table: MomentTable, config: ColorConfig, start: Water | None = None) -> Water:
    """Fit the water, with standard errors, to a moment table; warn if it hardly determines it.

    The brightness of the white point is such that the brightest thousandth of a scene is near full
    scale at exposure 1.

    Args:
        table: The moment table, with at least one pixel.
        config: Settings of the color stage.
        start: Initial water parameters; they change the duration of the fit, not its result.

    Returns:
        The water, with standard errors (NaN where the image adds no information).
    """
    return fit_all([quantiles_by_range(table, config.encoding)], config, [start])[0][0]


def fit_all(
    several: Sequence[RangeQuantiles],
    config: ColorConfig,
    starts: Sequence[Water | None] = (),
    enough: float = 0.0,
) -> tuple[list[Water], NDArray[np.float64]]:
    """Fit several tables at once, as ``fit`` and ``quality`` do. enough: as in ``minimize``."""
    begun = zip(several, starts or [None] * len(several), strict=True)
    problems, x = zip(*(_begin(seen, config.robust, start) for seen, start in begun), strict=True)
    found, curvature, costs = minimize(problems, x, enough)
    waters = [_water(*one, config) for one in zip(several, problems, found, curvature, strict=True)]
    return waters, costs


def _begin(
    seen: RangeQuantiles,
    settings: RobustConfig,
    start: Water | None = None,
    shared: Water | None = None,
) -> tuple[FitProblem, Vector]:
    """What is minimized, and from where. shared: the water of other frames, at any exposure."""
    scale = scale_of(seen)
    light = seen.light / scale
    mean, precision, _ = (part.copy() for part in whole_prior(len(seen.range_m), settings))
    trust = seen.pixels / (seen.pixels + SETTINGS.few_pixels) * (not seen.clipped.all())
    brightest = np.log(light[:, :, -2].mean(axis=1) + NOISE.floor)
    if shared is None:
        trust /= SETTINGS.alike
        x = mean.copy()
        x[12:WATER] = brightest
        if start is not None and (start.v == RATE_OF_CHANGE).all():
            x[:WATER] = parameters(start, scale)
    else:
        mean[:WATER] = parameters(shared, scale)
        covariance = np.eye(WATER) * SETTINGS.shared**2
        covariance[12:, 12:] += SETTINGS.exposure**2
        precision[:WATER, :WATER] = np.linalg.inv(covariance)
        x = mean.copy()
        x[12:WATER] += (brightest - x[12:WATER]).mean()
    begin_content(x, seen.range_m, light)
    return FitProblem(seen.range_m, light, seen.clipped, trust, mean, precision), x


def scale_of(seen: RangeQuantiles) -> float:
    """Return the brightest light, fraction of full scale, which is the unit of light in the fit."""
    return max(float(seen.light[..., -2].max()), SETTINGS.least_light)


def _water(
    seen: RangeQuantiles,
    problem: FitProblem,
    x: Vector,
    curvature: NDArray[np.float64],
    config: ColorConfig,
) -> Water:
    """The water of the parameters at the minimum, with standard errors and warnings."""
    scale = scale_of(seen)
    prior_covariance = whole_prior(len(seen.range_m), config.robust)[2]
    covariance: NDArray[np.float64] = np.asarray(
        np.linalg.solve(curvature, np.eye(len(x), WATER))[:WATER], np.float64
    )
    learned = deviations(covariance) < SETTINGS.nothing_learned * deviations(prior_covariance)
    values = _values(x[:WATER].reshape(5, 3), scale)
    errors = standard_errors(values, covariance)
    if config.robust.fits_white:
        errors[4] = values[4] * error_with_cast(covariance[12:, 12:], prior_covariance[12:, 12:])
    errors = np.where(learned, errors, np.nan)
    y, w, beta, gamma_inf, white = values
    return Water(
        gamma_inf=gamma_inf,
        beta=beta,
        eta=np.zeros(3),
        alpha=np.ones(3),
        w=w,
        v=np.full(3, RATE_OF_CHANGE),
        y=y,
        x=np.zeros(3),
        white=white,
        standard_errors=dict(zip(NAMES, errors, strict=True)),
        input_encoding=config.encoding,
        warnings=(
            *_warnings(seen, config.lock == "survey"),
            *_highlight_warnings(x - problem.mean, seen.light.shape[-1]),
        ),
    )


def _values(logarithms: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """(5, 3) y, w, beta, gamma_inf, white of the (5, 3) logarithms of ``standard_errors``."""
    far, _, beta, backscatter, white = np.exp(logarithms)
    return np.stack(
        [far, far * np.expm1(logarithms[1]), beta, backscatter * white * scale, white * scale]
    )


def standard_errors(
    values: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(5, 3) marginal standard errors of (5, 3) y, w, beta, gamma_inf, white, to first order.

    Those of white are of its color only, because its brightness is exposure. covariance: (15, 15)
    of log far, log(near / far), log beta, log(gamma_inf / white), log white, each R, G, B. The
    errors of w = far (near / far - 1) and gamma_inf = (gamma_inf / white) white include the
    covariance of both factors.
    """
    y, w, beta, gamma_inf, white = values
    by_logarithm = np.zeros((4, 5, 3))
    by_logarithm[0, 0] = y
    by_logarithm[1, :2] = (w, w + y)
    by_logarithm[2, 2] = beta
    by_logarithm[3, 3:] = gamma_inf
    together = covariance.reshape(5, 3, 5, 3).diagonal(axis1=1, axis2=3)
    variances = np.einsum("kic,ijc,kjc->kc", by_logarithm, together, by_logarithm)
    return np.vstack([np.sqrt(np.maximum(variances, 0.0)), deviations(covariance)[4] * white])


def error_with_cast(
    covariance: NDArray[np.float64], prior: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute (3,) standard errors of the logarithm of the white point less its mean, for scenes
    with a color cast.

    All quantiles of a scene share its cast, which their mean does not remove. So their estimate of
    the white point is not more exact than the cast of scenes of the sea floor.

    Args:
        covariance: (3, 3) of the logarithms without a cast.
        prior: Before any image.
    """
    known, before, cast = (
        COLOR_AXES.T @ each @ COLOR_AXES for each in (covariance, prior, sea_floor().cast)
    )
    # what the images alone say; rounding may leave nothing of it
    size, axes = np.linalg.eigh(np.linalg.inv(known) - np.linalg.inv(before))
    by_images = axes @ np.diag(1 / np.maximum(size, LEAST_PRECISION)) @ axes.T + cast
    together = np.linalg.inv(np.linalg.inv(before) + np.linalg.inv(by_images))
    return np.asarray(np.sqrt(np.diag(COLOR_AXES @ together @ COLOR_AXES.T)))


def _warnings(seen: RangeQuantiles, shared: bool) -> tuple[str, ...]:
    """Warnings where the water is determined by the prior more than by the image. shared: with all
    frames of the dive.
    """
    if seen.clipped.all():
        return (
            "every pixel is at full scale: the water is the prior's (Jerlov's types), not measured",
        )
    near_m, far_m = seen.range_m[0], seen.range_m[-1]
    if far_m > SETTINGS.little_relief * near_m:
        return ()
    return (
        f"{LITTLE_RELIEF}, {near_m:.2f} to {far_m:.2f} m: attenuation is dominated by the prior"
        f"{'' if shared else SHARE}",
    )


def _highlight_warnings(apart: Vector, quantiles: int) -> tuple[str, ...]:
    """A warning where highlights contradict the scene. apart: parameters less prior means."""
    content = apart[WATER : WATER + 3 * quantiles].reshape(3, quantiles)
    redder = content[:, HIGHLIGHTS].mean(axis=1) - content[:, MIDDLE].mean(axis=1)
    return (RED_HIGHLIGHTS,) if redder[0] - redder[2] > SETTINGS.red_highlights else ()


def begin_content(x: Vector, range_m: Vector, light: NDArray[np.float64]) -> None:
    """Set reflectances and brightnesses in ``x`` to means under the water in ``x``."""
    log_far, log_near, log_beta, log_backscatter, log_white = x[:WATER].reshape(5, 3, 1)
    veil = backscatter(range_m, np.exp(log_backscatter + log_white), np.exp(log_beta), 0.0, 0.0)
    far = np.exp(log_far)
    loss = optical_depth(range_m, far * np.expm1(log_near), RATE_OF_CHANGE, far, 0.0)
    direct = (
        np.log(np.maximum(light - veil[..., None], SETTINGS.least_direct * light) + NOISE.floor)
        + (loss - log_white)[..., None]
    )
    reflectance = x[WATER : WATER + direct[:, 0].size].reshape(3, 1, -1)
    brightness = (direct - reflectance).mean(axis=(0, 2))
    x[WATER + reflectance.size :] = brightness - brightness.mean()
    x[WATER : WATER + reflectance.size] = (
        (direct - x[WATER + reflectance.size :, None]).mean(axis=1).ravel()
    )


def parameters(water: Water, scale: float) -> Vector:
    """(15,) logarithms of water parameters, in the order of ``x``, light divided by ``scale``."""
    ratio, backscatter = water.w / water.y, water.gamma_inf / water.white
    far, *rest = map(np.log, (water.y, water.beta, backscatter, water.white / scale))
    return np.concatenate([far, np.log1p(ratio), *rest], dtype=np.float64)


def quality(
    seen: Sequence[RangeQuantiles], settings: RobustConfig, waters: Sequence[Water]
) -> NDArray[np.float64]:
    """Compute the least cost (N,) of the quantiles of each frame under its water, at any exposure:
    half the sum of squared errors in standard deviations. waters: with far attenuation (y) above 0.
    """
    begun = zip(seen, waters, strict=True)
    problems, x = zip(*(_begin(one, settings, shared=water) for one, water in begun), strict=True)
    return minimize(problems, x, ENOUGH)[2]
