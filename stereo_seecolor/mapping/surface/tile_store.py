"""Finished tiles on disk: memory stays bounded, and a map that was stopped goes on where it was."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.raw_arrays import load_arrays
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.kept_frames import kept_folder
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling


class TileStore:
    """A folder with a file a tile; all were made from the same poses, frames and settings."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @classmethod
    def of(cls, folder: Path, tiling: Tiling, component: Component, engine: str) -> "TileStore":
        """Open the store in ``folder``; tiles there that were made from other poses, frames or
        settings, or by another engine, are deleted.
        """
        index, frames = component.survey.index, component.frames
        made_from = component.T_local_camera[frames], index.checksums[frames], engine
        blocks = (tile.blocks for tile in tiling.tiles)
        key = content_key(*made_from, tiling.voxel_m, tiling.tile_blocks, *blocks)
        return cls(kept_folder(folder, key))

    def has(self, tile: Tile) -> bool:
        """Tell whether the tile is finished."""
        return self._path(tile).is_file()

    def save(self, tile: Tile, surface: Surface) -> None:
        """Write a tile. Raises OutputError if it cannot be written."""
        with atomic_path(self._path(tile)) as path, path.open("wb") as file:
            np.savez(file, **vars(surface))

    def load(self, tile: Tile) -> Surface:
        """Read a tile that was saved."""
        return Surface(**load_arrays(self._path(tile)))

    def surfaces(self, tiling: Tiling) -> Iterator[Surface]:
        """Read all tiles, one in memory at a time."""
        return (self.load(tile) for tile in tiling.tiles)

    def _path(self, tile: Tile) -> Path:
        return self._folder / f"{tile.name}.npz"
