"""Whole color charts of few pixels, by matched filters: their patches are too small to be seen one by one.

Water multiplies each channel of a flat chart and adds to it, and normalized correlation is blind to both: a chart's own picture is
looked for in each channel, over sizes and angles; the best places are refined, and kept where the patches have the right order.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from heapq import nlargest
from itertools import product
from operator import itemgetter
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from stereo_seecolor.evaluation.chart_types import ChartType, FoundChart
from stereo_seecolor.evaluation.sampling import correlations, sampled

Floats = NDArray[np.float32]
Affine = NDArray[np.float64]
"""(2, 3) or (K, 2, 3): from units of a chart to pixels."""


@dataclass(frozen=True)
class SearchLimits:
    """What is tried, and what is believed.

    On nine real pictures without a chart the best of all places had a correlation of 0.70 (mean of three channels); four charts 14
    to 36 px wide, at 5 to 10 m, in a real picture have 0.81 to 0.90.
    """

    least_px: float = 15.0
    """Width of the smallest chart: patches of 2.5 pixels."""
    most_px: float = 32.0
    """Widths that are searched: of larger charts the patches are seen one by one."""
    template_px: int = 24
    """Width of the chart in the picture that is searched."""
    size_step: float = 1.2
    """From one size to the next; between them the correlation falls by less than a tenth."""
    angles_deg: tuple[float, ...] = tuple(90.0 * turn + tilt for turn in range(4) for tilt in (-15, 0, 15))
    least_green: float = 0.4
    """Correlation in green alone below which no place is examined."""
    candidates: int = 30
    """Places of the green channel's best correlation that are examined in all channels, for each size and kind of chart."""
    widths: tuple[float, ...] = (0.95, 1.15, 1.4, 1.7)
    """Times the width that green found: some columns of patches can look like all of them."""
    heights: tuple[float, ...] = (1.0, 0.85)
    """Times the chart's own height: charts stand tilted."""
    shifts: tuple[float, ...] = (-0.8, 0.0, 0.8)
    """Units along both sides, for the same reason."""
    tilts_deg: tuple[float, ...] = (-7.0, 0.0, 7.0)
    """Between the angles of the search."""
    starts: int = 5
    """Of a place, so many of the outlines that agree best ..."""
    refined: int = 45
    """... and of those of all places, so many are refined."""
    least_of_three: float = 0.75
    """Correlation of patches with the published colors, mean of three channels, of what is a chart ..."""
    least_of_two: float = 0.88
    """... or of its two best channels, where the third is clipped or absorbed."""


LIMITS = SearchLimits()
_BORDER = 0.1
"""Of a patch, where gap and blur begin."""


