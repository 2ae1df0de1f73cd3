"""Identifies a grid of patches as a color chart, seen whole or in part, by the place in the chart
at which the colors fit.

Water multiplies each channel of a chart and adds to it. So over the patches that are seen, each
channel must equal the published one but for a factor and an offset. The same must hold for the
differences between channels, which light and shade cannot imitate.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.evaluation.charts.flat_patches import Lattice, moved, onto_pixels

# Color charts: the places of their patches, and the colors that their makers publish.

_PIXELS = 16
"""Pixels of the template in a unit, the side of a small patch."""
_GAP = 0.12
"""Width of the dark line between patches, units."""
_BLUR = 0.15
"""Blur of the template by water and lens, standard deviation, units."""
_FRAME_LEVEL = 0.08
"""Encoded value of the chart's black frame."""


@dataclass(frozen=True, eq=False)
class ChartType:
    """A kind of chart. srgb: (N, 3) in [0, 1], D65. cells: (N, 4) as x, y, width, height in units,
    from the first patch's corner.

    size: (width, height) in units. frame: its dark margin, units. grays: which patches are neutral.
    """

    name: str
    srgb: NDArray[np.float64]
    cells: NDArray[np.float64]
    size: tuple[float, float]
    frame: float
    grays: slice

    @cached_property
    def corners(self) -> NDArray[np.float32]:
        """(4, 2) of the patches' outline, units: the first patch's corner, then clockwise."""
        width, height = self.size
        return np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)

    @cached_property
    def template(self) -> NDArray[np.float32]:
        """(h, w, 3) encoded picture of the chart with its frame, 16 px a unit."""
        width, height = (round((side + 2 * self.frame) * _PIXELS) for side in self.size)
        picture = np.full((height, width, 3), _FRAME_LEVEL, np.float32)
        for color, (x, y, w, h) in zip(self.srgb, self.cells, strict=True):
            left, top = (self.frame + x + _GAP / 2) * _PIXELS, (self.frame + y + _GAP / 2) * _PIXELS
            right, bottom = left + (w - _GAP) * _PIXELS, top + (h - _GAP) * _PIXELS
            picture[round(top) : round(bottom), round(left) : round(right)] = color
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), _BLUR * _PIXELS), np.float32)

    def template_pixels(self, units: NDArray[np.floating]) -> NDArray[np.float64]:
        """(N, 2) pixels of the template at points (N, 2) in units."""
        return np.asarray((units + self.frame) * _PIXELS - 0.5, np.float64)


@dataclass(frozen=True, eq=False)
class FoundChart:
    """A chart in a picture. corners: (4, 2) pixels of the patches' outline, the first patch's
    first, then clockwise; those of a cut chart lie outside. score: correlation of its patches with
    the published colors. seen: (N,) patches that the picture shows.
    """

    type: ChartType
    corners: NDArray[np.float64]
    score: float
    seen: NDArray[np.bool_]


def _grid(columns: int, heights: tuple[float, ...]) -> NDArray[np.float64]:
    tops = np.concatenate([[0], np.cumsum(heights)[:-1]])
    return np.array(
        [
            [x, top, 1, height]
            for top, height in zip(tops, heights, strict=True)
            for x in range(columns)
        ]
    )


