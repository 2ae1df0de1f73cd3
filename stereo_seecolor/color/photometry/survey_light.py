"""The light of a survey from sightings: what the dive determines of it, and how much that helps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.color_trend import ColorTrend
from stereo_seecolor.color.photometry.crossing import SETTINGS, alike, pictures_crossed
from stereo_seecolor.color.photometry.light_choice import Candidate, Choice, choose
from stereo_seecolor.color.photometry.light_model import SHAPE, Light
from stereo_seecolor.color.photometry.light_prior import COLOR, LUMINANCE, LightPrior
from stereo_seecolor.color.photometry.light_solver import Use, Views, Window
from stereo_seecolor.color.photometry.sightings import SeenWindow, Sightings


@dataclass(frozen=True)
class SightingLimits:
    """Which sightings the light of a survey is measured from, and how well that is."""

    light: tuple[float, float] = (0.003, 0.97)
    """Linear light of each channel, fraction of full scale: below is noise and backscatter, above the camera may have clipped."""
    range_quantiles: tuple[float, float] = (0.01, 0.99)
    """Of the sightings' ranges: beyond these the pattern is not extrapolated."""
    loose: float = 0.1
    """Standard error of a pattern, logarithm, above which it is said what would tell more. Of 49 drawn dives it is larger in ten,
    in none of which frames of two lines were found to show the same."""


LIMITS = SightingLimits()
ANGLE = 0.8165
"""Radians of angle between two colors of a difference of 1 in the rms of their logarithms, near gray: sqrt(2/3)."""


_ByName = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class SurveyLight:
    """solved: the light of the survey; terms that do not help are 0. luminance, color: what was chosen of each, and how much it
    helps. offsets: rms of luminance between neighbors, without and with the gains of all frames; None where these were not solved.
    crossed: pictures of reef that the frames show one after another. recorded: the gains are about what the camera recorded.
    refused: as offsets, without and with what the camera recorded, where that was not used since it does not explain how frames
    differ; None where nothing was refused.
    """

    solved: Light
    luminance: Choice
    color: Choice
    crossed: float
    offsets: tuple[float, float] | None = None
    recorded: bool = False
    refused: tuple[float, float] | None = None

    @property
    def light(self) -> Light | None:
        """None where no term of it helps."""
        return self.solved if any(self.luminance.use) or any(self.color.use) or self.solved.gains or self.solved.shading else None

    @property
    def note(self) -> str:
        """What was used and how much it helps, for a person; "" where nothing was."""
        used = f"light: {'; '.join(self._used())}; more in water.json" if self.light else self._why_not()
        if self.refused is None:
            return used
        as_taken, about = map(_percent, self.refused)
        numbers = f"frames of one spot differ by {about} with them, {as_taken} without"
        refused = f"the exposures that the camera recorded are not used: {numbers}"
        return f"{used}; {refused}" if used else f"light: {refused}"

    def _why_not(self) -> str:
        """Where even light is not what was found: "" where it is."""
        few = f"only {self.luminance.judging} spots are seen by two frames and can judge a correction"
        return "" if self.luminance.judged else f"light: {few}: too few, nothing is corrected"

    def _used(self) -> list[str]:
        parts = []
        luminance, color = self.luminance, self.color
        if any(luminance.use):
            before, after = luminance.before, luminance.after
            parts.append(
                f"brightness corrected for {luminance.use}: views of one spot differ by {_percent(after.between_views)} "
                f"(before: {_percent(before.between_views)}), frames by {_percent(after.between_frames)} "
                f"(before: {_percent(before.between_frames)})"
            )
        if luminance.use.pattern:
            parts.append(f"the uneven light is known to {_percent(luminance.error)}{self._loose}")
        if any(color.use):
            before_deg, after_deg = (np.degrees(ANGLE * part.between_views) for part in (color.before, color.after))
            same = "the same" if color.use == luminance.use else str(color.use)
            parts.append(f"color corrected for {same}: views differ by {after_deg:.1f} degrees (before: {before_deg:.1f})")
        if luminance.use.pattern and self.crossed < SETTINGS.color:
            parts.append(
                f"color not corrected for it: the camera crossed {self.crossed:.1f} pictures of reef, {SETTINGS.color:.0f} needed"
            )
        if self.offsets and self.solved.gains and not luminance.use.gains:
            without, with_gains = (_percent(offset) for offset in self.offsets)
            parts.append(
                f"a gain for each of {len(self.solved.gains)} frames: neighbors differ by {with_gains} (before: {without})"
            )
        if self.recorded:
            parts.append("the exposures that the camera recorded are used")
        return parts

    @property
    def _loose(self) -> str:
        """What would tell more of a pattern that is not known well."""
        more = " only: lines that overlap or cross, and pictures of the turns between them, would tell more"
        return more if self.luminance.error > LIMITS.loose else ""

    def at(self, pixel: NDArray[np.float64], range_m: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float64]:
        """(N, 3) logarithm of the light, but for gains, at (N, 2) pixels of a picture of ``size`` and (N,) ranges: the pattern, and
        how light falls off with range, water and lamps together.
        """
        luminance, color = self.luminance.solution, self.color.solution
        seen = replace(self.solved, coefficients=luminance.coefficients + color.coefficients)
        return seen.log_pattern(pixel, range_m, size) + seen.log_range(range_m)[:, None] * (luminance.trend + color.trend)

    def of_frames(self, gains: _ByName, shading: _ByName, offsets: tuple[float, float]) -> "SurveyLight":
        """The same with other gains and shading of frames, by name."""
        return replace(self, solved=replace(self.solved, gains=gains, shading=shading), offsets=offsets)

    def content(self) -> dict[str, Any]:
        """As water.json holds it."""
        return {
            "luminance": _choice(self.luminance),
            "color": _choice(self.color),
            "pictures_crossed": self.crossed,
            **({"pattern_error": self.luminance.error} if self.luminance.use.pattern else {}),
            **({} if self.offsets is None else {"spread_between_neighbors": list(self.offsets)}),
            **({"recorded_exposures": True} if self.recorded else {}),
            **({} if self.light is None else self.light.content()),
        }


