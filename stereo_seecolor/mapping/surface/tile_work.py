"""The work on one tile of a map, which can be sent to another process."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.mapping.surface.engines import engine
from stereo_seecolor.mapping.surface.own_engine import PlacedFrame
from stereo_seecolor.mapping.surface.tile_store import TileStore
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced

PlacedTile = tuple[Tile, NDArray[np.float64]]
"""A tile, and the poses (k, 4, 4) of its frames in the map's coordinates."""


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
    lost: dict[int, Unplaced] = {}
    read = _read(frames, placed, lost)
    store.save(placed[0], engine(engine_name)(placed[0], tiling, read, geometry))
    return lost


def _read(frames: Frames, placed: PlacedTile, lost: dict[int, Unplaced]) -> Iterator[PlacedFrame]:
    """The tile's frames that can be read, the next ones being read while one is fused."""
    tile, poses = placed
    read = Threads(1).each(frames.__getitem__, tile.frames)
    for number, frame, T in zip(tile.frames, read, poses, strict=True):
        if isinstance(frame, Unplaced):
            lost[number] = frame
        else:
            yield frame, T
