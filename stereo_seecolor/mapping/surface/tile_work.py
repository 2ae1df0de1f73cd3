"""The work on one tile of a map, as an object that can be sent to another process."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.mapping.surface.engines import engine
from stereo_seecolor.mapping.surface.own_engine import PlacedFrame
from stereo_seecolor.mapping.surface.tile_store import TileStore
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced


@dataclass(frozen=True, eq=False)
class PlacedTile:
    """A tile, and the poses (k, 4, 4) of its frames in the map's coordinates."""

    tile: Tile
    T_local_camera: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TileFusion:
    """Fuses a tile into the store; returns the frames that were lost, by number.

    tiling: how the map is cut, without the tiles. engine: its name, as other processes load their
    own.
    """

    store: TileStore
    tiling: Tiling
    frames: Frames
    geometry: RectifiedPair
    engine: str

    def __call__(self, placed: PlacedTile) -> dict[int, Unplaced]:
        """Fuse the tile and save it. Raises OutputError."""
        lost: dict[int, Unplaced] = {}
        fuse_tile = engine(self.engine)
        self.store.save(
            placed.tile,
            fuse_tile(placed.tile, self.tiling, self._read(placed, lost), self.geometry),
        )
        return lost

    def _read(self, placed: PlacedTile, lost: dict[int, Unplaced]) -> Iterator[PlacedFrame]:
        """The tile's frames that can be read, the next ones being read while one is fused."""
        read = Threads(1).each(self.frames.__getitem__, placed.tile.frames)
        for number, frame, T in zip(placed.tile.frames, read, placed.T_local_camera, strict=True):
            if isinstance(frame, Unplaced):
                lost[number] = frame
            else:
                yield frame, T
