"""Targets of known color: charts, found or given by corners, and given white polygons."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.carried import carry_ranges
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.charts.chart_finder import find_charts
from stereo_seecolor.extras.evaluation.charts.chart_types import (
    CLASSIC,
    DKK,
    SPYDER,
    ChartType,
    FoundChart,
)
from stereo_seecolor.extras.evaluation.charts.white_cards import inner, white_cards
from stereo_seecolor.extras.evaluation.measures import CLIPPED
from stereo_seecolor.files.text_documents import read_json
from stereo_seecolor.records import Image, Map

_INNER = 0.25
"""Fraction of a patch that is left out on each side, where its neighbors bleed in."""
CHARTS = {"chart": CLASSIC, "dkk": DKK, "spyder": SPYDER}
"""Kind of a target in a file of targets -> type of chart."""
SPOT = 0.01
"""Edge of a spot that a user names, fraction of the image's width: centimeters on a reef."""
SPOTS = {"white": ((1.0, 1.0, 1.0), 0.025), "sand": ((1.17, 1.0, 0.77), 0.03)}
"""Kind of a spot -> its reflectance, and the standard error of the logarithms of its color: a guess
of white plates that have lain in the sea; of carbonate sand, red over green 1.1 to 1.2 and blue
over green 0.70 to 0.85 in published spectra (Hochberg, Atkinson and Andrefouet 2003, read off the
figure): 4 and 5 % in these ratios.
"""
Targets = dict[str, list[dict[str, NDArray[np.float64]]]]
"""Image stem -> its targets, each a kind -> corners (K, 2), or the pixel (2,) of a spot."""


@dataclass(frozen=True, eq=False)
class Target:
    """A target. patches: an (H, W) mask of each; type: of a chart, None for an object of one color.

    reflectance: of such an object, R, G, B. error: standard error of its logarithm.
    """

    name: str
    patches: tuple[NDArray[np.bool_], ...]
    type: ChartType | None = None
    reflectance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    error: float = 0.02

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) mask of all patches."""
        return np.asarray(np.any(self.patches, axis=0))


def chart(
    name: str, corners: NDArray[np.floating], shape: tuple[int, ...], type: ChartType = CLASSIC
) -> Target:
    """A chart from the corners (4, 2) of its patches in pixels: the first patch's, then clockwise
    (of a Classic: at dark skin, bluish green, black, white).
    """
    onto_image = cv2.getPerspectiveTransform(type.corners, np.asarray(corners, dtype=np.float32))
    square = (
        np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32) * (1 - 2 * _INNER) + _INNER
    )
    insides = (
        square * size + corner
        for corner, size in zip(type.cells[:, :2], type.cells[:, 2:], strict=True)
    )
    outlines = (
        cv2.perspectiveTransform(inside.astype(np.float32)[None], onto_image)[0]
        for inside in insides
    )
    return Target(name, tuple(_filled(outline, shape) for outline in outlines), type)


def found_chart(name: str, detected: FoundChart, shape: tuple[int, ...]) -> Target:
    """The target of a chart that was found; patches that the image does not show are empty."""
    target = chart(name, detected.corners, shape, detected.type)
    return replace(
        target,
        patches=tuple(
            patch & seen for patch, seen in zip(target.patches, detected.seen, strict=True)
        ),
    )


def neutral(name: str, polygon: NDArray[np.floating], image: Image, range_m: Map) -> Target:
    """White pixels in a polygon (K, 2): above Otsu's threshold, not clipped, with a known range."""
    inside = _filled(polygon, image.shape[:2])
    gray: NDArray[np.uint8 | np.uint16] = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if not inside.any():
        return Target(name, (inside,))
    eight = (gray[inside] // (1 if gray.dtype == np.uint8 else 257)).astype(np.uint8)
    threshold, _ = cv2.threshold(eight.reshape(-1, 1), 0, 255, cv2.THRESH_OTSU)
    bright = np.zeros_like(inside)
    bright[inside] = eight > threshold
    unclipped = (
        np.asarray(image.max(axis=-1), dtype=np.float64) < CLIPPED * np.iinfo(image.dtype).max
    )
    return Target(name, (bright & unclipped & np.isfinite(range_m),))


def spot(name: str, kind: str, at: NDArray[np.floating], shape: tuple[int, ...]) -> Target:
    """A spot of white or sand around a pixel (x, y): a square of 1 % of the image's width."""
    half = max(SPOT * shape[1] / 2, 2.0)
    return Target(
        name,
        (_filled(at + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), shape),),
        None,
        *SPOTS[kind],
    )


