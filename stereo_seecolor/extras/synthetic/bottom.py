"""The bottom that things grow on: sand, ripples, rock; and the operation that adds things to it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Grid = NDArray[np.float32]
Color = tuple[float, float, float]

SAND: Color = (0.46, 0.40, 0.30)
ROCK: Color = (0.17, 0.145, 0.11)
TURF: Color = (0.12, 0.125, 0.05)
CORALLINE: Color = (0.36, 0.15, 0.20)


@dataclass(frozen=True, eq=False)
class BottomWindow:
    """A window of the bottom around a thing: u_m, v_m are meters from its center; slices cut the
    window from the grids.
    """

    rows: slice
    columns: slice
    u_m: Grid
    v_m: Grid


@dataclass(frozen=True, eq=False)
class Bottom:
    """Grids that grow while the reef is built: height_m (ny, nx), albedo (ny, nx, 3) linear,
    texture (ny, nx) grain strength.
    """

    cell_m: float
    origin_m: tuple[float, float]
    height_m: Grid
    albedo: Grid
    texture: Grid

    @classmethod
    def sand_and_rock(
        cls,
        shape: tuple[int, int],
        cell_m: float,
        origin_m: tuple[float, float],
        relief_m: float,
        rng: np.random.Generator,
    ) -> "Bottom":
        """Rolling ground: rippled sand in hollows, rock with turf and crusts on rises."""
        coarse = fractal_noise(shape, 2.5 / cell_m, 3, rng)
        rough = fractal_noise(shape, 0.5 / cell_m, 5, rng)
        rocky = smooth_step(coarse + 0.35 * rough, -0.25, 0.05)
        y, x = np.meshgrid(*(np.arange(n, dtype=np.float32) * cell_m for n in shape), indexing="ij")
        wander = fractal_noise(shape, 0.8 / cell_m, 2, rng)
        ripples = np.sin(2 * np.pi * (0.8 * x + 0.6 * y + 0.06 * wander) / 0.13)
        height_m = (
            0.5 * relief_m * coarse + rocky * (0.05 + 0.045 * rough) + (1 - rocky) * 0.005 * ripples
        )
        crust = smooth_step(fractal_noise(shape, 0.25 / cell_m, 4, rng), 0.5, 0.8)
        turf = smooth_step(fractal_noise(shape, 0.4 / cell_m, 4, rng), -0.2, 0.6)
        bare = mixed_colors(np.zeros((*shape, 3), np.float32), 1, ROCK)
        rock = mixed_colors(mixed_colors(bare, turf, TURF), crust, CORALLINE)
        speckle = np.exp(0.25 * fractal_noise(shape, 0.06 / cell_m, 3, rng))
        albedo = rock * rocky[..., None] + np.array(SAND, np.float32) * (1 - rocky[..., None]) * (
            1 + 0.06 * rough[..., None]
        )
        texture = (0.12 + 0.12 * rocky).astype(np.float32)
        shade = 1 + (speckle - 1) * (0.35 + 0.65 * rocky)
        return cls(
            cell_m,
            origin_m,
            height_m.astype(np.float32),
            (albedo * shade[..., None]).astype(np.float32),
            texture,
        )

    def patch(self, x_m: float, y_m: float, radius_m: float) -> BottomWindow:
        """The window within ``radius_m`` of a point, cut off at the edge of the bottom."""
        ny, nx = self.height_m.shape
        column, row, reach = (
            (x_m - self.origin_m[0]) / self.cell_m,
            (y_m - self.origin_m[1]) / self.cell_m,
            radius_m / self.cell_m,
        )
        columns = slice(max(int(column - reach), 0), min(int(column + reach) + 2, nx))
        rows = slice(max(int(row - reach), 0), min(int(row + reach) + 2, ny))
        v, u = np.meshgrid(
            (np.arange(rows.start, rows.stop) - row) * self.cell_m,
            (np.arange(columns.start, columns.stop) - column) * self.cell_m,
            indexing="ij",
        )
        return BottomWindow(rows, columns, u.astype(np.float32), v.astype(np.float32))

    def ground_m(self, x_m: float, y_m: float) -> float:
        """Height at a point, nearest grid point."""
        row = int(np.clip((y_m - self.origin_m[1]) / self.cell_m, 0, self.height_m.shape[0] - 1))
        column = int(np.clip((x_m - self.origin_m[0]) / self.cell_m, 0, self.height_m.shape[1] - 1))
        return float(self.height_m[row, column])

    def raise_to(
        self, patch: BottomWindow, top_m: NDArray[np.floating], albedo: Grid, texture: float
    ) -> None:
        """Put a thing there: wherever its top stands above what is there, height, color and grain
        become its own.
        """
        window = patch.rows, patch.columns
        above = top_m > self.height_m[window]
        self.height_m[window] = np.where(above, top_m, self.height_m[window])
        self.albedo[window] = np.where(above[..., None], albedo, self.albedo[window])
        self.texture[window] = np.where(above, np.float32(texture), self.texture[window])

    def paint(self, patch: BottomWindow, fraction: Grid, albedo: Color) -> None:
        """Cover what is there with a color, ``fraction`` in [0, 1] of it."""
        window = patch.rows, patch.columns
        self.albedo[window] = mixed_colors(self.albedo[window], fraction, albedo)


def fractal_noise(
    shape: tuple[int, int], wavelength: float, octaves: int, rng: np.random.Generator
) -> Grid:
    """Smooth noise of about unit spread; each octave has half the wavelength (cells) and 0.55 of
    the strength of the last.
    """
    total = np.zeros(shape, np.float32)
    strength = 1.0
    for _ in range(octaves):
        if wavelength < 3:
            break
        lattice = rng.standard_normal([int(n / wavelength) + 4 for n in shape]).astype(np.float32)
        size = (int(lattice.shape[1] * wavelength), int(lattice.shape[0] * wavelength))
        fine = cv2.resize(lattice, size, interpolation=cv2.INTER_CUBIC)
        row, column = (int(wavelength * rng.uniform(1, 2)) for _ in range(2))
        total += np.float32(strength) * fine[row : row + shape[0], column : column + shape[1]]
        strength, wavelength = 0.55 * strength, wavelength / 2
    return np.asarray(total / max(float(total.std()), 1e-6), dtype=np.float32)


def mixed_colors(albedo: Grid, fraction: NDArray[np.floating] | float, color: Color) -> Grid:
    """(H, W, 3) albedo of which a fraction (H, W) has another color."""
    fraction = np.asarray(fraction)[..., None]
    return np.asarray(
        albedo * (1 - fraction) + np.array(color, np.float32) * fraction, dtype=np.float32
    )


def smooth_step(value: Grid, low: float, high: float) -> Grid:
    """0 up to low, 1 from high on, smooth between."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)
