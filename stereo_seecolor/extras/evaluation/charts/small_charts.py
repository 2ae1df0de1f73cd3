"""Finds whole color charts of few pixels by matched filters: their patches are too small to be
found one by one.

Water multiplies each channel of a flat chart and adds to it; normalized correlation does not depend
on either. A chart's template is searched for in each channel, over sizes and angles. The best
places are refined, and kept where the patches fit the chart's.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from heapq import nlargest
from itertools import product
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from stereo_seecolor.extras.evaluation.charts.chart_types import ChartType, FoundChart
from stereo_seecolor.extras.evaluation.charts.places import ChartPlace, chart_places
from stereo_seecolor.extras.evaluation.charts.sampling import correlations, sampled

Floats = NDArray[np.float32]
Affine = NDArray[np.float64]
"""(2, 3) or (K, 2, 3): from units of a chart to pixels."""
Agreement = Callable[[Affine], NDArray[np.float64]]
"""(K,) of outlines (K, 2, 3)."""


@dataclass(frozen=True)
class SearchLimits:
    """Outlines that are tried at a place, and limits for accepting a chart.

    Measured on four real charts 14 to 36 px wide, at 5 to 10 m; charts of 18 to 36 px drawn into
    real reefs; and reefs without one.
    """

    widths: tuple[float, ...] = (0.95, 1.15, 1.4, 1.7)
    """Factors of the width that was found in green: some columns of patches can look like all of
    them.
    """
    heights: tuple[float, ...] = (1.0, 0.85)
    """Factors of the chart's own height: charts stand tilted."""
    shifts: tuple[float, ...] = (-0.8, 0.0, 0.8)
    """Units along both sides, for the same reason."""
    tilts_deg: tuple[float, ...] = (-7.0, 0.0, 7.0)
    """Angles between those of the search."""
    starts: int = 5
    """Outlines of each place that agree best ..."""
    refined: int = 45
    """... and of those of all places, so many are refined ..."""
    least_start: float = 0.5
    """... if they agree so well: charts did by 0.57 and more, places of a reef by 0.53."""
    climb: int = 10
    """Steps of these, all together ..."""
    least_climbed: float = 0.75
    """... after which those are refined that agree so well in their two best channels: real charts
    have 0.77 to 0.86, synthetic ones 0.90 and more, the best of all places that are none 0.749.
    """
    least_of_three: float = 0.78
    """Correlation of patches with the published colors, mean of three channels, of what is a chart:
    the same have 0.81 to 0.90, 0.98 and more, and at most 0.76 ...
    """
    least_of_two: float = 0.88
    """... or of its two best channels, where the third is clipped or absorbed."""


LIMITS = SearchLimits()
_MOVES = np.vstack(
    [sign * np.diag([0.1, 0.1, 0.1, 0.1, 0.3, 0.3]) for sign in (-1, 1)]
    + [[[0, -sign, sign, 0, 0, 0], [sign, 0, 0, sign, 0, 0]] for sign in (-0.08, 0.08)]
)
"""Longest steps to better outlines: each side, each shear, along both sides; turned, and in
size.
"""
_BORDER = 0.1
"""Fraction of a patch at its sides with gap and blur."""


def small_charts(picture: Floats, types: Sequence[ChartType]) -> Iterator[FoundChart]:
    """Every chart of these types in (H, W, 3) encoded; several outlines of each."""
    places = list(chart_places(picture, types))
    for type in types:
        yield from _at(picture, type, [place for of, place in places if of is type])