CLASSIC_SRGB = np.array(
    [
        [115, 82, 68], [194, 150, 130], [98, 122, 157], [87, 108, 67], [133, 128, 177], [103, 189,
        170],
        [214, 126, 44], [80, 91, 166], [193, 90, 99], [94, 60, 108], [157, 188, 64], [224, 163, 46],
        [56, 61, 150], [70, 148, 73], [175, 54, 60], [231, 199, 31], [187, 86, 149], [8, 133, 161],
        [243, 243, 242], [200, 200, 200], [160, 160, 160], [122, 122, 121], [85, 85, 85], [52, 52,
        52],
    ]
)  # fmt: skip
"""The 24 patches row by row, sRGB of 8 bits, as X-Rite publishes them."""
DKK_SRGB = np.array(
    [
        [255, 255, 255], [176, 180, 183], [150, 151, 155], [119, 120, 124], [88, 89, 91], [0, 0, 0],
        [236, 30, 40], [243, 244, 0], [94, 190, 68], [71, 172, 239], [23, 24, 83], [237, 0, 142],
        [171, 49, 59], [204, 128, 58], [44, 136, 165], [189, 84, 150], [197, 159, 139], [180, 147,
        125],
    ]
)  # fmt: skip
"""The 18 patches row by row: OpenCV's reference of its VINYL18 chart, as sRGB of 8 bits."""
SPYDER_SRGB = np.array(
    [
        [98, 187, 166], [126, 125, 174], [82, 106, 60], [87, 120, 155], [197, 145, 125], [112, 76,
        60],
        [222, 118, 32], [58, 88, 159], [195, 79, 95], [83, 58, 106], [157, 188, 54], [238, 158, 25],
        [0, 127, 159], [192, 75, 145], [245, 205, 0], [186, 26, 51], [57, 146, 64], [25, 55, 135],
        [249, 242, 238], [202, 198, 195], [161, 157, 154], [122, 118, 116], [80, 80, 78], [43, 41,
        43],
    ]
)  # fmt: skip
"""The 24 patches row by row, grays below, white at the left: sRGB of 8 bits, as Datacolor publishes
them (columns H to E of "SpyderCheckr Color Data V2").
"""

CLASSIC = ChartType(
    "ColorChecker Classic",
    CLASSIC_SRGB / 255,
    _grid(6, (1, 1, 1, 1)),
    (6, 4),
    0.3,
    slice(18, 24),
)

DKK = ChartType(
    "DGK / DKK 18",
    DKK_SRGB / 255,
    _grid(6, (2, 1, 1)),
    (6, 4),
    0.2,
    slice(0, 6),
)

SPYDER = ChartType(
    "SpyderCheckr 24",
    SPYDER_SRGB / 255,
    _grid(6, (1, 1, 1, 1)),
    (6, 4),
    0.3,
    slice(18, 24),
)

CHART_TYPES = (CLASSIC, DKK, SPYDER)


# Samples an image between its pixels, and correlates colors.

Array = NDArray[np.float64]

_NOTHING = 1e-9
"""Spread of values that is only rounding."""


def sampled(picture: NDArray[np.float32], pixels: Array) -> Array:
    """(K, N, 3) at pixels (K, N, 2), between pixels by bilinear interpolation; NaN outside."""
    x, y = (np.ascontiguousarray(pixels[..., axis], np.float32) for axis in (0, 1))
    found: Any = cv2.remap(
        picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,) * 3
    )
    return np.asarray(found, np.float64)


def correlations(values: Array, reference: Array) -> Array:
    """(K, 3) correlation of values (K, N, 3) with a reference (N, 3), by channel; -1 where values
    are NaN or do not vary.
    """
    b = reference - reference.mean(axis=0)
    products = np.einsum("knc,nc->kc", values, b)
    sums = np.ones(values.shape[1]) @ values  # several times faster than values.sum(axis=1)
    spread = np.einsum("knc,knc->kc", values, values) - sums**2 / values.shape[1]
    norms = np.sqrt(np.maximum(spread, 0) * (b * b).sum(axis=0))
    return np.where(norms > _NOTHING, products / np.maximum(norms, _NOTHING), -1.0)


Floats = NDArray[np.float32]


