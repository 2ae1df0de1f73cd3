"""Ray casting against the reef: where each ray meets it, and the color there; independent of the
number of threads.

Compiled without numba's own threads, whose simplest layer must not be entered twice at once:
``in_rows`` spreads the rows.
"""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.extras.synthetic.reef import (
    BLOCK_CELLS,
    CELL_M,
    DETAIL_TEXEL_M,
    MAX_STEEPNESS,
    Reef,
)

Rays = NDArray[np.float32]
"""(H, W, S, 3) unit directions in the camera's axes, S samples a pixel."""


def cast(reef: Reef, T_world_camera: NDArray[np.float64], rays: Rays) -> NDArray[np.float32]:
    """The distance along each ray to the reef: (H, W, S) meters, infinite without one."""
    range_m = np.empty(rays.shape[:3], np.float32)
    low, high = float(reef.height_m.min()), float(reef.height_m.max())
    in_rows(
        _cast,
        len(rays),
        reef.height_m,
        *reef.origin_m,
        reef.blocks,
        low,
        high,
        T_world_camera,
        rays,
        range_m,
    )
    return range_m


def look_up(
    reef: Reef,
    T_world_camera: NDArray[np.float64],
    rays: Rays,
    range_m: NDArray[np.float32],
    sample_angle: float,
) -> NDArray[np.float32]:
    """Look up the linear color of the lit reef where each ray meets it: (H, W, S, 3), filtered to
    ``sample_angle``, radians between rays.
    """
    out = np.zeros(rays.shape, np.float32)
    in_rows(
        _look_up,
        len(rays),
        reef.color,
        reef.detail,
        *reef.origin_m,
        T_world_camera,
        rays,
        range_m,
        sample_angle,
        out,
    )
    return out


def in_rows(kernel: Callable[..., Any], rows: int, *arguments: Any) -> None:
    """Run a compiled ``kernel(first_row, end_row, *arguments)`` over all rows, a part on each core.

    In threads of its own: who renders frames as they are asked for may be in the shared ones, which
    must not wait for each other.
    """
    threads = min(cores(), 8)
    bounds = np.linspace(0, rows, 4 * threads + 1).astype(int).tolist()
    for _ in Threads(threads).each(
        lambda part: kernel(*part, *arguments), itertools.pairwise(bounds)
    ):
        pass


@compiled
def _mirror(index: int, size: int) -> int:
    """Beyond its edge the reef goes on as its own mirror image."""
    period = 2 * size - 2
    index = abs(index) % period
    return index if index < size else period - index


@compiled
def _height(height_m: Any, column: float, row: float) -> Any:
    c, r = int(np.floor(column)), int(np.floor(row))
    fc, fr = column - c, row - r
    ny, nx = height_m.shape
    if 0 <= c < nx - 1 and 0 <= r < ny - 1:
        c1, r1 = c + 1, r + 1
    else:
        c, c1, r, r1 = _mirror(c, nx), _mirror(c + 1, nx), _mirror(r, ny), _mirror(r + 1, ny)
    top = height_m[r, c] * (1 - fc) + height_m[r, c1] * fc
    bottom = height_m[r1, c] * (1 - fc) + height_m[r1, c1] * fc
    return top * (1 - fr) + bottom * fr


@compiled
def _to_block_edge(place: float, step: float) -> float:
    """Ray length until ``place`` (in blocks), moving ``step`` blocks a meter, leaves its block."""
    if step > 1e-9:
        return float((np.floor(place) + 1 - place) / step)
    if step < -1e-9:
        return float((place - np.floor(place)) / -step)
    return np.inf


@compiled
def _march(
    height_m: Any, x0: float, y0: float, blocks: Any, low: float, high: float, start: Any, ray: Any
) -> Any:
    """Distance to the first crossing: to the block's top at once, then steps that its steepest
    slope allows, then bisection.
    """
    fall = -ray[2]
    if fall <= 1e-6:
        return np.inf
    reach = max((start[2] - high) / fall, 0.0)
    last = (start[2] - low) / fall + 0.01
    level = max(np.hypot(ray[0], ray[1]), 1e-6)
    block_m = CELL_M * BLOCK_CELLS
    # a smooth surface hides nothing within a third of a cell
    shortest = min(max(0.0006, 0.3 * CELL_M / level), 0.004)
    before = reach
    while reach < last:
        x, y = start[0] + reach * ray[0] - x0, start[1] + reach * ray[1] - y0
        clearance = start[2] - reach * fall - _height(height_m, x / CELL_M, y / CELL_M)
        if clearance <= 0.0:
            break
        before = reach
        across, up = x / block_m, y / block_m
        if 0 <= across < blocks.shape[1] and 0 <= up < blocks.shape[0]:
            top_m, slope = blocks[int(up), int(across), 0], blocks[int(up), int(across), 1]
            step = max((start[2] - reach * fall - top_m) / fall, clearance / (fall + slope * level))
            edge = min(
                _to_block_edge(across, ray[0] / block_m), _to_block_edge(up, ray[1] / block_m)
            )
            step = min(step, edge + 1e-4)
        else:
            step = clearance / (fall + MAX_STEEPNESS * level)
        reach += max(step, shortest)
    if reach >= last:
        return np.inf
    for _ in range(6):
        middle = 0.5 * (before + reach)
        x, y = start[0] + middle * ray[0] - x0, start[1] + middle * ray[1] - y0
        if start[2] - middle * fall > _height(height_m, x / CELL_M, y / CELL_M):
            before = middle
        else:
            reach = middle
    return 0.5 * (before + reach)


