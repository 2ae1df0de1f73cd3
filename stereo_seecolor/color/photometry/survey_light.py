"""The light of a survey from sightings: what the dive determines of it, and how much that helps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_choice import Choice, choose
from stereo_seecolor.color.photometry.light_model import SHAPE, Light
from stereo_seecolor.color.photometry.light_prior import COLOR, LUMINANCE, LightPrior
from stereo_seecolor.color.photometry.light_solver import Use, Views, Window
from stereo_seecolor.color.photometry.sightings import Sightings


@dataclass(frozen=True)
class SightingLimits:
    """Which sightings the light of a survey is measured from."""

    light: tuple[float, float] = (0.003, 0.97)
    """Linear light of each channel, fraction of full scale: below is noise and backscatter, above the camera may have clipped."""
    range_quantiles: tuple[float, float] = (0.01, 0.99)
    """Of the sightings' ranges: beyond these the pattern is not extrapolated."""


LIMITS = SightingLimits()
ANGLE = 0.8165
"""Radians of angle between two colors of a difference of 1 in the rms of their logarithms, near gray: sqrt(2/3)."""


@dataclass(frozen=True, eq=False)
class SeenWindow:
    """frames: numbers in the dive of the sightings' frames. seen: what they saw."""

    frames: NDArray[np.int64]
    seen: Sightings


@dataclass(frozen=True, eq=False)
class SurveyLight:
    """light: of the survey, None where no term of it helps. luminance, color: what was chosen of each, and how much it helps."""

    light: Light | None
    luminance: Choice
    color: Choice

    @property
    def note(self) -> str:
        """What was used and how much it helps, for a person; "" where nothing was."""
        if self.light is None:
            return ""
        parts = []
        if any(self.luminance.use):
            before, after = self.luminance.before, self.luminance.after
            parts.append(
                f"{self.luminance.use} taken out: one spot's brightness differs by {100 * after.between_views:.0f} % between views "
                f"(before {100 * before.between_views:.0f} %) and by {100 * after.between_frames:.0f} % between frames "
                f"(before {100 * before.between_frames:.0f} %)"
            )
        if any(self.color.use):
            before_deg, after_deg = (np.degrees(ANGLE * part.between_views) for part in (self.color.before, self.color.after))
            parts.append(f"in color: {self.color.use}: {after_deg:.1f} degrees between views (before {before_deg:.1f})")
        return f"light: {'; '.join(parts)}; on spots left out of the fit"

    def content(self) -> dict[str, Any]:
        """As water.json holds it."""
        return {
            "luminance": _choice(self.luminance),
            "color": _choice(self.color),
            **({} if self.light is None else self.light.content()),
        }


def solve_light(windows: Sequence[SeenWindow], names: Sequence[str], size: tuple[int, int], allowed: Use) -> SurveyLight | None:
    """The light of a dive; None where nothing is seen from two frames.

    names: of all frames of the dive. size: (width, height) of the pictures that the sightings' pixels are of.
    allowed: the terms that may be used.
    """
    ranges = np.concatenate([window.seen.range_m for window in windows]) if windows else np.zeros(0)
    if not ranges.size:
        return None
    near_m, far_m = (float(value) for value in np.quantile(ranges, LIMITS.range_quantiles))
    views = Views(size, float(np.median(ranges)), (near_m, far_m))
    made = [views.window(window.seen, window.frames, _usable(window.seen)) for window in windows]
    made = [window for window in made if len(window.patch)]
    if not made:
        return None
    priors = LightPrior.unknown(LUMINANCE), LightPrior.lamps(views.reference_m)
    luminance = choose(made, [_mean(window) for window in made], allowed, len(names), priors)
    colors = [window.log_light - _mean(window) for window in made]
    color = choose(made, colors, allowed, len(names), (LightPrior.unknown(COLOR),))
    if not any(luminance.use) and not any(color.use):
        return SurveyLight(None, luminance, color)
    gains = luminance.solution.gains + color.solution.gains
    measured = np.unique(np.concatenate([window.frame for window in made])) if gains.any() else np.zeros(0, int)
    coefficients = luminance.solution.coefficients + color.solution.coefficients
    fade = -float(luminance.solution.trend[0, 0]) / SHAPE.range_step if luminance.use.pattern else 0.0
    by_name = {names[frame]: gains[frame] for frame in measured}
    return SurveyLight(Light(coefficients, views.reference_m, views.seen_m, by_name, fade), luminance, color)


def _usable(seen: Sightings) -> NDArray[np.bool_]:
    darkest, brightest = LIMITS.light
    return np.asarray(((seen.light > darkest) & (seen.light < brightest)).all(axis=1))


def _mean(window: Window) -> NDArray[np.float64]:
    """(N, 1) luminance: the mean logarithm of the channels."""
    return np.asarray(window.log_light.mean(axis=1, keepdims=True))


def _choice(choice: Choice) -> dict[str, Any]:
    return {
        "used": [name for name, used in zip(Use._fields, choice.use, strict=True) if used],
        "spread_between_views": [choice.before.between_views, choice.after.between_views],
        "spread_between_frames": [choice.before.between_frames, choice.after.between_frames],
    }