@dataclass(frozen=True)
class ReadingLimits:
    """Limits for accepting a grid as a chart."""

    least_of_grid: int = 6
    """Patches of a grid that are looked at."""
    least_patches: int = 8
    """Patches that are seen and fit: a third of a ColorChecker."""
    least_score: float = 0.87
    """Mean correlation of the channels of all these: at least 0.88 through drawn waters and
    cameras; permuted ColorCheckers had at most 0.84 in 1,000 trials, 0.80 where part of them was
    seen.
    """
    least_chroma: float = 0.8
    """Correlation of what channels differ by: 0.93 in the same waters and cameras."""
    noise: float = 0.02
    """Fraction of full scale: of a channel whose colors spread by less only noise may be seen, as
    of red that is absorbed. The two of most contrast may spread by less, through haze.
    """
    first_look: float = 0.6
    """Mean correlation of the grid's patches with a place in a chart that is looked at more
    closely.
    """
    fits: float = 0.5
    """Root mean square misfit of a patch, of the spread of all patches, that is not covered by
    something else.
    """
    fits_unseen: float = 0.25
    """The same for a place without a patch of the grid: a dark patch has no outline in the frame,
    or something covers it.
    """
    inner: float = 0.3
    """Half the side of the part of a patch that is read, units."""
    flat: float = 0.25
    """Spread within the middle of a patch, of that over all patches."""
    most_off: float = 0.15
    """Units from a patch of the grid to its place in the chart."""
    least_part: float = 0.5
    """Fraction of the patches in the image that must be seen and fit."""
    most_beyond: float = 0.25
    """Largest fraction of the grid's patches outside of the chart: with more, it is another
    pattern.
    """


LIMITS = ReadingLimits()


@dataclass(frozen=True, eq=False)
class _Place:
    """A possible place of a grid in a chart. units: (N, 2) middles of its patches. patches: (N,)
    their numbers, -1 for none.
    """

    units: Array
    patches: NDArray[np.intp]


def read_lattice(picture: Floats, lattice: Lattice, type: ChartType) -> FoundChart | None:
    """The chart of this type that a grid in an image (H, W, 3) shows, or None."""
    seen = _middles(
        picture, onto_pixels(lattice.cells, lattice.pixels), lattice.cells.astype(np.float64)
    ).mean(axis=1)
    inside = np.isfinite(seen).all(axis=1)
    lattice, seen = Lattice(lattice.cells[inside], lattice.pixels[inside]), seen[inside]
    places = [
        place
        for place in _places(lattice, type)
        if (place.patches >= 0).sum() >= LIMITS.least_of_grid
    ]
    if not places:
        return None
    scores = [_first_look(seen, place, type) for place in places]
    best = places[int(np.argmax(scores))]
    known = best.patches >= 0
    if (
        max(scores) < LIMITS.first_look * np.sqrt(known.sum())
        or (~known).mean() > LIMITS.most_beyond
    ):
        return None
    return _read_at(picture, lattice, best, type)


def _places(lattice: Lattice, type: ChartType) -> Iterator[_Place]:
    """All rotations and shifts of a grid over the square patches of a chart."""
    square = np.flatnonzero(type.cells[:, 2] == type.cells[:, 3])
    middles = type.cells[square, :2] + type.cells[square, 2:] / 2
    first = middles.min(axis=0)
    at = np.rint(middles - first).astype(int)
    size = at.max(axis=0) + 1
    table = np.full(size, -1)
    table[at[:, 0], at[:, 1]] = square
    turned = lattice.cells
    if not len(turned):
        return
    for _ in range(4):
        turned = np.stack([-turned[:, 1], turned[:, 0]], axis=1)
        low, high = turned.min(axis=0), turned.max(axis=0)
        for shift in product(range(-high[0], size[0] - low[0]), range(-high[1], size[1] - low[1])):
            cells = turned + shift
            inside = ((cells >= 0) & (cells < size)).all(axis=1)
            yield _Place(cells + first, np.where(inside, table[tuple((cells % size).T)], -1))


def _first_look(seen: Array, place: _Place, type: ChartType) -> float:
    """Correlation times the square root of the number of patches: fewer patches correlate by
    chance.
    """
    known = place.patches >= 0
    each = correlations(seen[known][None], type.srgb[place.patches[known]])[0]
    return float(each.mean() * np.sqrt(known.sum()))