@compiled
def _cast(
    first: int,
    end: int,
    height_m: Any,
    x0: float,
    y0: float,
    blocks: Any,
    low: float,
    high: float,
    pose: Any,
    rays: Any,
    range_m: Any,
) -> None:
    _, columns, samples, _ = rays.shape
    ray = np.empty(3)
    for i in range(first, end):
        for j in range(columns):
            for s in range(samples):
                for k in range(3):
                    ray[k] = (
                        pose[k, 0] * rays[i, j, s, 0]
                        + pose[k, 1] * rays[i, j, s, 1]
                        + pose[k, 2] * rays[i, j, s, 2]
                    )
                range_m[i, j, s] = _march(height_m, x0, y0, blocks, low, high, pose[:3, 3], ray)


@compiled
def _bilinear(image: Any, column: float, row: float, out: Any) -> None:
    c, r = int(np.floor(column)), int(np.floor(row))
    fc, fr = column - c, row - r
    ny, nx, channels = image.shape
    c, c1, r, r1 = _mirror(c, nx), _mirror(c + 1, nx), _mirror(r, ny), _mirror(r + 1, ny)
    for k in range(channels):
        top = image[r, c, k] * (1 - fc) + image[r, c1, k] * fc
        bottom = image[r1, c, k] * (1 - fc) + image[r1, c1, k] * fc
        out[k] = top * (1 - fr) + bottom * fr


@compiled
def _wrapped(tile: Any, x: float, y: float) -> Any:
    size = tile.shape[0]
    c, r = int(np.floor(x)), int(np.floor(y))
    fc, fr = x - c, y - r
    c, r = c % size, r % size
    c1, r1 = (c + 1) % size, (r + 1) % size
    top = tile[r, c] * (1 - fc) + tile[r, c1] * fc
    bottom = tile[r1, c] * (1 - fc) + tile[r1, c1] * fc
    return top * (1 - fr) + bottom * fr


@compiled
def _level(footprint_m: float, cell_m: float, levels: int) -> Any:
    return min(max(np.log2(max(footprint_m / cell_m, 1e-6)), 0.0), levels - 1.001)


@compiled
def _lit_color(
    color: Any,
    detail: Any,
    x: float,
    y: float,
    z: float,
    x0: float,
    y0: float,
    footprint_m: float,
    near: Any,
    far: Any,
) -> None:
    """Trilinear color into ``near[:3]``, with the grain that this footprint resolves; height moves
    the grain, for walls.
    """
    level = _level(footprint_m, CELL_M, len(color))
    k, fraction = int(level), level - int(level)
    scale = 2.0**k
    column, row = (x - x0) / CELL_M + 0.5, (y - y0) / CELL_M + 0.5
    _bilinear(color[k], column / scale - 0.5, row / scale - 0.5, near)
    if fraction > 0.0:
        _bilinear(color[k + 1], column / (2 * scale) - 0.5, row / (2 * scale) - 0.5, far)
        for c in range(4):
            near[c] = near[c] * (1 - fraction) + far[c] * fraction
    if near[3] > 0.0:
        level = _level(footprint_m, DETAIL_TEXEL_M, len(detail))
        k, fraction = int(level), level - int(level)
        u, v = (x + 0.7 * z) / DETAIL_TEXEL_M + 0.5, (y - 0.6 * z) / DETAIL_TEXEL_M + 0.5
        grain = (1 - fraction) * _wrapped(detail[k], u / 2.0**k - 0.5, v / 2.0**k - 0.5)
        grain += fraction * _wrapped(
            detail[k + 1], u / 2.0 ** (k + 1) - 0.5, v / 2.0 ** (k + 1) - 0.5
        )
        for c in range(3):
            near[c] = near[c] * max(1.0 + near[3] * grain, 0.1)


@compiled
def _look_up(
    first: int,
    end: int,
    color: Any,
    detail: Any,
    x0: float,
    y0: float,
    pose: Any,
    rays: Any,
    range_m: Any,
    sample_angle: float,
    out: Any,
) -> None:
    _, columns, samples, _ = rays.shape
    near, far = np.empty(4), np.empty(4)
    for i in range(first, end):
        for j in range(columns):
            for s in range(samples):
                reach = range_m[i, j, s]
                if not np.isfinite(reach):
                    continue
                ray = rays[i, j, s]
                x = pose[0, 3] + reach * (
                    pose[0, 0] * ray[0] + pose[0, 1] * ray[1] + pose[0, 2] * ray[2]
                )
                y = pose[1, 3] + reach * (
                    pose[1, 0] * ray[0] + pose[1, 1] * ray[1] + pose[1, 2] * ray[2]
                )
                z = pose[2, 3] + reach * (
                    pose[2, 0] * ray[0] + pose[2, 1] * ray[1] + pose[2, 2] * ray[2]
                )
                _lit_color(color, detail, x, y, z, x0, y0, reach * sample_angle, near, far)
                for c in range(3):
                    out[i, j, s, c] = near[c]
