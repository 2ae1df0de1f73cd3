"""A small stereo scene with exact truth: a height field seen from above by two pinhole cameras,
through water.
"""

from copy import deepcopy
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.records import Map, Mask, StereoFrame

CELL_M = 0.01
FIELD = 1024
TEXTURE = 2048


@dataclass(frozen=True, eq=False)
class Scene:
    """frame: what the cameras see; disparity, depth_m: truth of the left image; both: True where
    the right camera sees it too.
    """

    frame: StereoFrame
    pair: RectifiedPair
    disparity: Map
    depth_m: Map
    both: Mask


def render(
    image_size: tuple[int, int] = (640, 512),
    altitude_m: float = 2.0,
    relief_m: float = 0.3,
    haze_per_m: float = 0.0,
    noise: float = 1.0,
    seed: int = 0,
    doffs_px: float = 0.0,
    focal_px: float | None = None,
    tilt: float = 0.0,
) -> Scene:
    """A bottom at altitude_m with boulders up to relief_m; haze_per_m: attenuation of the water,
    noise: gray levels (sigma).
    """
    unit_heights, albedo, rng = _ground(seed)
    rng, width, height = deepcopy(rng), *image_size
    focal_px = focal_px or 0.95 * width
    pair = RectifiedPair(
        focal_px, width / 2 - 0.5, width / 2 - 0.5 - doffs_px, height / 2 - 0.5, 0.12, image_size
    )
    heights = (relief_m * unit_heights).astype(np.float32)
    left_m = _cast(
        heights, altitude_m, tilt, focal_px, pair.cx_left_px, pair.cy_px, 0.0, width, height
    )
    right_m = _cast(
        heights,
        altitude_m,
        tilt,
        focal_px,
        pair.cx_right_px,
        pair.cy_px,
        pair.baseline_m,
        width,
        height,
    )
    left = _shade(albedo, left_m, pair, pair.cx_left_px, 0.0, haze_per_m)
    right = _shade(albedo, right_m, pair, pair.cx_right_px, pair.baseline_m, haze_per_m)
    images = [
        np.clip(i + rng.normal(0, noise, i.shape) + 0.5, 0, 255).astype(np.uint8)
        for i in (left, right)
    ]
    disparity = pair.disparity_from_depth(left_m)
    return Scene(
        StereoFrame("scene", *images),
        pair,
        disparity,
        left_m,
        _seen_by_both(disparity, left_m, right_m),
    )


@cache
def _ground(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float32], np.random.Generator]:
    """Heights for a relief of 1 m, albedo, and the numbers that follow; to be read only."""
    rng = np.random.default_rng(seed)
    heights = sum(_noise(rng, sigma) * share for sigma, share in ((60, 0.5), (20, 0.15), (6, 0.04)))
    for _ in range(150):
        cx, cy, radius = rng.uniform(0, FIELD), rng.uniform(0, FIELD), rng.uniform(5, 25)
        rows, columns = (
            slice(max(int(at - radius), 0), min(int(at + radius) + 2, FIELD)) for at in (cy, cx)
        )
        part = heights[rows, columns]
        y, x = (axis.astype(np.float32) for axis in np.mgrid[rows, columns])
        bump = 1 - ((x - cx) ** 2 + (y - cy) ** 2) / radius**2
        boulder = np.where(bump > 0, np.sqrt(np.maximum(bump, 0)) * radius / 25, -9)
        heights[rows, columns] = np.maximum(part, boulder)
    return heights, _texture(rng), rng


def _noise(rng: np.random.Generator, sigma: float) -> Map:
    frequency = np.hypot(np.fft.fftfreq(FIELD)[:, None], np.fft.rfftfreq(FIELD)[None])
    spectrum = np.fft.rfft2(rng.normal(size=(FIELD, FIELD))) * np.exp(
        -2 * (np.pi * sigma * frequency) ** 2
    )
    field = np.fft.irfft2(spectrum)
    return np.asarray(field / field.std() / 2, dtype=np.float32)


