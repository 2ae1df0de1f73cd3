"""Finished tiles on disk: so that memory is bounded, and a run that was stopped goes on where it was."""

import hashlib
import shutil
from pathlib import Path

import numpy as np

from stereo_seecolor.files.map_files import whole
from stereo_seecolor.mapping.surface.fusion import Surface
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling


class TileStore:
    """A folder with one file a tile, all made from the same poses, frames and settings."""

    def __init__(self, folder: Path, tiling: Tiling, poses: np.ndarray, checksums: np.ndarray) -> None:
        """checksums: of the frames. Tiles in the folder that were made from anything else are deleted."""
        self._folder = folder
        digest = hashlib.sha256(poses.tobytes() + checksums.tobytes() + repr((tiling.voxel_m, tiling.tile_blocks)).encode())
        for tile in tiling.tiles:
            digest.update(tile.blocks.tobytes())
        key = digest.hexdigest()
        mark = folder / "made-from"
        if not mark.is_file() or mark.read_text() != key:
            shutil.rmtree(folder, ignore_errors=True)
            with whole(mark) as path:
                path.write_text(key)

    def has(self, tile: Tile) -> bool:
        """True if the tile is finished."""
        return self._path(tile).is_file()

    def save(self, tile: Tile, surface: Surface) -> None:
        """Raises OutputError if it cannot be written."""
        with whole(self._path(tile)) as path, path.open("wb") as file:
            np.savez(file, points=surface.points_m, normals=surface.normals, colors=surface.colors, triangles=surface.triangles)

    def load(self, tile: Tile) -> Surface:
        """A tile that was saved."""
        with np.load(self._path(tile)) as content:
            return Surface(content["points"], content["normals"], content["colors"], content["triangles"])

    def clear(self) -> None:
        """Delete all tiles: what they were for is written."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _path(self, tile: Tile) -> Path:
        return self._folder / f"{tile.name}.npz"