def _at(picture: Floats, type: ChartType, places: Sequence[ChartPlace]) -> Iterator[FoundChart]:
    """The charts of a type at these places: the best outlines are refined and judged."""
    units = _sample_points(type)
    reference = sampled(type.template, type.template_pixels(units)[None])[0]

    def channels(outlines: Affine) -> NDArray[np.float64]:
        """(K, 3) of outlines (K, 2, 3)."""
        return correlations(sampled(picture, _mapped(outlines, units)), reference)

    def agreement(outlines: Affine) -> NDArray[np.float64]:
        return np.asarray(channels(outlines).mean(axis=1), np.float64)

    patches = _patch_points(type).reshape(-1, 2)
    colors = np.repeat(type.srgb, len(patches) // len(type.cells), axis=0)

    def inside(outlines: Affine) -> NDArray[np.float64]:
        """``agreement``, with the patches counted twice, since charts of a type differ in their
        gaps and frames.
        """
        of_patches = correlations(sampled(picture, _mapped(outlines, patches)), colors).mean(axis=1)
        return np.asarray(of_patches + agreement(outlines), np.float64)

    for outline in _climbed(type, _best_starts(type, places, agreement), agreement):
        if np.sort(channels(outline[None])[0])[1:].mean() > LIMITS.least_climbed:
            chart = _judged(picture, type, _refined(type, outline, inside))
            if chart:
                yield chart


def _best_starts(type: ChartType, places: Sequence[ChartPlace], agreement: Agreement) -> Affine:
    """(K, 2, 3): the outlines, a few at each place, that agree best."""
    found: list[tuple[float, Affine]] = []
    for place in places:
        starts = _starts(type, place)
        scores = agreement(starts)
        found += [
            (float(scores[i]), starts[i])
            for i in np.argsort(-scores)[: LIMITS.starts]
            if scores[i] > LIMITS.least_start
        ]
    best = [start for _, start in nlargest(LIMITS.refined, found, key=itemgetter(0))]
    return np.array(best).reshape(-1, 2, 3)


def _starts(type: ChartType, place: ChartPlace) -> Affine:
    """(K, 2, 3) initial outlines of a refinement, about the place that was found."""
    choices = product(LIMITS.tilts_deg, LIMITS.widths, LIMITS.heights, LIMITS.shifts, LIMITS.shifts)
    tilt_deg, width, height, x, y = np.array(list(choices)).T
    angle = np.radians(place.angle_deg + tilt_deg)
    scale = width * place.width_px / (type.size[0] + 2 * type.frame)
    cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
    A = np.stack(
        [np.stack([cosine, -sine * height], axis=-1), np.stack([sine, cosine * height], axis=-1)],
        axis=-2,
    )
    middle = np.array(type.size) / 2
    center = np.array([place.x_px, place.y_px]) + np.stack(
        [cosine * x - sine * y, sine * x + cosine * y], axis=-1
    )
    return np.concatenate([A, (center - A @ middle)[..., None]], axis=-1)


def _climbed(type: ChartType, outlines: Affine, agreement: Agreement) -> Iterator[Affine]:
    """Improve outlines (K, 2, 3) in steps, together; the best of each place, best first."""
    if not len(outlines):
        return
    scores, step = agreement(outlines), np.ones(len(outlines))
    each = np.arange(len(outlines))
    for _ in range(LIMITS.climb):
        tried = np.asarray(
            _moved(type, outlines[:, None], step[:, None, None] * _MOVES), np.float64
        )
        of_tried = agreement(tried.reshape(-1, 2, 3)).reshape(len(outlines), -1)
        best = of_tried.argmax(axis=1)
        better = of_tried[each, best] > scores
        outlines = np.where(better[:, None, None], tried[each, best], outlines)
        scores = np.where(better, of_tried[each, best], scores)
        step = np.where(better, step, step / 2)
    middles, widths = (
        _mapped(outlines, np.array([type.size]) / 2)[:, 0],
        np.hypot(*outlines[:, :, 0].T) * type.size[0],
    )
    left = np.argsort(-scores)
    while len(left):
        best = left[0]
        yield outlines[best]
        left = left[np.hypot(*(middles[left] - middles[best]).T) > 0.3 * widths[best]]


def _moved(type: ChartType, M: Affine, change: NDArray[np.float64]) -> Affine:
    """Outlines (..., 2, 3) stretched and sheared by change[..., :4] about their middles, and moved
    by change[..., 4:] units.
    """
    A, middle = M[..., :2], np.array(type.size) / 2
    stretched = A @ (np.eye(2) + change[..., :4].reshape(*change.shape[:-1], 2, 2))
    center = A @ (middle + change[..., 4:])[..., None] + M[..., 2:]
    return np.concatenate([stretched, center - stretched @ middle[:, None]], axis=-1)


def _refined(type: ChartType, start: Affine, agreement: Agreement) -> Affine:
    """The outline of best agreement near ``start``."""
    simplex = np.vstack([np.zeros(6), np.diag([-0.1, 0.1, 0.1, -0.1, 0.3, 0.3])])
    options: Any = {"initial_simplex": simplex, "maxfev": 300, "fatol": 1e-4}

    def disagreement(change: NDArray[np.float64]) -> float:
        return -float(agreement(_moved(type, start, change)[None])[0])

    best = minimize(disagreement, np.zeros(6), method="Nelder-Mead", options=options)
    return _moved(type, start, best.x)


def _judged(picture: Floats, type: ChartType, M: Affine) -> FoundChart | None:
    """The chart, if its patches correlate with its colors and its outline is plausible."""
    each = np.sort(correlations(_patch_means(picture, type, M)[None], type.srgb)[0])
    believed = each.mean() > LIMITS.least_of_three or each[1:].mean() > LIMITS.least_of_two
    if not believed or not _is_plausible(M):
        return None
    return FoundChart(
        type, _mapped(M, type.corners), float(each.mean()), np.ones(len(type.cells), bool)
    )


def _mapped(M: Affine, units: NDArray[np.floating]) -> NDArray[np.float64]:
    """(..., N, 2) pixels of points (N, 2) by outlines (..., 2, 3)."""
    homogeneous = np.vstack([units.T, np.ones(len(units))])
    return np.asarray(
        np.swapaxes((M.reshape(-1, 3) @ homogeneous).reshape(*M.shape[:-1], -1), -1, -2), np.float64
    )


def _sample_points(type: ChartType) -> NDArray[np.float64]:
    """Points all over the chart and its frame, units."""
    width, height = type.size
    x = np.linspace(-0.6 * type.frame, width + 0.6 * type.frame, 3 * round(width) + 2)
    y = np.linspace(-0.6 * type.frame, height + 0.6 * type.frame, 3 * round(height) + 2)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _patch_points(type: ChartType) -> NDArray[np.float64]:
    """(N, 25, 2): points all over each patch but its border, units."""
    inner = np.stack(np.meshgrid(*[np.linspace(_BORDER, 1 - _BORDER, 5)] * 2), axis=-1).reshape(
        -1, 2
    )
    return np.asarray(type.cells[:, None, :2] + inner * type.cells[:, None, 2:], np.float64)


def _patch_means(picture: Floats, type: ChartType, M: Affine) -> NDArray[np.float64]:
    """(N, 3): the middles of the patches."""
    units = _patch_points(type)
    middles = units.mean(axis=1, keepdims=True) + 0.5 * (units - units.mean(axis=1, keepdims=True))
    pixels = _mapped(M, middles.reshape(-1, 2)).reshape(middles.shape)
    return np.asarray(sampled(picture, pixels).mean(axis=1), np.float64)


def _is_plausible(M: Affine) -> bool:
    """Not mirrored, and tilted by less than about 60 degrees."""
    singular = np.linalg.svd(M[:, :2], compute_uv=False)
    return bool(np.linalg.det(M[:, :2]) > 0 and singular[1] > 0.5 * singular[0])