def read_targets(path: Path) -> Targets:
    """Targets by image stem from JSON: {"0006": [{"polygon": [[x, y], ...]}, {"chart": [[x, y] four
    times]}]};

    "dkk" instead of "chart" for a DGK or DKK chart of 18 patches, "spyder" for a SpyderCheckr 24.

    Raises InputError for a file that says something else.
    """
    try:
        content = read_json(path)
        targets = {
            str(stem): [_points(path, str(stem), entry) for entry in entries]
            for stem, entries in content.items()
        }
    except (AttributeError, TypeError) as error:
        raise InputError(
            f'{path}: must hold {{"<image stem>": [{{"polygon": [[x, y], ...]}}, ...]}}'
        ) from error
    return targets


def targets_of(
    given: list[dict[str, NDArray[np.float64]]], image: Image, range_m: Map
) -> tuple[Target, ...]:
    """The given targets of an image; without any, charts found in it; else white cards.

    A card may have ranges at its border only, since it has no texture to match; they are carried
    over to its inside.
    """
    if not given:
        found = find_charts(image)
        if not found:
            cards = white_cards(image)
            ranges_m = carry_ranges(image, range_m) if cards else range_m
            return tuple(neutral(_card_name(card), inner(card), image, ranges_m) for card in cards)
        names = (
            ["chart"]
            if len(found) == 1
            else [f"chart {number}" for number in range(1, len(found) + 1)]
        )
        return tuple(
            found_chart(name, one, image.shape[:2]) for name, one in zip(names, found, strict=True)
        )
    targets = []
    for number, entry in enumerate(given, 1):
        for kind, points in entry.items():
            if kind in SPOTS:
                x, y = points.astype(int)
                targets.append(spot(f"{kind} at pixel {x}, {y}", kind, points, image.shape[:2]))
                continue
            label = f"{kind} {number}"
            type = CHARTS.get(kind)
            targets.append(
                chart(label, points, image.shape[:2], type)
                if type
                else neutral(label, points, image, range_m)
            )
    return tuple(targets)


def _card_name(corners: NDArray[np.floating]) -> str:
    """The name of a card that was found, with the pixel of its middle."""
    x, y = np.round(corners.mean(axis=0)).astype(int)
    return f"white card at pixel {x}, {y}"


def _points(path: Path, stem: str, entry: dict[str, object]) -> dict[str, NDArray[np.float64]]:
    kind, points = next(iter(entry.items()), ("", ""))
    try:
        corners = np.asarray(points, dtype=np.float64)
    except ValueError:
        corners = np.empty(0)
    if (
        len(entry) != 1
        or kind not in ("polygon", *CHARTS)
        or corners.ndim != 2
        or corners.shape[1] != 2
    ):
        raise InputError(
            f"{path}: {stem}: a target is one polygon, chart, dkk or spyder of [x, y] corners, "
            f"got {str(entry)[:60]}"
        )
    if len(corners) < 3 or (kind in CHARTS and len(corners) != 4):
        raise InputError(
            f"{path}: {stem}: a polygon needs 3 corners or more, a chart its 4; got {len(corners)}"
        )
    return {kind: corners}


def _filled(polygon: NDArray[np.floating], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [np.round(polygon).astype(np.int32)], 1)
    return mask > 0
