"""Detects candidate positions of small color charts: colorful regions that correlate with a chart
in green, over sizes and angles.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.evaluation.charts.chart_types import ChartType

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class PlaceLimits:
    """Sizes, angles and places that are tried."""

    least_px: float = 15.0
    """Width of the smallest chart: patches of 2.5 pixels."""
    most_px: float = 32.0
    """Widths that are searched: of larger charts the patches are seen one by one."""
    size_step: float = 1.2
    """Ratio of one size to the next; between them the correlation falls by less than a tenth."""
    angles_deg: tuple[float, ...] = tuple(
        90.0 * turn + tilt for turn in range(4) for tilt in (-15, 0, 15)
    )
    template_px: int = 12
    """Width of the chart in the picture that is searched."""
    most_alike: float = 0.6
    """Correlation of two channels of a place of many colors: four real charts and 36 synthetic ones
    had 0.53 at most, in their two channels that are least alike. Light, shade and water leave
    channels alike.
    """
    least_color: float = 0.012
    """Spread of one of these that the other does not have, fraction of full scale: above the noise.
    The same charts: 0.017.
    """
    window: float = 0.66
    """Width of what is compared, of the chart's: the height of its patches."""
    reach: float = 0.15
    """Distance from the middle of a chart to a colorful place, as a fraction of its width."""
    least_green: float = 0.4
    """Correlation in green alone below which no place is examined."""
    candidates: int = 30
    """Places of green's best correlation that are examined in all channels, for each chart."""
    most_places: float = 0.03
    """Fraction of a picture, the most colorful, in which charts are looked for: bounds time."""
    batch: int = 8192
    """Places at a time: they take 15 MB."""


LIMITS = PlaceLimits()
_SIDE = 15
"""Side of a template, pixels: it holds a rotated chart of the width above."""


@dataclass(frozen=True)
class ChartPlace:
    """Middle, width and angle of what may be a chart."""

    x_px: float
    y_px: float
    width_px: float
    angle_deg: float


def chart_places(
    picture: Floats, types: Sequence[ChartType]
) -> Iterator[tuple[ChartType, ChartPlace]]:
    """The best places for a chart of each type and size in an image (H, W, 3), over all angles.

    No place is nearer to a better one of its size than a third of its width.
    """
    half: Floats = np.asarray(
        cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.float32
    )
    matched = [_templates(type) for type in types]
    size_px = LIMITS.least_px
    while size_px < min(LIMITS.most_px, *picture.shape[:2]):
        windows = _windows(picture[..., 1], many_colors(half, size_px / 2), size_px)
        middles = windows.middles
        for type, (scores, angles) in zip(types, windows.best_angles(matched), strict=True):
            for best in _apart(scores, middles, 0.3 * size_px):
                x_px, y_px = middles[best].tolist()
                yield type, ChartPlace(x_px, y_px, size_px, LIMITS.angles_deg[angles[best]])
        size_px *= LIMITS.size_step


def many_colors(picture: Floats, size_px: float) -> NDArray[np.bool_]:
    """(H, W) True where a chart of this width may lie, since two channels around differ."""
    width = max(3, round(LIMITS.window * size_px))

    def mean(values: Floats) -> Floats:
        return np.asarray(cv2.blur(values, (width, width)), np.float32)

    means = mean(picture)
    variance = np.maximum(mean(picture * picture) - means * means, 1e-9)
    color = np.zeros(picture.shape[:2], np.float32)
    for one, other in combinations(range(3), 2):
        covariance = (
            mean(picture[..., one] * picture[..., other]) - means[..., one] * means[..., other]
        )
        alike = covariance / np.sqrt(variance[..., one] * variance[..., other])
        own = np.minimum(variance[..., one], variance[..., other]) * (1 - alike**2)
        np.maximum(color, np.where(alike < LIMITS.most_alike, own, 0), out=color)
    least = max(LIMITS.least_color**2, float(np.quantile(color, 1 - LIMITS.most_places)))
    found = np.asarray(color > least, np.uint8)
    reach = 2 * round(LIMITS.reach * size_px) + 1
    return np.asarray(cv2.dilate(found, np.ones((reach, reach), np.uint8))) > 0