def solve_light(
    windows: Sequence[SeenWindow],
    names: Sequence[str],
    size: tuple[int, int],
    allowed: Use,
    recorded: NDArray[np.float64] | None = None,
) -> SurveyLight | None:
    """The light of a dive; None where nothing is seen from two frames.

    names: of all frames of the dive. size: (width, height) of the pictures that the sightings' pixels are of.
    allowed: the terms that may be used. recorded: (F,) logarithms of what the camera recorded of its exposure; they are taken off
    first, and the gains found are about them.
    """
    ranges = np.concatenate([window.seen.range_m for window in windows]) if windows else np.zeros(0)
    if not ranges.size:
        return None
    near_m, far_m = (float(value) for value in np.quantile(ranges, LIMITS.range_quantiles))
    views = Views(size, float(np.median(ranges)), (near_m, far_m))
    made = [views.window(window.seen, window.frames, usable(window.seen)) for window in windows]
    made = [_exposed_alike(window, recorded) for window in made if len(window.patch)]
    if not made:
        return None
    crossed = pictures_crossed(windows, size)
    one = alike(crossed)
    made, measured = numbered(made)
    of_luminance = LightPrior.lens(one), LightPrior.lamps(views.reference_m, one)
    candidates = _candidates(allowed, LightPrior.unknown(LUMINANCE, one), of_luminance, [Use(pattern=True, ranged=allowed.ranged)])
    luminance = choose(made, [_mean(window) for window in made], candidates, len(measured))
    colors = [window.log_light - _mean(window) for window in made]
    unknown, pattern = LightPrior.unknown(COLOR, one), allowed.pattern and crossed >= SETTINGS.color
    of_color = allowed._replace(pattern=pattern, shading=luminance.use.shading)  # what shades dims, whatever its color
    candidates = _candidates(of_color, unknown, [unknown], [Use(pattern=True), Use(pattern=True, ranged=True)])
    color = choose(made, colors, candidates, len(measured))
    light = _light(luminance, color, made, [names[frame] for frame in measured], views)
    return SurveyLight(light, luminance, color, crossed, recorded=recorded is not None)