def _texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """(TEXTURE, TEXTURE, 3) albedo, 2.5 mm a cell: sand grain, patches, some of them plain."""
    size = TEXTURE
    base = np.full((size, size, 3), 0.45, np.float32)
    for grid, share in ((1, 0.10), (2, 0.10), (4, 0.08), (16, 0.12), (64, 0.15)):
        coarse = rng.standard_normal((size // grid, size // grid, 3), dtype=np.float32)
        coarse = 0.7 * coarse.mean(2, keepdims=True) * 1.7 + 0.3 * coarse
        base += share * cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC)
    calm = np.clip(cv2.resize(_noise(rng, 30), (size, size)) * 1.5 + 0.7, 0.15, 1)[..., None]
    return np.clip(0.45 + (base - 0.45) * calm, 0.02, 1).astype(np.float32)


@njit(cache=True)
def _cast(
    heights: Map,
    altitude_m: float,
    tilt: float,
    f: float,
    cx: float,
    cy: float,
    camera_x: float,
    width: int,
    height: int,
) -> Map:
    """Z of the height field along each pixel's ray: linear search, then bisection."""
    z_map = np.empty((height, width), np.float32)
    top = altitude_m - heights.max()
    top, bottom = max(0.05, top - 2 * abs(tilt)), altitude_m - heights.min() + 2 * abs(tilt)
    step = (bottom - top) / 200
    for row in range(height):
        for col in range(width):
            ray_x, ray_y = (col - cx) / f, (row - cy) / f
            z, before = top, top
            while z < bottom and z < altitude_m + tilt * ray_y * z - _height(
                heights, camera_x + ray_x * z, ray_y * z
            ):
                before, z = z, z + step
            for _ in range(14):
                middle = 0.5 * (before + z)
                if middle < altitude_m + tilt * ray_y * middle - _height(
                    heights, camera_x + ray_x * middle, ray_y * middle
                ):
                    before = middle
                else:
                    z = middle
            z_map[row, col] = z
    return z_map


@njit(cache=True)
def _height(heights: Map, x_m: float, y_m: float) -> float:
    x, y = x_m / 0.01 + 512.0, y_m / 0.01 + 512.0
    ix, iy = int(np.floor(x)), int(np.floor(y))
    fx, fy = x - ix, y - iy
    ix0, ix1, iy0, iy1 = ix % 1024, (ix + 1) % 1024, iy % 1024, (iy + 1) % 1024
    low = heights[iy0, ix0] * (1 - fx) + heights[iy0, ix1] * fx
    return low * (1 - fy) + (heights[iy1, ix0] * (1 - fx) + heights[iy1, ix1] * fx) * fy


def _shade(
    albedo: NDArray[np.float32],
    depth_m: Map,
    pair: RectifiedPair,
    cx_px: float,
    camera_x_m: float,
    haze_per_m: float,
) -> NDArray[np.float32]:
    """Albedo where each of 2x2 sub-pixels meets the surface, averaged, then the water: J exp(-b z)
    + B (1 - exp(-b z)).
    """
    width, height = pair.image_size
    twice = cv2.resize(depth_m, (2 * width, 2 * height), interpolation=cv2.INTER_LINEAR)
    col = ((np.arange(2 * width, dtype=np.float32) - 0.5) / 2 - np.float32(cx_px)) / np.float32(
        pair.focal_px
    )
    row = (
        (np.arange(2 * height, dtype=np.float32) - 0.5) / 2 - np.float32(pair.cy_px)
    ) / np.float32(pair.focal_px)
    scale, size = 4 / CELL_M, TEXTURE
    u = np.mod((col[None] * twice + np.float32(camera_x_m)) * scale + size / 2, size).astype(
        np.float32
    )
    v = np.mod(row[:, None] * twice * scale + size / 2, size).astype(np.float32)
    fine = cv2.remap(albedo, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    image = cv2.resize(
        cv2.GaussianBlur(fine, (0, 0), 1.2), (width, height), interpolation=cv2.INTER_AREA
    )
    seen = np.exp(-np.float32(haze_per_m) * depth_m)[..., None] * np.array([0.6, 1, 1], np.float32)
    return np.asarray(
        255 * (0.9 * image * seen + np.array([0.15, 0.45, 0.5], np.float32) * (1 - seen)),
        dtype=np.float32,
    )


def _seen_by_both(disparity: Map, left_m: Map, right_m: Map) -> Mask:
    height, width = disparity.shape
    col, row = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    met = cv2.remap(
        right_m,
        col - disparity,
        row,
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    return np.asarray(np.abs(met - left_m) < 0.02 * left_m)
