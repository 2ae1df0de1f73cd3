"""Targets of known color in an image: a 24-patch chart, found or given by its corners, or neutral things inside polygons."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.evaluation.measures import CLIPPED
from stereo_seecolor.records import Image, Map

CHART_SRGB = np.array(  # the 24 patches of a ColorChecker Classic row by row, sRGB of 8 bits, as its maker publishes them
    [
        [115, 82, 68], [194, 150, 130], [98, 122, 157], [87, 108, 67], [133, 128, 177], [103, 189, 170],
        [214, 126, 44], [80, 91, 166], [193, 90, 99], [94, 60, 108], [157, 188, 64], [224, 163, 46],
        [56, 61, 150], [70, 148, 73], [175, 54, 60], [231, 199, 31], [187, 86, 149], [8, 133, 161],
        [243, 243, 242], [200, 200, 200], [160, 160, 160], [122, 122, 121], [85, 85, 85], [52, 52, 52],
    ]
) / 255  # fmt: skip
GRAYS = slice(18, 24)
_COLUMNS, _ROWS = 6, 4
_INNER = 0.25
"""Of a patch, this much is left out on each side, where its neighbors bleed in."""


@dataclass(frozen=True, eq=False)
class Target:
    """What has known colors. patches: one (H, W) mask each; srgb: (patches, 3) in [0, 1], or None for something neutral."""

    name: str
    patches: tuple[NDArray[np.bool_], ...]
    srgb: NDArray[np.float64] | None = None

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) all patches."""
        return np.asarray(np.any(self.patches, axis=0))


def find_chart(image: Image) -> Target | None:
    """The ColorChecker that OpenCV finds in the image, or in the image with its channels stretched; None where it finds none."""
    eight = image if image.dtype == np.uint8 else (image // 257).astype(np.uint8)
    low, high = np.quantile(eight.reshape(-1, 3), [0.01, 0.99], axis=0)
    stretched = np.clip((eight - low) * (255 / np.maximum(high - low, 1)), 0, 255).astype(np.uint8)
    for picture in (eight, stretched):
        detector: Any = cv2.mcc.CCheckerDetector_create()  # type: ignore[attr-defined]
        detector.setColorChartType(cv2.mcc.MCC24)
        detector.setUseDnnModel(False)
        if detector.process(np.ascontiguousarray(picture[..., ::-1]), 1):
            return chart("chart", np.asarray(detector.getListColorChecker()[0].getBox()), image.shape[:2])
    return None


def chart(name: str, corners: NDArray[np.floating], shape: tuple[int, ...]) -> Target:
    """A 24-patch chart from its corners (4, 2) in pixels: at dark skin, bluish green, black, white."""
    cells = np.array([[0, 0], [_COLUMNS, 0], [_COLUMNS, _ROWS], [0, _ROWS]], dtype=np.float32)
    onto_image = cv2.getPerspectiveTransform(cells, np.asarray(corners, dtype=np.float32))
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32) * (1 - 2 * _INNER) + _INNER
    patches = []
    for row in range(_ROWS):
        for column in range(_COLUMNS):
            inside = (square + np.array([column, row])).astype(np.float32)
            patches.append(_filled(cv2.perspectiveTransform(inside[None], onto_image)[0], shape))
    return Target(name, tuple(patches), CHART_SRGB)


def neutral(name: str, polygon: NDArray[np.floating], image: Image, range_m: Map) -> Target:
    """The white things inside a polygon (K, 2): brighter than Otsu's threshold, nowhere at full scale, with a known range."""
    inside = _filled(polygon, image.shape[:2])
    gray: NDArray[np.uint8 | np.uint16] = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if not inside.any():
        return Target(name, (inside,))
    eight = (gray[inside] // (1 if gray.dtype == np.uint8 else 257)).astype(np.uint8)
    threshold, _ = cv2.threshold(eight.reshape(-1, 1), 0, 255, cv2.THRESH_OTSU)
    bright = np.zeros_like(inside)
    bright[inside] = eight > threshold
    unclipped = np.asarray(image.max(axis=-1), dtype=np.float64) < CLIPPED * np.iinfo(image.dtype).max
    return Target(name, (bright & unclipped & np.isfinite(range_m),))


def read_targets(path: Path) -> dict[str, list[dict[str, NDArray[np.float64]]]]:
    """Targets by image stem from JSON: {"0006": [{"polygon": [[x, y], ...]}, {"chart": [[x, y] four times]}]}.

    Raises InputError for a file that says something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        targets = {str(stem): [_points(path, str(stem), entry) for entry in entries] for stem, entries in content.items()}
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: targets cannot be read: {error}") from error
    except (AttributeError, TypeError) as error:
        raise InputError(f'{path}: must hold {{"<image stem>": [{{"polygon": [[x, y], ...]}}, ...]}}') from error
    return targets


def targets_of(given: list[dict[str, NDArray[np.float64]]], image: Image, range_m: Map) -> tuple[Target, ...]:
    """The given targets of an image as masks; without any, the chart that is found in it, if one is."""
    if not given:
        found = find_chart(image)
        return () if found is None else (found,)
    targets = []
    for number, entry in enumerate(given, 1):
        for kind, points in entry.items():
            label = f"{kind} {number}"
            targets.append(chart(label, points, image.shape[:2]) if kind == "chart" else neutral(label, points, image, range_m))
    return tuple(targets)


def _points(path: Path, stem: str, entry: dict[str, object]) -> dict[str, NDArray[np.float64]]:
    kind, points = next(iter(entry.items()), ("", ""))
    try:
        corners = np.asarray(points, dtype=np.float64)
    except ValueError:
        corners = np.empty(0)
    if len(entry) != 1 or kind not in ("polygon", "chart") or corners.ndim != 2 or corners.shape[1] != 2:
        raise InputError(f"{path}: {stem}: a target is one polygon or chart of [x, y] corners, got {str(entry)[:60]}")
    if len(corners) < 3 or (kind == "chart" and len(corners) != 4):
        raise InputError(f"{path}: {stem}: a polygon needs 3 corners or more, a chart its 4; got {len(corners)}")
    return {kind: corners}


def _filled(polygon: NDArray[np.floating], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [np.round(polygon).astype(np.int32)], 1)
    return mask > 0
