"""Range maps that lie elsewhere than their images: turned, shifted, or of another image.

Where ranges step, images have edges. Both are compared cell by cell, each against what is usual
around it, so that neither light nor haze matters: as given, turned back, shifted, and with the maps
of the images before and after.
"""

from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.blocks import in_blocks
from stereo_seecolor.checks.sample import DiveImages, evenly_spaced
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, RANGES, DiveVerdict
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import Array, Image

IMAGES, LEAST_IMAGES = 6, 3  # spread over the folder
WIDTH = 240  # cells across an image
AROUND = 6.0  # cells: standard deviation of what is usual around a cell
LEAST_CELLS = 2000
SIGMAS = 6.0
"""Of the mean over the images by chance, which its highest place of thousands exceeds 4 times. With
true ranges edges correlate by 0.05 (8 frames of FLSea) to 0.14 (20 of a reef), on average over the
frames; otherwise by 0 +- 0.02 (0.03) in a frame.
"""
SHIFT = 3  # cells: less is what rectification and resizing leave
WIDE = 6  # cells: of a peak
REACH = (30, 60)  # cells down and across to which shifts are looked for
TURNS = {
    "upside down": (slice(None, None, -1), slice(None)),
    "mirrored": (slice(None), slice(None, None, -1)),
    "turned by 180 degrees": (slice(None, None, -1), slice(None, None, -1)),
}
NEIGHBORS = {1: "the image before its own", -1: "the image after its own"}
"""Steps to the map that fits -> of which image each map is."""


def misplaced_maps(images: DiveImages) -> DiveVerdict:
    """Range maps, the second files of pairs, whose steps fit their images otherwise than given."""
    here: list[float] = []
    others: dict[str, list[float]] = {how: [] for how in (*TURNS, *NEIGHBORS.values())}
    shifted = []
    cell_px = 1
    for place in evenly_spaced(range(len(images.pairs)), IMAGES):
        pair = images.pairs[place]
        with suppress(InputError):  # the run names it
            image = read_image(pair.left, images.config.input)
            cell_px = max(1, round(image.shape[1] / WIDTH))
            seen, own = _image_edges(image, cell_px), _map_edges(images, pair.right, cell_px)
            if own.shape != seen.shape:
                continue
            here.append(_correlation(seen, own))
            shifted.append(_shifted(seen, own))
            for how, turn in TURNS.items():
                others[how].append(_correlation(seen, own[turn]))
            for step, how in NEIGHBORS.items():
                others[how].append(_with_map(images, place + step, seen, cell_px))
    if len(here) < LEAST_IMAGES or not np.isfinite(here).all():
        return NOTHING_FOUND
    together = np.mean(shifted, axis=0)
    dy, dx = _peak(together)
    down, across = REACH
    if max(abs(dy), abs(dx)) >= SHIFT:
        others[f"shifted by about {-dx * cell_px}, {-dy * cell_px} px (x, y)"] = [
            float(one[down + dy, across + dx]) for one in shifted
        ]
    together[max(down + dy - WIDE, 0) : down + dy + WIDE + 1] = np.nan
    chance = float(np.nanstd(together))
    return _verdict(np.array(here), others, chance, images.pairs[0].right.name)


def _with_map(images: DiveImages, place: int, seen: Array, cell_px: int) -> float:
    """The correlation with the map of that place; NaN where there is none that can be compared."""
    if 0 <= place < len(images.pairs):
        with suppress(InputError):
            edges = _map_edges(images, images.pairs[place].right, cell_px)
            return _correlation(seen, edges) if edges.shape == seen.shape else float("nan")
    return float("nan")


