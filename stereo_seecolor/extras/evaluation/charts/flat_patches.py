"""Finds small flat regions with straight outlines, as the patches of a color chart are."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array

Floats = NDArray[np.float32]
Levels = NDArray[np.uint16]


@dataclass(frozen=True)
class PatchLimits:
    """Limits of a patch, in pixels of an image that is halved until its patches are small."""

    octaves: int = 6
    """Sizes of the image, from twice its size, each half the last: patches of 4 to 200 pixels."""
    window_px: int = 25
    """Window in which edges are compared: a patch and its neighbors."""
    flat: float = 0.6
    """Fraction of the mean edge in the window: inner pixels of a patch have weaker edges."""
    least_area: int = 6
    most_area: int = 600
    """Least and most flat pixels of a patch, without its border and blurred pixels."""
    least_fill: float = 0.85
    """Area over that of the parallelogram with the same second moments (1; an ellipse has 1.05, an
    L 0.8).
    """
    most_stretch: float = 3.0
    """Long over short side: a patch of two units, tilted by 50 degrees."""
    border_px: float = 2.5
    """Pixels by which the flat part of a patch is narrower than the patch."""


PATCH_LIMITS = PatchLimits()


@dataclass(frozen=True, eq=False)
class FlatPatches:
    """Flat regions. centers: (N, 2) pixels of the full image. sides: (N,) side of a square of the
    same area, in its pixels.
    """

    centers: Array
    sides: Array


def flat_patches(picture: Floats) -> Iterator[FlatPatches]:
    """The flat regions of (H, W, 3) for each size of patch, the smallest first."""
    for sized, pixel in pyramid(picture):
        found = _of_size(sized)
        yield FlatPatches((found.centers + 0.5) * pixel - 0.5, found.sides * pixel)


def pyramid(picture: Floats) -> Iterator[tuple[Levels, float]]:
    """The image (H, W, 3) at twice its size, then halved repeatedly; each with the width of its
    pixels in those of the image.
    """
    # morphology is several times faster on whole numbers
    levels = np.asarray(picture * 65535, np.uint16)
    sized = _resized(levels, 2.0)
    for octave in range(PATCH_LIMITS.octaves):
        if min(sized.shape[:2]) < PATCH_LIMITS.window_px:
            return
        yield sized, 2.0 ** (octave - 1)
        sized = _resized(sized, 0.5) if octave else levels


def _resized(levels: Levels, factor: float) -> Levels:
    kind = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(levels, None, fx=factor, fy=factor, interpolation=kind), np.uint16)


def flat_regions(picture: Levels) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(H, W) each pixel's flat region, 0 for none; (N, 5) box and area of each region."""
    edge = _edges(picture)
    flat = edge < PATCH_LIMITS.flat * cv2.blur(
        edge, (PATCH_LIMITS.window_px, PATCH_LIMITS.window_px)
    )
    flat[[0, -1]] = flat[:, [0, -1]] = False
    _, labels, stats, _ = cv2.connectedComponentsWithStats(flat.astype(np.uint8), connectivity=4)
    return labels, stats


def _of_size(picture: Levels) -> FlatPatches:
    labels, stats = flat_regions(picture)
    area = stats[:, cv2.CC_STAT_AREA]
    possible = (area >= PATCH_LIMITS.least_area) & (area <= PATCH_LIMITS.most_area)
    possible[0] = False
    number = np.cumsum(possible) - 1
    y, x = np.nonzero(possible[labels])
    return _compact(
        number[labels[y, x]], np.stack([x, y], axis=1).astype(np.float64), int(possible.sum())
    )


def _edges(picture: Levels) -> Floats:
    """(H, W) largest difference within 3 x 3 pixels in any channel."""
    smooth = cv2.GaussianBlur(picture, (3, 3), 0.7)
    square = np.ones((3, 3), np.uint8)
    red, green, blue = cv2.split(
        cv2.subtract(cv2.dilate(smooth, square), cv2.erode(smooth, square))
    )
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.float32)


def _compact(region: NDArray[np.intp], pixels: Array, count: int) -> FlatPatches:
    """The regions that may be parallelograms. region: (P,) region of each pixel. pixels: (P, 2).
    count: number of regions.
    """
    area = np.bincount(region, minlength=count).astype(np.float64)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(region, values, minlength=count) / np.maximum(area, 1))

    centers = np.stack([mean(pixels[:, 0]), mean(pixels[:, 1])], axis=1)
    dx, dy = (pixels - centers[region]).T
    xx, yy, xy = mean(dx * dx) + 1 / 12, mean(dy * dy) + 1 / 12, mean(dx * dy)
    half_trace, determinant = (xx + yy) / 2, np.maximum(xx * yy - xy * xy, 1e-9)
    difference = np.sqrt(np.maximum(half_trace**2 - determinant, 0))
    stretch = np.sqrt((half_trace + difference) / np.maximum(half_trace - difference, 1e-9))
    good = (area > PATCH_LIMITS.least_fill * 12 * np.sqrt(determinant)) & (
        stretch < PATCH_LIMITS.most_stretch
    )
    return FlatPatches(centers[good], np.sqrt(area[good]) + PATCH_LIMITS.border_px)