def _light(luminance: Choice, color: Choice, windows: Sequence[Window], names: Sequence[str], views: Views) -> Light:
    """Both together. names: of the frames that the windows hold."""
    coefficients, gains, shading = (
        getattr(luminance.solution, part) + getattr(color.solution, part) for part in ("coefficients", "gains", "shading")
    )
    fade = -float(luminance.solution.trend[0, 0]) / SHAPE.range_step if luminance.use.pattern else 0.0
    trend = _color_trend(color, windows, views.reference_m)
    of_frames = _by_name(gains, names), fade, trend, _by_name(shading, names)
    return Light(coefficients, views.reference_m, views.seen_m, *of_frames)


def _by_name(numbers: NDArray[np.float64], names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Those of each of (F, ...) frames; of none where all are 0."""
    return {name: own.ravel() for name, own in zip(names, numbers, strict=True)} if numbers.any() else {}


def _color_trend(color: Choice, windows: Sequence[Window], reference_m: float) -> ColorTrend | None:
    """None where too few spots judge, or where color has gains but no pattern, which then is partly taken for the trend."""
    if not color.judged or (color.use.gains and not color.use.pattern):
        return None
    light = np.exp(np.concatenate([window.log_light for window in windows]).mean(axis=0))
    power, error = color.solution.trend[0] / SHAPE.range_step, color.solution.trend_error / SHAPE.range_step
    return ColorTrend(power - power.mean(), error, reference_m, light)


def _candidates(allowed: Use, unknown: LightPrior, priors: Sequence[LightPrior], patterns: Sequence[Use]) -> list[Candidate]:
    """Nothing, gains alone, and each pattern with each of its priors, without gains and with them, as far as allowed."""
    own = [(False, False), (True, False), (True, True)]
    of_patterns = [
        Candidate(use._replace(gains=gains, shading=shading), prior)
        for use in patterns
        for prior in priors
        for gains, shading in own
    ]
    alone = [Candidate(Use(gains=gains, shading=shading), unknown) for gains, shading in own]
    every = [*alone, *of_patterns]
    return [one for one in every if all(may or not used for used, may in zip(one.use, allowed, strict=True))]


def _exposed_alike(window: Window, recorded: NDArray[np.float64] | None) -> Window:
    """The sightings as one exposure had shown them."""
    return window if recorded is None else replace(window, log_light=window.log_light - recorded[window.frame][:, None])


def numbered(windows: Sequence[Window]) -> tuple[list[Window], NDArray[np.int64]]:
    """The windows with only the frames that they hold numbered, and which of the dive's frames these are."""
    measured, numbers = np.unique(np.concatenate([window.frame for window in windows]), return_inverse=True)
    parts = np.split(numbers, np.cumsum([len(window.frame) for window in windows[:-1]]))
    return [replace(window, frame=frame) for window, frame in zip(windows, parts, strict=True)], measured


def usable(seen: Sightings) -> NDArray[np.bool_]:
    """(N,) which sightings are neither dark nor near clipping."""
    darkest, brightest = LIMITS.light
    return np.asarray(((seen.light > darkest) & (seen.light < brightest)).all(axis=1))


def _mean(window: Window) -> NDArray[np.float64]:
    """(N, 1) luminance: the mean logarithm of the channels."""
    return np.asarray(window.log_light.mean(axis=1, keepdims=True))


def _percent(logarithm: float) -> str:
    return f"{100 * logarithm:.0f} %"


def _choice(choice: Choice) -> dict[str, Any]:
    return {
        "used": [name for name, used in zip(Use._fields, choice.use, strict=True) if used],
        "spread_between_views": [choice.before.between_views, choice.after.between_views],
        "spread_between_frames": [choice.before.between_frames, choice.after.between_frames],
    }
