"""The reef: a height field with the things on it, lit and ready for ray casting."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.synthetic.bottom import Bottom
from stereo_seecolor.extras.synthetic.life import settle
from stereo_seecolor.extras.synthetic.survey import SurveySpec

Grid = NDArray[np.float32]

CELL_M = 0.005
DETAIL_TEXEL_M = 0.001
DETAIL_TILE = 1024
MARGIN_M = 3.0
BLOCK_CELLS = 16
MAX_STEEPNESS = 8.0
SUN_DIRECTION = np.array([0.22, 0.13, 0.967])


@dataclass(frozen=True, eq=False)
class Reef:
    """A reef as the renderer sees it. World axes east, north, up; grid point (row, column) is at
    origin + (column, row) * cell.

    height_m: (ny, nx). color: mip levels of (ny, nx, 4) linear R, G, B of the lit surface (albedo
    times shading) and the strength of its fine texture; level k has cells of CELL_M 2^k. detail:
    mip levels of a tile of fine texture, mean 0, that repeats every DETAIL_TILE * DETAIL_TEXEL_M.
    blocks: highest point and steepest slope of each BLOCK_CELLS x BLOCK_CELLS cells.
    chart_corners_m: (4, 2) of the color chart's corners, x and y.
    """

    origin_m: tuple[float, float]
    height_m: Grid
    color: tuple[Grid, ...]
    detail: tuple[Grid, ...]
    blocks: Grid
    chart_corners_m: NDArray[np.float64]


def build_reef(spec: SurveySpec) -> Reef:
    """The reef of a survey: the same seed gives the same reef."""
    rng = np.random.default_rng([spec.seed, 2])
    width_m = spec.line_length_m + 2 * MARGIN_M
    depth_m = (spec.lines - 1) * spec.line_spacing_m + 2 * MARGIN_M
    shape = (round(depth_m / CELL_M), round(width_m / CELL_M))
    bottom = Bottom.sand_and_rock(shape, CELL_M, (-MARGIN_M, -MARGIN_M), spec.relief_m, rng)
    chart_corners_m = settle(bottom, spec, rng)

    height_m = cv2.GaussianBlur(bottom.height_m, (0, 0), 0.8)
    lit = bottom.albedo * _shading(height_m)[..., None]
    color = np.concatenate([lit, bottom.texture[..., None]], axis=-1).astype(np.float32)
    return Reef(
        (-MARGIN_M, -MARGIN_M),
        height_m,
        mips(color),
        mips(_detail_tile(rng)),
        blocks(height_m),
        chart_corners_m,
    )


def blocks(height_m: Grid) -> Grid:
    """Compute the highest point and the steepest slope in each block, including neighboring grid
    points: (rows, columns, 2).
    """
    slope_x, slope_y = (
        np.abs(np.diff(height_m, axis=axis, append=np.nan)) / CELL_M for axis in (1, 0)
    )
    slope = np.nan_to_num(np.hypot(slope_x, slope_y))
    size = [-(-n // BLOCK_CELLS) * BLOCK_CELLS for n in height_m.shape]
    out = []
    for values in (height_m, slope):
        reached = cv2.dilate(values, np.ones((3, 3), np.uint8))
        padded = np.pad(
            reached, [(0, n - m) for n, m in zip(size, height_m.shape, strict=True)], mode="edge"
        )
        out.append(
            padded.reshape(
                size[0] // BLOCK_CELLS, BLOCK_CELLS, size[1] // BLOCK_CELLS, BLOCK_CELLS
            ).max(axis=(1, 3))
        )
    return np.stack([out[0], np.clip(out[1], 0.05, MAX_STEEPNESS)], axis=-1).astype(np.float32)


def _shading(height_m: Grid) -> Grid:
    """Light on the surface, 1 on open level ground: sun refracted to near the zenith, and the glow
    of the water all round.
    """
    slope_y, slope_x = np.gradient(height_m, CELL_M)
    sun_x, sun_y, sun_z = SUN_DIRECTION
    facing = (
        (sun_z - slope_x * sun_x - slope_y * sun_y) / np.sqrt(1.0 + slope_x**2 + slope_y**2) / sun_z
    )
    openness: Grid = np.ones_like(height_m)
    for radius_m in (0.03, 0.1, 0.3):
        below = (
            cv2.GaussianBlur(height_m, (0, 0), radius_m / CELL_M, borderType=cv2.BORDER_REFLECT)
            - height_m
        )
        openness *= np.exp(-np.maximum(below, 0.0) / radius_m)
    sun = np.clip(facing, 0.0, 1.1) * (0.3 + 0.7 * openness)
    return np.asarray(np.clip(0.6 * sun + 0.4 * openness, 0.02, 1.05), dtype=np.float32)


def _detail_tile(rng: np.random.Generator) -> Grid:
    """A tile of fine grain that wraps around, mean 0, about unit spread."""
    white = rng.standard_normal((DETAIL_TILE, DETAIL_TILE)).astype(np.float32)
    spectrum = np.fft.rfft2(white)
    frequency = np.hypot(
        np.fft.fftfreq(DETAIL_TILE)[:, None], np.fft.rfftfreq(DETAIL_TILE)[None, :]
    )
    band = np.where(
        (frequency > 1 / 64) & (frequency < 0.45), 1.0 / np.maximum(frequency, 1 / 64), 0.0
    )
    tile = np.fft.irfft2(spectrum * band, s=white.shape)
    return np.asarray(np.clip(tile / tile.std(), -2.5, 2.5), dtype=np.float32)


def mips(image: Grid) -> tuple[Grid, ...]:
    """The image at full size and halved seven times."""
    levels = [np.ascontiguousarray(image)]
    for _ in range(7):
        height, width = levels[-1].shape[:2]
        halved = cv2.resize(
            levels[-1][: height // 2 * 2, : width // 2 * 2],
            (width // 2, height // 2),
            interpolation=cv2.INTER_AREA,
        )
        levels.append(np.ascontiguousarray(halved))
    return tuple(levels)
