"""Identifies a grid of patches as a color chart, seen whole or in part, by the place in the chart
at which the colors fit.

Water multiplies each channel of a chart and adds to it. So over the patches that are seen, each
channel must equal the published one but for a factor and an offset. The same must hold for the
differences between channels, which light and shade cannot imitate.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.evaluation.charts.chart_types import ChartType, FoundChart
from stereo_seecolor.extras.evaluation.charts.lattices import Lattice, moved, onto_pixels
from stereo_seecolor.extras.evaluation.charts.sampling import correlations, sampled
from stereo_seecolor.records import Array

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class ReadingLimits:
    """Limits for accepting a grid as a chart."""

    least_of_grid: int = 6
    """Patches of a grid that are looked at."""
    least_patches: int = 8
    """Patches that are seen and fit: a third of a ColorChecker."""
    least_score: float = 0.87
    """Mean correlation of the channels of all these: at least 0.88 through synthetic waters and
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
    """Mean correlation of the grid's patches with a place in a chart that is examined closer."""
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
    """Largest fraction of the grid's patches outside of the chart: more is another pattern."""


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
    """Correlation times the root of the number of patches: fewer correlate by chance."""
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
    """(N, 3) published colors, with the factor and offset a channel that fit ``values``."""
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
    """(N, C) differences of neighboring channels, each normalized to mean 0, spread 1."""
    same = (values - values.mean(axis=0)) / np.maximum(values.std(axis=0), 1e-9)
    return np.asarray(same - np.roll(same, 1, axis=1), np.float64)


def _middles(picture: Floats, onto: Array, units: Array) -> Array:
    """(N, 25, 3) pixels over the middles of patches, NaN outside. onto: (3, 3) to pixels."""
    offsets = np.linspace(-LIMITS.inner, LIMITS.inner, 5)
    points = units[:, None] + np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    return sampled(picture, moved(onto, np.asarray(points, np.float64)))