def _verdict(here: Array, others: dict[str, list[float]], chance: float, name: str) -> DiveVerdict:
    """The best of the other places, if it is beyond chance, and better than as given. chance:
    standard deviation of the mean correlation at other places.
    """
    found = {how: np.array(values) for how, values in others.items() if np.isfinite(values).any()}
    best = max(found, key=lambda how: float(np.nanmean(found[how])))
    known = np.isfinite(found[best])
    least = SIGMAS * chance * np.sqrt(len(here) / max(known.sum(), 1))
    there, as_given = float(np.median(found[best][known])), float(np.median(here[known]))
    if known.sum() < LEAST_IMAGES or there < least or there - as_given < 2**0.5 * least:
        return NOTHING_FOUND
    what = f"of {best}" if best in NEIGHBORS.values() else best
    if best.endswith(", 0 px (x, y)"):
        what += ", as maps of the other camera are"
    return DiveVerdict(
        (
            f"range: {name} and others are {what}: put right, their steps lie on edges of the "
            f"images (correlation {there:.2f}, as given {as_given:.2f}, by chance "
            f"{chance:.3f}): give each image its own map",
        ),
        RANGES | COLORS,
    )


def _image_edges(image: Image, cell_px: int) -> Array:
    gray = image if image.ndim == 2 else image.mean(axis=2)
    light = gray.astype(np.float32) * (255 / np.iinfo(image.dtype).max)
    small = cv2.GaussianBlur(_cells(light, cell_px).astype(np.float32), (0, 0), 1)
    logarithm = np.log(small + 8)  # noise of dark pixels is no edge
    slopes = (cv2.Sobel(logarithm, cv2.CV_32F, *along) for along in ((1, 0), (0, 1)))
    edges = cv2.GaussianBlur(np.hypot(*slopes), (0, 0), 1)
    return _beyond_usual(np.log(edges + 0.02).astype(np.float64))


def _map_edges(images: DiveImages, path: Path, cell_px: int) -> Array:
    """Raises InputError."""
    logarithm = np.log(_cells(read_range_map(path, images.config.input.range_units_per_m), cell_px))
    edges = np.full(logarithm.shape, np.nan)
    edges[1:-1, 1:-1] = np.abs(logarithm[2:, 1:-1] - logarithm[:-2, 1:-1]) + np.abs(
        logarithm[1:-1, 2:] - logarithm[1:-1, :-2]
    )
    return _beyond_usual(np.log(edges + 0.005))


def _cells(values: NDArray[np.float32], cell_px: int) -> Array:
    """Means of the known values of (H, W) in cells; NaN where none is."""
    blocks = in_blocks(values, cell_px)
    with np.errstate(invalid="ignore"):  # 0 / 0
        mean = np.nansum(blocks, axis=(1, 3)) / np.isfinite(blocks).sum(axis=(1, 3))
    return np.asarray(mean, np.float64)


def _beyond_usual(values: Array) -> Array:
    """Ranks, centered, of what values are beyond the mean around them; 0 where unknown."""
    known = np.isfinite(values)
    blurred = [
        cv2.GaussianBlur(part.astype(np.float32), (0, 0), AROUND)
        for part in (np.where(known, values, 0), known)
    ]
    beyond = (values - blurred[0] / np.maximum(blurred[1], 1e-6))[known]
    ranks = np.zeros(values.shape)
    if len(beyond):
        ranks[known] = (beyond.argsort().argsort() + 0.5) / len(beyond) - 0.5
    return ranks


def _correlation(one: Array, other: Array) -> float:
    """Of the cells that both know; NaN for too few."""
    both = (one != 0) & (other != 0)
    if both.sum() < LEAST_CELLS:
        return float("nan")
    return float(np.corrcoef(one[both], other[both])[0, 1])


def _shifted(one: Array, other: Array) -> Array:
    """Correlations of one with the other moved by -reach to reach, (rows, columns)."""
    down, across = REACH
    shape = one.shape[0] + down, one.shape[1] + across
    product = np.conj(np.fft.rfft2(other, shape)) * np.fft.rfft2(one, shape)
    moved = np.roll(np.fft.irfft2(product, shape), REACH, axis=(0, 1))
    scale = np.sqrt(float((one**2).sum() * (other**2).sum()))
    return np.asarray(moved[: 2 * down + 1, : 2 * across + 1] / max(scale, 1e-9))


def _peak(correlations: Array) -> tuple[int, int]:
    """Rows and columns by which the other must move to correlate most."""
    row, column = np.unravel_index(int(correlations.argmax()), correlations.shape)
    return int(row) - REACH[0], int(column) - REACH[1]
