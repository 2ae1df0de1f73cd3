"""The color of the pattern of light, solved again after the water is removed from the observations.

If range depends on the position in the image (borders are farther than the middle), pattern and
trend with range explain the same differences between views. The trend is left to the water, but the
fitted water removes another trend, and backscatter: borders get another color than the middle. So
the water is fitted to the observations, and the color that it leaves is added to the pattern.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting import robust
from stereo_seecolor.color.photometry.color_trend import with_color_trend
from stereo_seecolor.color.photometry.crossing import alike
from stereo_seecolor.color.photometry.light_model import SHADING, Light, places, shading_terms
from stereo_seecolor.color.photometry.light_prior import COLOR, LightPrior
from stereo_seecolor.color.photometry.light_solver import (
    Equations,
    LightTerms,
    Window,
    solve,
    window_of,
)
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.color.photometry.survey_light import LIMITS, SurveyLight, numbered, usable
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water

Array = NDArray[np.float64]
LEFT = replace(COLOR, coefficient=0.02, ranged=0.005, trend=1e-5)
"""Prior of the remaining color of the pattern: a few percent, and no trend with range. With 0.05
two of eight synthetic dives improve less and one gets worse; with 0.2 none has a pattern.
"""
USES = (
    LightTerms(gains=True),
    LightTerms(pattern=True, gains=True),
    LightTerms(pattern=True, ranged=True, gains=True),
)
"""Gains are solved and not used: without them, a slope along the track follows the error of the
water between altitudes (synthetic dives: 10 % of pattern in color instead of 4).
"""
LINEAR = ColorConfig(input_encoding="linear")
FULL = 65535
"""Full scale of the light of observations in the moment table."""


def refit_color_after_water(
    survey_light: SurveyLight,
    windows: Sequence[Observations],
    names: Sequence[str],
    size: tuple[int, int],
) -> SurveyLight:
    """Solve the color of the pattern again after the water is removed; return the light.

    It is unchanged if color has no pattern, no change has more evidence, or no spot has light after
    the water is removed.
    windows, names, size: as given to ``solve_light``, which found the light.
    """
    if not survey_light.color.use.pattern:
        return survey_light
    light = survey_light.solved
    gains, shading = (
        np.array([of.get(name, np.zeros(each)) for name in names]).reshape(-1, each // 3, 3)
        for of, each in ((light.gains, 3), (light.shading, 3 * SHADING))
    )
    even = [_even(window, light, gains[:, 0], shading, size) for window in windows]
    water = with_color_trend(_water(even), light.color_trend)

    def left(window: Observations, seen: Observations) -> Window:
        """The window with the water removed, without observations to which it leaves no light."""
        direct = (seen.light - water.backscatter(seen.range_m)) / water.attenuation(seen.range_m)
        kept = usable(window) & (direct > LIMITS.light[0]).all(axis=1)
        lit = replace(seen, light=np.maximum(direct, LIMITS.light[0]))
        return window_of(lit, kept, light, size)

    made = [left(*both) for both in zip(windows, even, strict=True)]
    made = [window for window in made if len(window.patch)]
    if not made:
        return survey_light
    made, measured = numbered(made)
    prior = LightPrior.unknown(LEFT, alike(survey_light.crossed, len(windows)))
    equations = Equations.of([window.color for window in made], len(measured))
    solved = min((solve(equations, use, prior) for use in USES), key=lambda one: one.misfit)
    coefficients = light.coefficients + solved.coefficients
    return replace(survey_light, solved=replace(light, coefficients=coefficients))


def _even(
    seen: Observations, light: Light, gains: Array, shading: Array, size: tuple[int, int]
) -> Observations:
    """The observations with the light divided out."""
    frame, terms = seen.frames[seen.frame], shading_terms(places(seen.pixel, size))
    log_light = light.log_pattern(seen.pixel, seen.range_m, size) + gains[frame]
    own = np.einsum("ns,nsc->nc", terms, shading[frame])
    return replace(seen, light=seen.light * np.exp(-log_light - own))


def _water(windows: Sequence[Observations]) -> Water:
    """The water fitted to all observations, whose light was divided out."""
    light, range_m = (
        np.concatenate([getattr(seen, part) for seen in windows]) for part in ("light", "range_m")
    )
    counted = np.round(FULL * np.clip(light, 0.0, 1.0)).astype(np.uint16)
    return robust.fit(measure(counted[None], range_m[None].astype(np.float32)), LINEAR)