def small_charts(picture: Floats, type: ChartType) -> Iterator[FoundChart]:
    """Every chart of a type in (H, W, 3) encoded, fractions of full scale; several outlines of each."""
    units = _sample_points(type)
    reference = sampled(type.template, type.template_pixels(units)[None])[0]

    def agreement(outlines: Affine) -> NDArray[np.float64]:
        """(K,) of outlines (K, 2, 3)."""
        return np.asarray(correlations(sampled(picture, _mapped(outlines, units)), reference).mean(axis=1), np.float64)

    patches = _patch_points(type).reshape(-1, 2)
    colors = np.repeat(type.srgb, len(patches) // len(type.cells), axis=0)

    def inside(outlines: Affine) -> NDArray[np.float64]:
        """As agreement, the patches counting twice: charts differ in their gaps and frames."""
        of_patches = correlations(sampled(picture, _mapped(outlines, patches)), colors).mean(axis=1)
        return np.asarray(of_patches + agreement(outlines), np.float64)

    found: list[tuple[float, Affine]] = []
    for place in _candidates(picture[..., 1], type):
        starts = _starts(type, place)
        scores = agreement(starts)
        found += [(float(scores[i]), starts[i]) for i in np.argsort(-scores)[: LIMITS.starts]]
    for _, start in nlargest(LIMITS.refined, found, key=itemgetter(0)):
        outline = _refined(type, start, agreement)
        if _judged(picture, type, outline):
            chart = _judged(picture, type, _refined(type, outline, inside))
            if chart:
                yield chart


@dataclass(frozen=True)
class _Place:
    score: float
    x_px: float
    y_px: float
    width_px: float
    angle_deg: float


def _candidates(green: Floats, type: ChartType) -> Iterator[_Place]:
    """The best places of each size, all angles together, none nearer to a better one of its size than a third of its width."""
    for size_px in _sizes(green, type):
        kept: list[_Place] = []
        for place in sorted(_of_size(green, type, size_px), key=lambda place: -place.score):
            if all(np.hypot(place.x_px - other.x_px, place.y_px - other.y_px) > 0.3 * size_px for other in kept):
                kept.append(place)
            if len(kept) == LIMITS.candidates:
                break
        yield from kept


def _sizes(green: Floats, type: ChartType) -> Iterator[float]:
    size_px = LIMITS.least_px
    while size_px < min(LIMITS.most_px, green.shape[1], green.shape[0] * type.size[0] / type.size[1]):
        yield size_px
        size_px *= LIMITS.size_step


def _of_size(green: Floats, type: ChartType, size_px: float) -> Iterator[_Place]:
    scale = LIMITS.template_px / size_px
    small = cv2.resize(green, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    for angle_deg in LIMITS.angles_deg:
        template = _turned(type, angle_deg)
        if any(t >= s for t, s in zip(template.shape, small.shape, strict=True)):
            continue
        scores = np.nan_to_num(cv2.matchTemplate(small, template, cv2.TM_CCOEFF_NORMED), posinf=0, neginf=0)
        peaks = (scores > LIMITS.least_green) & (scores <= 1) & (scores == cv2.dilate(scores, np.ones((7, 7), np.uint8)))
        for y, x in np.argwhere(peaks):
            middle = (np.array([x, y]) + (np.array(template.shape[::-1]) - 1) / 2 + 0.5) / scale - 0.5
            yield _Place(float(scores[y, x]), float(middle[0]), float(middle[1]), size_px, angle_deg)


def _turned(type: ChartType, angle_deg: float) -> Floats:
    """The green channel of the template, turned, its surroundings filled with its mean."""
    green = type.template[..., 1]
    height, width = green.shape
    scale = LIMITS.template_px / width
    angle = np.radians(angle_deg)
    A = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    size = np.ceil(np.abs(A) @ [width, height]).astype(int)
    M = np.column_stack([A, (size - 1) / 2 - A @ [(width - 1) / 2, (height - 1) / 2]])
    smoothed = cv2.GaussianBlur(green, (0, 0), 0.4 / scale)
    mean = float(green.mean())
    turned = cv2.warpAffine(smoothed, M, tuple(size.tolist()), borderMode=cv2.BORDER_CONSTANT, borderValue=mean)
    return np.asarray(turned, np.float32)


def _starts(type: ChartType, place: _Place) -> Affine:
    """(K, 2, 3): where a refinement may begin: turned, wider, less high, beside what green alone found."""
    choices = product(LIMITS.tilts_deg, LIMITS.widths, LIMITS.heights, LIMITS.shifts, LIMITS.shifts)
    tilt_deg, width, height, x, y = np.array(list(choices)).T
    angle = np.radians(place.angle_deg + tilt_deg)
    scale = width * place.width_px / (type.size[0] + 2 * type.frame)
    cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
    A = np.stack([np.stack([cosine, -sine * height], axis=-1), np.stack([sine, cosine * height], axis=-1)], axis=-2)
    middle = np.array(type.size) / 2
    center = np.array([place.x_px, place.y_px]) + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
    return np.concatenate([A, (center - A @ middle)[..., None]], axis=-1)


def _moved(type: ChartType, M: Affine, change: NDArray[np.float64]) -> Affine:
    """An outline stretched and sheared by change[:4] about its middle, and moved by change[4:] units."""
    A, middle = M[:, :2], np.array(type.size) / 2
    center = A @ (middle + change[4:]) + M[:, 2]
    stretched = A @ (np.eye(2) + change[:4].reshape(2, 2))
    return np.column_stack([stretched, center - stretched @ middle])


def _refined(type: ChartType, start: Affine, agreement: Callable[[Affine], NDArray[np.float64]]) -> Affine:
    """The outline of best agreement near ``start``."""
    simplex = np.vstack([np.zeros(6), np.diag([-0.1, 0.1, 0.1, -0.1, 0.3, 0.3])])
    options: Any = {"initial_simplex": simplex, "maxfev": 300, "fatol": 1e-4}

    def disagreement(change: NDArray[np.float64]) -> float:
        return -float(agreement(_moved(type, start, change)[None])[0])

    best = minimize(disagreement, np.zeros(6), method="Nelder-Mead", options=options)
    return _moved(type, start, best.x)


def _judged(picture: Floats, type: ChartType, M: Affine) -> FoundChart | None:
    """The chart, if its patches have the right order in each channel that shows anything."""
    each = np.sort(correlations(_patch_means(picture, type, M)[None], type.srgb)[0])
    believed = each.mean() > LIMITS.least_of_three or each[1:].mean() > LIMITS.least_of_two
    if not believed or not _is_plausible(M):
        return None
    return FoundChart(type, _mapped(M, type.corners), float(each.mean()), np.ones(len(type.cells), bool))


def _mapped(M: Affine, units: NDArray[np.floating]) -> NDArray[np.float64]:
    """(..., N, 2) pixels of points (N, 2) by outlines (..., 2, 3)."""
    return np.asarray(units @ np.swapaxes(M[..., :2], -1, -2) + M[..., None, :, 2], np.float64)


def _sample_points(type: ChartType) -> NDArray[np.float64]:
    """Points all over the chart and its frame, units."""
    width, height = type.size
    x = np.linspace(-0.6 * type.frame, width + 0.6 * type.frame, 3 * round(width) + 2)
    y = np.linspace(-0.6 * type.frame, height + 0.6 * type.frame, 3 * round(height) + 2)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _patch_points(type: ChartType) -> NDArray[np.float64]:
    """(N, 25, 2): points all over each patch but its border, units."""
    inner = np.stack(np.meshgrid(*[np.linspace(_BORDER, 1 - _BORDER, 5)] * 2), axis=-1).reshape(-1, 2)
    return np.asarray(type.cells[:, None, :2] + inner * type.cells[:, None, 2:], np.float64)


def _patch_means(picture: Floats, type: ChartType, M: Affine) -> NDArray[np.float64]:
    """(N, 3): the middles of the patches."""
    units = _patch_points(type)
    middles = units.mean(axis=1, keepdims=True) + 0.5 * (units - units.mean(axis=1, keepdims=True))
    return np.asarray(sampled(picture, _mapped(M[None], middles)).mean(axis=1), np.float64)


def _is_plausible(M: Affine) -> bool:
    """Not mirrored, and tilted by less than about 60 degrees."""
    singular = np.linalg.svd(M[:, :2], compute_uv=False)
    return bool(np.linalg.det(M[:, :2]) > 0 and singular[1] > 0.5 * singular[0])
