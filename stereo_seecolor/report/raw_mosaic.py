"""The map in uncorrected colors, from the page's images before correction.

Each cell of the terrain takes its color from the frame that looks down on it most steeply, of those
whose range maps confirm that they see it. Nothing is blended, unlike in the orthomosaic: it serves
for comparison, and has a quarter of its pixels.
"""

import tempfile
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.ply import let_go
from stereo_seecolor.records import Array
from stereo_seecolor.report.map_images import Box, TerrainImages
from stereo_seecolor.report.map_mesh import Piece
from stereo_seecolor.run_folder.posed_run import PosedRun


@dataclass(frozen=True)
class RawLimits:
    """Limits for the choice of views, as for the orthomosaic."""

    tile_px: int = 512  # painted at a time
    views: int = 24  # nearest to a tile's middle: more never win
    hidden_m: float = 0.05  # a view whose range is off by more than this,
    hidden_fraction: float = 0.02  # and this fraction of it, shows something else
    cached_frames: int = 48  # neighboring tiles share them; 2 MB each


LIMITS = RawLimits()


@dataclass(frozen=True, eq=False)
class RawMosaic:
    """The map in uncorrected colors. rgba: (H, W, 4) uint8 on the terrain's cells, alpha 0 where no
    frame sees the cell; in an unnamed temporary file.
    """

    rgba: NDArray[np.uint8]
    terrain: TerrainImages

    @classmethod
    def paint(cls, posed: PosedRun, terrain: TerrainImages) -> "RawMosaic | None":
        """Paint the map; None where the page has no frame's image before correction."""
        views = _Views(posed)
        if not views.names:
            return None
        width, height = terrain.about["width"], terrain.about["height"]
        with tempfile.TemporaryFile() as file:
            rgba = np.memmap(file, np.uint8, "w+", shape=(height, width, 4))
        for top in range(0, height, LIMITS.tile_px):
            for left in range(0, width, LIMITS.tile_px):
                size = min(LIMITS.tile_px, width - left), min(LIMITS.tile_px, height - top)
                box = left, top, *size
                points_m = _points(terrain, box, posed.offset_m)
                if np.isfinite(points_m[..., 2]).any():
                    rgba[top : top + box[3], left : left + box[2]] = views.paint(points_m)
                    let_go(rgba)
        return cls(rgba, terrain)

    def read(self, box: Box, size: tuple[int, int]) -> NDArray[np.uint8]:
        """A box resized to ``size``, for ``pyramid``."""
        left, top, width, height = box
        part = np.ascontiguousarray(self.rgba[top : top + height, left : left + width])
        reduced = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
        let_go(self.rgba)
        return np.asarray(reduced, np.uint8)

    def colors_of(self, piece: Piece, offset_m: list[float]) -> NDArray[np.uint8]:
        """(N, 3) the colors of a piece's vertices; gray where no frame sees them."""
        grid = self.terrain.grid
        cells = np.floor(grid.pixels(piece.points_m + offset_m) + 0.5).astype(int)
        columns, rows = np.clip(cells, 0, np.array(grid.shape[::-1]) - 1).T
        found = np.asarray(self.rgba[rows, columns])
        let_go(self.rgba)
        return np.where(found[:, 3:] > 0, found[:, :3], np.uint8(128))


def painted_from(posed: PosedRun) -> list[str]:
    """Names of the map's frames whose image before correction is on the page."""
    return [
        frame.name
        for frame in posed.frames
        if (posed.run.root / frame.page_path("page/before")).is_file()
    ]


def _points(terrain: TerrainImages, box: Box, offset_m: Array) -> Array:
    """(h, w, 3) of the cells' centers in the map's own coordinates, NaN if unknown."""
    left, top, width, height = box
    x, y = terrain.grid.centers(slice(top, top + height), slice(left, left + width))
    return np.stack([x, y, terrain.heights_m(box)], axis=-1) - offset_m


class _Views:
    """The frames of a map whose image before correction is on the page."""

    def __init__(self, posed: PosedRun) -> None:
        self._posed, self._geometry = posed, posed.geometry
        self._read = lru_cache(LIMITS.cached_frames)(self._open)
        painted = set(painted_from(posed))
        self.names = [i for i, frame in enumerate(posed.frames) if frame.name in painted]

    def _open(self, number: int) -> tuple[NDArray[Any], NDArray[Any]] | None:
        """(h, w, 3) RGB picture and (H, W) measured ranges; None where one cannot be read."""
        path = self._posed.run.root / self._posed.frames[number].page_path("page/before")
        # of a fine picture, half of the pixels are still finer than the cells
        is_fine = self._geometry.image_size[0] >= 1600
        bgr = cv2.imread(str(path), cv2.IMREAD_REDUCED_COLOR_2 if is_fine else cv2.IMREAD_COLOR)
        if bgr is None:
            return None
        try:
            return bgr[..., ::-1], self._posed.measured_range_m(self._posed.frames[number])
        except InputError:
            return None

    def paint(self, points_m: Array) -> NDArray[np.uint8]:
        """(h, w, 4) RGBA of cells (h, w, 3)."""
        painted = np.zeros((*points_m.shape[:2], 4), np.uint8)
        best = np.full(points_m.shape[:2], np.inf)
        known = np.isfinite(points_m[..., 2])
        middle = points_m[known].mean(axis=0)
        T = self._posed.T_map_camera
        for number in sorted(
            self.names, key=lambda i: float(np.hypot(*(T[i, :2, 3] - middle[:2])))
        )[: LIMITS.views]:
            cost, u, v = self._cost(points_m, number)
            wins = cost < best
            view = self._read(number) if wins.any() else None
            if view is None:
                continue
            picture, range_m = view
            seen = wins & _is_seen(points_m, T[number], range_m, u, v)
            scale = picture.shape[1] / self._geometry.image_size[0]
            rows = np.clip((v[seen] + 0.5) * scale, 0, picture.shape[0] - 1).astype(int)
            columns = np.clip((u[seen] + 0.5) * scale, 0, picture.shape[1] - 1).astype(int)
            painted[seen, :3], painted[seen, 3] = picture[rows, columns], 255
            best[seen] = cost[seen]
        return painted

    def _cost(self, points_m: Array, number: int) -> tuple[Array, Array, Array]:
        """Tangent of each cell's viewing angle from the vertical, inf outside; and pixel u, v."""
        g, T = self._geometry, self._posed.T_map_camera[number]
        local = (points_m - T[:3, 3]) @ T[:3, :3]
        u, v = np.moveaxis(g.project(local), -1, 0)
        with np.errstate(invalid="ignore"):
            width, height = g.image_size
            inside = (
                (local[..., 2] > 0.05) & (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
            )
            offset = points_m - T[:3, 3]
            tangent = np.hypot(offset[..., 0], offset[..., 1]) / np.maximum(-offset[..., 2], 0.05)
        return np.where(inside, tangent, np.inf), np.where(inside, u, 0), np.where(inside, v, 0)


def _is_seen(
    points_m: Array, T_map_camera: Array, range_m: NDArray[Any], u: Array, v: Array
) -> NDArray[np.bool_]:
    """False where a frame's measured range differs from a cell's: it sees something else."""
    distance = np.linalg.norm(points_m - T_map_camera[:3, 3], axis=-1)
    measured = range_m[np.rint(v).astype(int), np.rint(u).astype(int)]
    with np.errstate(invalid="ignore"):
        seen: NDArray[np.bool_] = (
            np.abs(measured - distance) <= LIMITS.hidden_m + LIMITS.hidden_fraction * distance
        )
    return seen
