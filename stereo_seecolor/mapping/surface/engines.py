"""What fuses the frames of a tile (``mapping.engine``): our own engine, Open3D, or one that another
package adds; and the work on one tile of a map, which can be sent to another process.
"""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.mapping.surface.own_engine import PlacedFrame, fuse_tile
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tile_store import TileStore
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.plugins import load

FuseTile = Callable[[Tile, Tiling, Iterable[PlacedFrame], RectifiedPair], Surface]
"""An engine: fuses a tile's frames to the triangles of its own blocks, without its rim."""
PlacedTile = tuple[Tile, NDArray[np.float64]]
"""A tile, and the poses (k, 4, 4) of its frames in the map's coordinates."""


def engine(name: str) -> FuseTile:
    """The engine of that name. Only one that is chosen is imported.

    Raises PluginError for one that no installed package adds; DeviceError, with the command that
    installs it, where it needs a library that is missing.
    """
    found: FuseTile = fuse_tile if name == "tiles" else load("engines", name, needs=("__call__",))
    return found


def fuse(
    store: TileStore,
    tiling: Tiling,
    frames: Frames,
    geometry: RectifiedPair,
    engine_name: str,
    placed: PlacedTile,
) -> dict[int, Unplaced]:
    """Fuse a tile into the store; return the frames that were lost, by number. Raises OutputError.

    tiling: how the map is cut, without the tiles. engine_name: as other processes load their own.
    """
    tile, poses = placed
    lost: dict[int, Unplaced] = {}

    def readable() -> Iterator[PlacedFrame]:
        """The next ones are read while one is fused."""
        read = Threads(1).each(frames.__getitem__, tile.frames)
        for number, frame, T in zip(tile.frames, read, poses, strict=True):
            if isinstance(frame, Unplaced):
                lost[number] = frame
            else:
                yield frame, T

    store.save(tile, engine(engine_name)(tile, tiling, readable(), geometry))
    return lost
