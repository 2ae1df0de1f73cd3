"""Landmarks of a site: features of its colors from above, each with its place in 3D."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.comparing.orthophoto import Orthophoto
from stereo_seecolor.mapping.raster.terrain import Terrain
from stereo_seecolor.mapping.track.local_contrast import local_contrast
from stereo_seecolor.mapping.track.sift import keypoints, match_descriptors
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class LandmarkSettings:
    """How features are found and matched."""

    per_m2: int = 2000  # of the ground that was seen; more are too small to last a year
    most: int = 60_000  # matching them takes a minute
    # looser than Lowe's 0.8: a rigid motion is searched in what is left, and few wrong ones fit it
    lowe_ratio: float = 0.85
    margin_px: int = 5  # from holes and the edge, where the picture is none of the bottom


SETTINGS = LandmarkSettings()


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks of a site. points_m: (n, 3) in the terrain's coordinates. descriptors: (n, 128)
    float32, square roots of normalized SIFT.
    """

    points_m: Array
    descriptors: NDArray[np.float32]


def landmarks(photo: Orthophoto, terrain: Terrain) -> Landmarks:
    """SIFT (Lowe 2004) with root normalization (Arandjelovic and Zisserman 2012) on local contrast,
    where the ground is known.
    """
    known = photo.gray > 0
    contrast = local_contrast(photo.gray, 1.0)
    mask = cv2.erode(
        known.astype(np.uint8), np.ones((2 * SETTINGS.margin_px + 1,) * 2, np.uint8), borderValue=0
    )
    count = min(SETTINGS.most, round(SETTINGS.per_m2 * float(known.sum()) * photo.grid.cell_m**2))
    pixels, descriptors = keypoints(contrast, mask, max(count, 100))
    if not len(pixels):
        return Landmarks(np.zeros((0, 3)), descriptors)
    places = _places(photo, terrain, pixels)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)).astype(
        np.float32
    )
    high = np.isfinite(places[:, 2])
    return Landmarks(places[high], root[high])


def _places(photo: Orthophoto, terrain: Terrain, pixels: Array) -> Array:
    """(n, 3) of pixels (n, 2); heights between the terrain's cells, NaN beside a hole."""
    x, y = photo.grid.center(*pixels.T)
    at = terrain.grid.pixels(np.stack([x, y], axis=-1)).astype(np.float32)
    outside = float("nan")
    z = cv2.remap(
        terrain.height_m.astype(np.float32),
        at[:, None, 0],
        at[:, None, 1],
        cv2.INTER_LINEAR,
        borderValue=outside,
    )
    return np.stack([x, y, z[:, 0].astype(np.float64)], axis=-1)


def matched(a: Landmarks, b: Landmarks) -> tuple[Array, Array]:
    """Match landmarks of a and b, each the other's best and better than the next best by Lowe's
    ratio: places (n, 3) of a, and of b.
    """
    index_a, index_b = match_descriptors(a.descriptors, b.descriptors, SETTINGS.lowe_ratio)
    return a.points_m[index_a], b.points_m[index_b]