def _read_at(
    picture: Floats, lattice: Lattice, place: _Place, type: ChartType
) -> FoundChart | None:
    """The chart that a grid shows at a place, if enough patches lie where the chart has them and
    have its colors; else None.
    """
    good = place.patches >= 0
    for _ in range(2):
        onto = onto_pixels(place.units[good], lattice.pixels[good])
        off = np.hypot(
            *(moved(np.linalg.inv(onto).astype(np.float64), lattice.pixels) - place.units).T
        )
        good &= off < LIMITS.most_off
        if good.sum() < LIMITS.least_of_grid:
            return None
    pixels = _middles(
        picture, onto, np.asarray(type.cells[:, :2] + type.cells[:, 2:] / 2, np.float64)
    )
    first = np.zeros(len(type.cells), bool)
    first[place.patches[good]] = True
    seen = _seen(pixels, first, type)
    inside = np.isfinite(pixels).all(axis=(1, 2))
    score = _score(pixels[seen], type.srgb[seen])
    if (
        seen.sum() < max(LIMITS.least_patches, LIMITS.least_part * inside.sum())
        or score < LIMITS.least_score
    ):
        return None
    return FoundChart(type, moved(onto, type.corners), score, seen)


def _seen(pixels: Array, first: NDArray[np.bool_], type: ChartType) -> NDArray[np.bool_]:
    """(N,) True for patches that lie in the image, are flat, and have the color that is expected
    from the others.

    first: (N,) patches from which the colors of the others are expected at first.
    """
    means = pixels.mean(axis=1)
    inside = np.isfinite(means).all(axis=1)
    seen: NDArray[np.bool_] = first & inside
    if not seen.any():
        return seen
    spread = means[seen].std(axis=0)
    possible = inside & (pixels.std(axis=1) < LIMITS.flat * spread + LIMITS.noise).all(axis=1)
    most = np.where(first, LIMITS.fits, LIMITS.fits_unseen)
    seen &= possible
    for _ in range(4):
        if seen.sum() < 4:
            return seen
        misfit = means - _fitted(means[seen], type.srgb[seen], type.srgb)
        spread = means[seen].std(axis=0)
        seen = np.asarray(
            possible & (np.sqrt((misfit**2).mean(axis=1) / (spread**2).mean()) < most)
        )
    return seen


def _fitted(values: Array, reference: Array, all_references: Array) -> Array:
    """(N, 3) the published colors, with the factor and offset of each channel that fit ``values``
    best.
    """
    middle, mean = reference.mean(axis=0), values.mean(axis=0)
    centered = reference - middle
    factor = (centered * (values - mean)).sum(axis=0) / np.maximum((centered**2).sum(axis=0), 1e-9)
    return np.asarray(mean + (all_references - middle) * factor, np.float64)


def _score(pixels: Array, reference: Array) -> float:
    """Mean correlation of the channels with the chart's: of the two of most contrast, and of the
    third unless it is absorbed.

    -1 where fewer than two channels vary more over the patches than within them, or differences of
    channels are not the chart's.
    """
    if len(pixels) < LIMITS.least_patches:
        return -1.0
    values = pixels.mean(axis=1)
    spread = values.std(axis=0)
    within = np.median(pixels.std(axis=1), axis=0)
    shown = np.flatnonzero((spread > within) & (spread >= min(LIMITS.noise, np.sort(spread)[1])))
    if len(shown) < 2:
        return -1.0
    alike = correlations(_differences(values[:, shown])[None], _differences(reference[:, shown]))
    if alike.mean() < LIMITS.least_chroma:
        return -1.0
    return float(correlations(values[None], reference)[0][shown].mean())


def _differences(values: Array) -> Array:
    """(N, C) differences of each channel and the next, after each is normalized to mean 0 and
    spread 1.
    """
    same = (values - values.mean(axis=0)) / np.maximum(values.std(axis=0), 1e-9)
    return np.asarray(same - np.roll(same, 1, axis=1), np.float64)


def _middles(picture: Floats, onto: Array, units: Array) -> Array:
    """(N, 25, 3) pixels over the middles of patches, NaN outside of the image. onto: (3, 3) from
    units to pixels.
    """
    offsets = np.linspace(-LIMITS.inner, LIMITS.inner, 5)
    points = units[:, None] + np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    return sampled(picture, moved(onto, np.asarray(points, np.float64)))
