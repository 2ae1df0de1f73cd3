"""Things on the bottom: boulders, corals, sponges, a color chart, a bare patch of sand."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.synthetic.bottom import (
    CORALLINE,
    ROCK,
    SAND,
    TURF,
    Bottom,
    Color,
    Grid,
    fractal_noise,
    mixed_colors,
)
from stereo_seecolor.extras.synthetic.survey import SurveySpec

CHART_SIZE_M = (0.54, 0.37)
CHART: tuple[Color, ...] = (
    (0.1736, 0.0787, 0.0533), (0.5595, 0.2773, 0.2119), (0.1051, 0.1896, 0.3269),
    (0.1051, 0.1502, 0.0522), (0.2289, 0.2135, 0.4235), (0.1145, 0.5066, 0.4123),
    (0.7450, 0.2017, 0.0325), (0.0606, 0.1026, 0.3837), (0.5606, 0.0807, 0.1143),
    (0.1098, 0.0425, 0.1368), (0.3297, 0.4950, 0.0489), (0.7690, 0.3566, 0.0253),
    (0.0225, 0.0487, 0.2808), (0.0444, 0.2907, 0.0646), (0.4464, 0.0368, 0.0407),
    (0.8380, 0.5718, 0.0127), (0.5239, 0.0792, 0.2866), (0.0000, 0.2342, 0.3751),
    (0.8792, 0.8848, 0.8350), (0.5844, 0.5921, 0.5846), (0.3577, 0.3671, 0.3653),
    (0.1901, 0.1909, 0.1898), (0.0859, 0.0887, 0.0898), (0.0314, 0.0315, 0.0323),
)  # fmt: skip
"""Linear sRGB of the 24 patches of a ColorChecker Classic after November 2014 under D50 adapted to
D65 (X-Rite 2016), row by row; cyan's red lies outside sRGB and is set to 0.
"""
_SPONGES: tuple[Color, ...] = (
    (0.52, 0.05, 0.04),
    (0.66, 0.22, 0.03),
    (0.62, 0.46, 0.04),
    (0.26, 0.08, 0.34),
    (0.10, 0.30, 0.10),
)
_BRANCHING: tuple[Color, ...] = (
    (0.34, 0.24, 0.12),
    (0.20, 0.14, 0.33),
    (0.36, 0.30, 0.08),
    (0.42, 0.17, 0.20),
)
_MASSIVE: tuple[Color, ...] = ((0.34, 0.24, 0.09), (0.20, 0.22, 0.08), (0.38, 0.28, 0.20))


def settle(bottom: Bottom, spec: SurveySpec, rng: np.random.Generator) -> NDArray[np.float64]:
    """Populate the bottom, big things first; the (4, 2) corners of the color chart, meters."""
    ny, nx = bottom.height_m.shape
    area_m2 = ny * nx * bottom.cell_m**2

    def places(per_m2: float) -> NDArray[np.float64]:
        corner = np.array(bottom.origin_m)
        size_m = np.array([nx, ny]) * bottom.cell_m
        return np.asarray(corner + rng.random((round(per_m2 * area_m2), 2)) * size_m)

    each_per_m2 = (
        (_boulder, 0.3),
        (_massive_coral, 0.4),
        (_table_coral, 0.18),
        (_branching_thicket, 0.45),
        (_crust, 1.1),
        (_sponge, 1.2),
    )
    for grow, per_m2 in each_per_m2:
        for x, y in places(per_m2):
            grow(bottom, x, y, rng)
    if spec.textureless_patch:
        _bare_patch(bottom, 0.85 * spec.line_length_m, 0.0, 0.8)
    return _chart(bottom, min(0.35 * spec.line_length_m, 2.0) + 0.6, 0.25)


def _boulder(bottom: Bottom, x: float, y: float, rng: np.random.Generator) -> None:
    long_m, squat = rng.uniform(0.15, 0.55), rng.uniform(0.6, 1.0)
    height_m = rng.uniform(0.4, 0.75) * long_m
    patch = bottom.patch(x, y, 1.3 * long_m)
    noise = fractal_noise(patch.u_m.shape, 0.6 * long_m / bottom.cell_m, 5, rng)
    u, v = _turned(patch.u_m, patch.v_m, rng)
    distance = np.hypot(u / long_m, v / (squat * long_m)) * (1 + 0.1 * noise)
    top_m = bottom.ground_m(x, y) + height_m * _dome(distance, 2.6) + 0.03 * long_m * noise
    patchy = fractal_noise(patch.u_m.shape, 0.12 / bottom.cell_m, 4, rng)
    albedo = _painted(patch.u_m, ROCK) * np.exp(0.25 * patchy)[..., None]
    albedo = mixed_colors(albedo, np.clip(noise - 0.3, 0, 1), TURF)
    albedo = mixed_colors(albedo, np.clip(2 * patchy - 1.2, 0, 0.9), CORALLINE)
    bottom.raise_to(patch, np.where(distance < 1, top_m, -np.inf), albedo, texture=0.25)


def _massive_coral(bottom: Bottom, x: float, y: float, rng: np.random.Generator) -> None:
    radius_m = rng.uniform(0.10, 0.30)
    patch = bottom.patch(x, y, 1.2 * radius_m)
    noise = fractal_noise(patch.u_m.shape, 0.7 * radius_m / bottom.cell_m, 3, rng)
    distance = np.hypot(patch.u_m, patch.v_m) / radius_m * (1 + 0.07 * noise)
    grooves: Grid = np.sin(
        2
        * np.pi
        * (patch.u_m / 0.04 + 1.1 * fractal_noise(patch.u_m.shape, 0.07 / bottom.cell_m, 2, rng))
    )
    top_m = bottom.ground_m(x, y) + 0.75 * radius_m * _dome(distance, 2.2) + 0.004 * grooves
    albedo = (
        _painted(patch.u_m, _pick(_MASSIVE, rng))
        * (np.float32(1) + np.float32(0.3) * grooves)[..., None]
    )
    bottom.raise_to(patch, np.where(distance < 1, top_m, -np.inf), albedo, texture=0.18)


def _table_coral(bottom: Bottom, x: float, y: float, rng: np.random.Generator) -> None:
    radius_m = rng.uniform(0.18, 0.42)
    patch = bottom.patch(x, y, 1.3 * radius_m)
    noise = fractal_noise(patch.u_m.shape, 0.3 * radius_m / bottom.cell_m, 3, rng)
    distance = np.hypot(patch.u_m, patch.v_m) / radius_m * (1 + 0.06 * noise)
    bumps = fractal_noise(patch.u_m.shape, 0.05 / bottom.cell_m, 2, rng)
    edge = np.clip((1 - distance) * radius_m / 0.05, 0, 1)
    top_m = (
        bottom.ground_m(x, y)
        + (0.22 * radius_m + 0.08 * radius_m * distance) * edge**0.5
        + 0.006 * bumps
    )
    rim = np.clip((distance - 0.85) / 0.12, 0, 1)
    albedo = _painted(patch.u_m, _pick(_BRANCHING, rng)) * np.exp(0.28 * bumps)[..., None]
    bottom.raise_to(
        patch,
        np.where(distance < 1, top_m, -np.inf),
        mixed_colors(albedo, 0.5 * rim, (0.62, 0.55, 0.42)),
        texture=0.2,
    )


def _branching_thicket(bottom: Bottom, x: float, y: float, rng: np.random.Generator) -> None:
    spread_m, color = rng.uniform(0.12, 0.32), _pick(_BRANCHING, rng)
    for _ in range(int(900 * spread_m**2) + 10):
        angle, reach = rng.uniform(0, 2 * np.pi), spread_m * np.sqrt(rng.random())
        branch_x, branch_y = x + reach * np.cos(angle), y + reach * np.sin(angle)
        radius_m = rng.uniform(0.018, 0.035)
        height_m = rng.uniform(0.05, 0.14) * (1.1 - reach / spread_m) + 0.03
        patch = bottom.patch(branch_x, branch_y, radius_m)
        if patch.u_m.size == 0:
            continue
        distance = np.hypot(patch.u_m, patch.v_m) / radius_m
        top_m = bottom.ground_m(x, y) + height_m * _dome(distance, 1.5)
        albedo = _painted(patch.u_m, color) * np.float32(rng.uniform(0.8, 1.2))
        tip = mixed_colors(albedo, 0.6 * np.clip(1 - 2.2 * distance, 0, 1), (0.66, 0.58, 0.44))
        bottom.raise_to(patch, np.where(distance < 1, top_m, -np.inf), tip, texture=0.2)


def _sponge(bottom: Bottom, x: float, y: float, rng: np.random.Generator) -> None:
    radius_m, color = rng.uniform(0.03, 0.11), _pick(_SPONGES, rng)
    patch = bottom.patch(x, y, 1.3 * radius_m)
    if patch.u_m.size == 0:
        return
    noise = fractal_noise(patch.u_m.shape, 0.5 * radius_m / bottom.cell_m, 2, rng)
    distance = np.hypot(patch.u_m, patch.v_m) / radius_m * (1 + 0.12 * noise)
    hollow = np.clip(1 - 3.5 * distance, 0, 1)
    top_m = bottom.ground_m(x, y) + 0.9 * radius_m * _dome(distance, 2.4) - 0.3 * radius_m * hollow
    albedo = _painted(patch.u_m, color) * (np.exp(0.15 * noise) * (1 - 0.6 * hollow))[..., None]
    bottom.raise_to(patch, np.where(distance < 1, top_m, -np.inf), albedo, texture=0.18)


def _crust(bottom: Bottom, x: float, y: float, rng: np.random.Generator) -> None:
    """A strongly colored patch that covers what is there without raising it."""
    radius_m = rng.uniform(0.08, 0.3)
    patch = bottom.patch(x, y, 1.4 * radius_m)
    noise = fractal_noise(patch.u_m.shape, 0.5 * radius_m / bottom.cell_m, 4, rng)
    distance = np.hypot(patch.u_m, patch.v_m) / radius_m + 0.25 * noise
    # nothing crusts over loose sand
    on_rock = np.clip((bottom.texture[patch.rows, patch.columns] - 0.15) / 0.05, 0, 1)
    bottom.paint(
        patch,
        (on_rock * np.clip((1 - distance) * 5, 0, 0.85)).astype(np.float32),
        _pick(_SPONGES, rng),
    )


def _bare_patch(bottom: Bottom, x: float, y: float, radius_m: float) -> None:
    """Level sand with nothing on it: no stereo matcher finds anything here."""
    patch = bottom.patch(x, y, radius_m)
    window = patch.rows, patch.columns
    fraction = np.clip((radius_m - np.hypot(patch.u_m, patch.v_m)) / 0.1, 0, 1).astype(np.float32)
    bottom.height_m[window] = bottom.height_m[window] * (1 - fraction) - 0.02 * fraction
    bottom.texture[window] *= 1 - fraction
    bottom.paint(patch, fraction, SAND)


def _chart(bottom: Bottom, x: float, y: float) -> NDArray[np.float64]:
    """A 6x4 chart of 8 cm patches on a black board, lying level where its weight has flattened what
    was there.
    """
    width_m, depth_m = CHART_SIZE_M
    patch = bottom.patch(x, y, width_m)
    turn = np.radians(12.0)
    u = np.cos(turn) * patch.u_m + np.sin(turn) * patch.v_m + width_m / 2
    v = -np.sin(turn) * patch.u_m + np.cos(turn) * patch.v_m + depth_m / 2
    board = (u > 0) & (u < width_m) & (v > 0) & (v < depth_m)
    pitch_m, gap_m = 0.085, 0.006
    column, row = (
        np.floor((u - 0.015) / pitch_m).astype(int),
        np.floor((depth_m - 0.015 - v) / pitch_m).astype(int),
    )
    in_patch = (((u - 0.015) % pitch_m) > gap_m) & (((depth_m - 0.015 - v) % pitch_m) > gap_m)
    inside = board & in_patch & (column >= 0) & (column < 6) & (row >= 0) & (row < 4)
    albedo = _painted(patch.u_m, (0.02, 0.02, 0.02))
    albedo[inside] = np.array(CHART, np.float32)[row[inside] * 6 + column[inside]]
    ground_m = bottom.height_m[patch.rows, patch.columns]
    top_m = float(np.median(ground_m[board])) + 0.02
    around = (np.abs(u - width_m / 2) < width_m / 2 + 0.06) & (
        np.abs(v - depth_m / 2) < depth_m / 2 + 0.06
    )
    ground_m[around] = np.minimum(ground_m[around], top_m - 0.01)
    bottom.raise_to(patch, np.where(board, np.float32(top_m), -np.inf), albedo, texture=0.0)
    local = (
        np.array([[0, depth_m], [width_m, depth_m], [width_m, 0], [0, 0]])
        - np.array([width_m, depth_m]) / 2
    )
    return np.asarray(
        local @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + [x, y]
    )


def _dome(distance: NDArray[np.floating], power: float) -> Grid:
    return np.asarray(
        np.sqrt(np.clip(1 - np.clip(distance, 0, 1) ** power, 0, 1)), dtype=np.float32
    )


def _turned(u: Grid, v: Grid, rng: np.random.Generator) -> tuple[Grid, Grid]:
    angle = rng.uniform(0, np.pi)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    return c * u + s * v, c * v - s * u


def _painted(like: Grid, color: Color) -> Grid:
    return np.full((*like.shape, 3), np.array(color, np.float32))


def _pick(colors: tuple[Color, ...], rng: np.random.Generator) -> Color:
    return colors[int(rng.integers(len(colors)))]
