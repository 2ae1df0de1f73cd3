"""The light of a survey: the terms that the dive determines, and their effect."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.color_trend import ColorTrend
from stereo_seecolor.color.photometry.crossing import CROSSING_SETTINGS, alike, pictures_crossed
from stereo_seecolor.color.photometry.light_choice import Candidate, Choice, choose
from stereo_seecolor.color.photometry.light_model import SHAPE, TERMS, ByFrame, Light
from stereo_seecolor.color.photometry.light_prior import COLOR, LUMINANCE, Alike, LightPrior
from stereo_seecolor.color.photometry.light_solver import LightTerms, Window, window_of
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.color.photometry.single_illumination import is_single_illumination
from stereo_seecolor.compute.names import Names


@dataclass(frozen=True)
class ObservationLimits:
    """Limits of the observations for the light, and of its standard error."""

    light: tuple[float, float] = (0.003, 0.97)
    """Linear light of each channel: darker is noise and backscatter, brighter may be clipped."""
    range_quantiles: tuple[float, float] = (0.01, 0.99)
    """Quantiles of the ranges of observations; the pattern is not extrapolated beyond them."""
    loose: float = 0.1
    """Standard error of a pattern, logarithm, above which a note explains how to lower it."""


LIMITS = ObservationLimits()
COMPARED = "stereo-seecolor evaluate OUT --spread"
"""The note names this command, because spots left out of the fit alone give other numbers."""
LOOSE = ": lines that overlap or cross, and images of the turns between them, would reduce it"
PARTS_DIFFER = (
    "lines that share no spot were lit differently (lamps switched on between them?): "
    "the lamps' light is not corrected"
)


@dataclass(frozen=True, eq=False)
class SurveyLight:
    """The solved light of a survey.

    solved: the light; terms that do not help are 0. luminance, color: the choice of terms for each.
    crossed: motion of the reef through the images, in image sizes. offsets: rms of luminance
    between neighbors, without and with the gains of all frames; None = not solved. recorded: the
    gains have recorded exposures as their prior. refused: like offsets, of recorded exposures that
    do not explain differences between frames; else None. reading: how these would explain them, if
    read otherwise. parts_differ: lines that share no spot have different light, so that only the
    lens is corrected.
    """

    solved: Light
    luminance: Choice
    color: Choice
    crossed: float
    offsets: tuple[float, float] | None = None
    recorded: bool = False
    refused: tuple[float, float] | None = None
    reading: str = ""
    parts_differ: bool = False

    @property
    def light(self) -> Light | None:
        """The light; None if no term helps."""
        used = (*self.luminance.use, *self.color.use, self.solved.gains, self.solved.shading)
        return self.solved if any(used) else None

    @property
    def note(self) -> str:
        """A line on the terms in use and their effect; "" for none."""
        parts = "; ".join(self._used())
        used = f"light: {parts}; more in water.json" if self.light else self._why_not()
        if self.refused is None:
            return used
        as_taken, about = map(_percent, self.refused)
        numbers = f"frames of one spot differ by {about} with them, {as_taken} without"
        refused = f"the exposures that the camera recorded are not used: {numbers}"
        refused += f"; {self.reading}" if self.reading else ""
        return f"{used}; {refused}" if used else f"light: {refused}"

    def _why_not(self) -> str:
        """The note where no term is used: too few spots; "" where the light is even."""
        if self.parts_differ:
            return f"light: {PARTS_DIFFER}"
        few = f"only {self.luminance.judging} spots are seen by two frames and can judge"
        why = f"light: {few} a correction: too few, nothing is corrected"
        return "" if self.luminance.judged else why

    def _used(self) -> list[str]:
        parts = [PARTS_DIFFER] if self.parts_differ else []
        luminance, color = self.luminance, self.color
        if any(luminance.use):
            parts.append(f"brightness corrected for {luminance.use}")
        if luminance.use.pattern:
            error = f"standard error of the uneven light {_percent(luminance.error)}"
            parts.append(error + (LOOSE if luminance.error > LIMITS.loose else ""))
        if any(color.use):
            same = "the same" if color.use == luminance.use else str(color.use)
            parts.append(f"color corrected for {same}")
        if luminance.use.pattern and self.crossed < CROSSING_SETTINGS.color:
            parts.append(
                f"color not corrected for it: the reef moved by {self.crossed:.1f} image sizes, "
                f"{CROSSING_SETTINGS.color:.0f} needed"
            )
        if self.offsets and self.solved.gains and not luminance.use.gains:
            parts.append(f"a gain for each of {len(self.solved.gains)} frames")
        if self.recorded:
            parts.append("the exposures that the camera recorded are used")
        if self.light:
            parts.append(f"by how much views of one spot differ before and after: {COMPARED}")
        return parts

    def at(
        self, pixel: NDArray[np.float64], range_m: NDArray[np.float64], size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """(N, 3) logarithm of the light without gains: pattern and trend. pixel: (N, 2) x, y in an
        image of ``size`` (width, height). range_m: (N,) meters.
        """
        luminance, color = self.luminance.solution, self.color.solution
        seen = replace(self.solved, coefficients=luminance.coefficients + color.coefficients)
        return seen.log_pattern(pixel, range_m, size) + seen.log_range(range_m)[:, None] * (
            luminance.trend + color.trend
        )

    def of_frames(
        self,
        gains: ByFrame,
        shading: ByFrame,
        slopes: NDArray[np.float64],
        offsets: tuple[float, float],
    ) -> "SurveyLight":
        """The light with these gains and shading, and (2, 3) slopes added to the pattern."""
        coefficients = self.solved.coefficients + np.pad(slopes, ((0, TERMS - 2), (0, 0)))
        solved = replace(self.solved, coefficients=coefficients, gains=gains, shading=shading)
        return replace(self, solved=solved, offsets=offsets)

    def content(self) -> dict[str, Any]:
        """Convert to the form in water.json."""
        return {
            "luminance": _choice(self.luminance),
            "color": _choice(self.color),
            "pictures_crossed": self.crossed,
            **({"pattern_error": self.luminance.error} if self.luminance.use.pattern else {}),
            **({} if self.offsets is None else {"spread_between_neighbors": list(self.offsets)}),
            **({"recorded_exposures": True} if self.recorded else {}),
            **({"parts_lit_differently": True} if self.parts_differ else {}),
            **({} if self.light is None else self.light.content()),
        }


def solve_light(
    windows: Sequence[Observations],
    names: Sequence[str],
    size: tuple[int, int],
    allowed: LightTerms,
    recorded: NDArray[np.float64] | None = None,
    is_sampled: bool = False,
) -> SurveyLight | None:
    """Solve the light of a dive.

    Args:
        windows: Observations of patches in windows of neighboring frames.
        names: Names of all frames of the dive.
        size: (width, height) of the images of the observations.
        allowed: The terms that may be used.
        recorded: (F,) logarithms of the exposures that the camera recorded: the prior mean of the
            gains.
        is_sampled: True if the windows are of a part of the frames.

    Returns:
        The light; None if no two frames show the same spot.
    """
    ranges = np.concatenate([window.range_m for window in windows]) if windows else np.zeros(0)
    if not ranges.size:
        return None
    near_m, far_m = (float(value) for value in np.quantile(ranges, LIMITS.range_quantiles))
    even = Light(np.zeros((TERMS, 3)), float(np.median(ranges)), (near_m, far_m))
    exposures = np.zeros(len(names)) if recorded is None else recorded
    made = [window_of(one, usable(one), even, size) for one in windows]
    made = [
        replace(window, values=window.values - exposures[window.frame][:, None])
        for window in made
        if len(window.patch)
    ]
    if not made:
        return None
    crossed = pictures_crossed(windows, size)
    same = alike(crossed, len(made))
    made, measured = numbered(made)
    pattern = LightTerms(pattern=True, ranged=allowed.ranged)
    unknown, lens = LightPrior.unknown(LUMINANCE, same), (pattern, LightPrior.lens(same))
    lamps = pattern, LightPrior.lamps(even.reference_m, same)
    candidates = _candidates(allowed, unknown, [lens, lamps])
    luminances = [window.luminance for window in made]
    differ = not is_sampled and not is_single_illumination(luminances, candidates, len(measured))
    if differ:
        candidates = _candidates(allowed, unknown, [lens])
    luminance = choose(luminances, candidates, len(measured))
    terms = allowed._replace(
        pattern=allowed.pattern and not differ,
        shading=luminance.use.shading,  # a shadow that changes color also changes brightness
    )
    color = _choose_color(made, terms, same, len(measured), crossed)
    of_luminance, of_color = luminance.solution, color.solution
    gains = of_luminance.gains + of_color.gains + exposures[measured, None]
    seen = Names(names[frame] for frame in measured)
    is_faded = luminance.use.pattern and not differ
    light = replace(
        even,
        coefficients=of_luminance.coefficients + of_color.coefficients,
        gains=_by_frame(gains, seen),
        fade=-float(of_luminance.trend[0, 0]) / SHAPE.range_step if is_faded else 0.0,
        color_trend=_color_trend(color, made, even.reference_m),
        shading=_by_frame(of_luminance.shading + of_color.shading, seen),
    )
    return SurveyLight(
        light, luminance, color, crossed, recorded=recorded is not None, parts_differ=differ
    )


def _choose_color(
    windows: Sequence[Window], allowed: LightTerms, same: Alike, frames: int, crossed: float
) -> Choice:
    """Choose the terms of color. A dive that is too short to correct a pattern still compares it
    with gains: along a track, the slope of a pattern looks like a drift of gains.
    """
    unknown = LightPrior.unknown(COLOR, same)
    patterns = [(LightTerms(pattern=True, ranged=ranged), unknown) for ranged in (False, True)]
    candidates = _candidates(allowed, unknown, patterns)
    colors = [window.color for window in windows]
    chosen = choose(colors, candidates, frames)
    if crossed >= CROSSING_SETTINGS.color or not chosen.use.pattern:
        return chosen
    return chosen.without_pattern(colors)


def _by_frame(numbers: NDArray[np.float64], names: Names) -> ByFrame:
    """The (F, ...) numbers of frames by name; empty where all are 0."""
    return ByFrame(names, numbers.reshape(len(names), -1)) if numbers.any() else ByFrame()


def _color_trend(color: Choice, windows: Sequence[Window], reference_m: float) -> ColorTrend | None:
    """The change of color with range; None where too few spots judge it, or gains without a pattern
    would be taken for it.
    """
    if not color.judged or (color.use.gains and not color.use.pattern):
        return None
    light = np.exp(np.concatenate([window.values for window in windows]).mean(axis=0))
    power = color.solution.trend[0] / SHAPE.range_step
    error = color.solution.trend_error / SHAPE.range_step
    return ColorTrend(power - power.mean(), error, reference_m, light)


def _candidates(
    allowed: LightTerms, unknown: LightPrior, patterns: Sequence[tuple[LightTerms, LightPrior]]
) -> list[Candidate]:
    """No correction, gains alone, each pattern, as allowed. unknown: prior without a pattern."""
    every = [
        Candidate(use._replace(gains=gains, shading=shading), prior)
        for use, prior in [(LightTerms(), unknown), *patterns]
        for gains, shading in ((False, False), (True, False), (True, True))
    ]
    return [
        one
        for one in every
        if all(may or not used for used, may in zip(one.use, allowed, strict=True))
    ]


def numbered(windows: Sequence[Window]) -> tuple[list[Window], NDArray[np.int64]]:
    """The windows with frames numbered from 0, and the numbers of these frames in the dive."""
    measured = np.unique(np.concatenate([window.frame for window in windows]))
    return [
        replace(window, frame=np.searchsorted(measured, window.frame)) for window in windows
    ], measured


def usable(seen: Observations) -> NDArray[np.bool_]:
    """Select (N,) observations that are neither dark nor near clipping."""
    darkest, brightest = LIMITS.light
    return np.asarray(((seen.light > darkest) & (seen.light < brightest)).all(axis=1))


def _percent(logarithm: float) -> str:
    return f"{100 * logarithm:.0f} %"


def _choice(choice: Choice) -> dict[str, Any]:
    return {
        "used": [name for name, used in zip(LightTerms._fields, choice.use, strict=True) if used],
        "spread_between_views": [choice.before.between_views, choice.after.between_views],
        "spread_between_frames": [choice.before.between_frames, choice.after.between_frames],
    }