@dataclass(frozen=True, eq=False)
class _Windows:
    """Surroundings of colorful places. green: image scaled so that a chart has the templates' size.
    corners: (N,) flat index of the first pixel of each in it. middles: (N, 2) pixels of the whole
    image.
    """

    green: Floats
    corners: NDArray[np.intp]
    middles: NDArray[np.float64]

    def best_angles(
        self, matched: Sequence[tuple[Floats, Floats]]
    ) -> list[tuple[Floats, NDArray[np.intp]]]:
        """For each set of templates: (N,) the highest correlation over the pixels of its weight,
        and (N,) the angle's number.

        matched: templates (P, K) and weights (P, K / 2): upside down, weights are the same.
        """
        offsets = (np.arange(_SIDE)[:, None] * self.green.shape[1] + np.arange(_SIDE)).ravel()
        found = [
            (np.zeros(len(self.corners), np.float32), np.zeros(len(self.corners), np.intp))
            for _ in matched
        ]
        for first in range(0, len(self.corners), LIMITS.batch):
            part = slice(first, first + LIMITS.batch)
            values = self.green.ravel()[self.corners[part, None] + offsets]
            squares = values**2
            for (templates, weights), (scores, angles) in zip(matched, found, strict=True):
                variance = squares @ weights - (values @ weights) ** 2 / weights.sum(axis=0)
                each = (
                    values @ templates / np.sqrt(np.maximum(np.hstack([variance, variance]), 1e-6))
                )
                angles[part], scores[part] = each.argmax(axis=1), each.max(axis=1)
        return found


def _windows(green: Floats, colorful: NDArray[np.bool_], size_px: float) -> _Windows:
    scale = LIMITS.template_px / size_px
    small = np.asarray(
        cv2.resize(green, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.float32
    )
    y, x = np.nonzero(
        cv2.resize(colorful.astype(np.uint8), small.shape[::-1], interpolation=cv2.INTER_NEAREST)
    )
    side = _SIDE // 2
    small = np.asarray(
        cv2.copyMakeBorder(small, side, side, side, side, cv2.BORDER_REFLECT_101), np.float32
    )
    middles = (np.stack([x, y], axis=1).astype(np.float64) + 0.5) / scale - 0.5
    return _Windows(small, y * small.shape[1] + x, middles)


def _apart(scores: Floats, middles: NDArray[np.float64], distance_px: float) -> Iterator[int]:
    """Numbers of the best places that are not nearer to a better one than ``distance_px``."""
    left = np.flatnonzero(scores > LIMITS.least_green)
    left = left[np.argsort(-scores[left])][: 100 * LIMITS.candidates]
    for _ in range(LIMITS.candidates):
        if not len(left):
            return
        best = int(left[0])
        yield best
        left = left[np.hypot(*(middles[left] - middles[best]).T) > distance_px]


def _templates(type: ChartType) -> tuple[Floats, Floats]:
    """(P, K) the green channel of the chart at each angle, of mean 0 and norm 1; and (P, K / 2)
    True for pixels of the chart.
    """
    green = type.template[..., 1]
    height, width = green.shape
    scale = LIMITS.template_px / width
    smoothed = cv2.GaussianBlur(green, (0, 0), 0.4 / scale)
    pictures, weights = [], []
    for angle in np.radians(LIMITS.angles_deg):
        A = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        M = np.column_stack([A, (_SIDE - 1) / 2 - A @ [(width - 1) / 2, (height - 1) / 2]])
        inside = cv2.warpAffine(np.ones_like(green), M, (_SIDE, _SIDE)) > 0.5
        picture = cv2.warpAffine(smoothed, M, (_SIDE, _SIDE), borderMode=cv2.BORDER_REPLICATE)
        picture = np.where(inside, picture - picture[inside].mean(), 0).ravel()
        pictures.append(picture / np.linalg.norm(picture))
        weights.append(inside.ravel())
    half = len(weights) // 2
    return np.array(pictures, np.float32).T.copy(), np.array(weights[:half], np.float32).T.copy()
