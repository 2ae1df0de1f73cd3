"""What fuses the frames of a tile (``mapping.engine``): our own engine, Open3D, or one that another
package adds; and the work on one tile of a map.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.mapping.kept_frames import Frames, Unplaced
from stereo_seecolor.mapping.surface.fusion import PlacedFrame, fuse_tile
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import Tile, TileStore, Tiling
from stereo_seecolor.plugins import load

FuseTile = Callable[[Tile, Tiling, Iterable[PlacedFrame], RectifiedPair], Surface]
"""What an engine is: fuses a tile's frames, and returns the triangles of the tile's own blocks,
without its rim.
"""


def engine(name: str) -> FuseTile:
    """The engine of that name. Only one that is chosen is imported.

    Raises PluginError for one that no installed package adds; DeviceError, with the command that
    installs it, where it needs a library that is missing.
    """
    found: FuseTile = fuse_tile if name == "tiles" else load("engines", name)
    return found


# The work on one tile of a map, as an object that can be sent to another process.


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
