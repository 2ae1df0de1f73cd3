"""What fuses the frames of a tile (``mapping.engine``): our own engine, Open3D, or one that another
package adds; and the work on one tile of a map.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import Threads, in_parts
from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.kept_frames import Frames, Unplaced
from stereo_seecolor.mapping.surface.extraction import PART_BLOCKS, Volume, extract
from stereo_seecolor.mapping.surface.kernels import MeasuredPixels, cells_of, in_sight, integrate
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import TRUNCATION_VOXELS, Tile, TileStore, Tiling
from stereo_seecolor.plugins import load
from stereo_seecolor.records import SurveyFrame

# Fusion of a tile: its frames' weighted measurements fill the voxels, and the surface is where
# their signed distance is zero.

PlacedFrame = tuple[SurveyFrame, NDArray[np.float64]]
"""A frame and its T_world_camera."""


def fuse_tile(
    tile: Tile, tiling: Tiling, frames: Iterable[PlacedFrame], geometry: RectifiedPair
) -> Surface:
    """Integrate the frames into the tile's voxels, and extract the triangles that belong to this
    tile and not to its rim.

    The surface has no points where no frame measured anything.
    """
    volume, measured = Volume.empty(tile.blocks, tiling.voxel_m), MeasuredPixels.room(geometry)
    for frame, T_world_camera in frames:
        _integrate(volume, measured, frame, inverse(T_world_camera))
    is_own = (tile.blocks[:, :2] // tiling.tile_blocks == tile.column).all(axis=1)
    return extract(volume, np.flatnonzero(is_own))


def _integrate(
    volume: Volume,
    measured: MeasuredPixels,
    frame: SurveyFrame,
    T_camera_world: NDArray[np.float64],
) -> None:
    camera, voxel_m = measured.camera, volume.voxel_m
    truncation_m = TRUNCATION_VOXELS * voxel_m
    cells = cells_of(volume.blocks, measured.deepest_m.shape, camera, T_camera_world, voxel_m)
    measured.weigh(frame, cells, voxel_m)
    chosen = in_sight(
        volume.blocks, measured.deepest_m, camera, T_camera_world, voxel_m, truncation_m
    )

    def integrate_part(first: int, last: int) -> None:
        integrate(
            volume.blocks, volume.tsdf, volume.weight, volume.color, volume.color_weight,
            frame.color, frame.color_is_doubtful, measured.depth_m, measured.weight,
            measured.stretch,
            camera, T_camera_world, voxel_m, truncation_m, chosen, first, last,
        )  # fmt: skip

    in_parts(integrate_part, len(chosen), PART_BLOCKS)


FuseTile = Callable[[Tile, Tiling, Iterable[PlacedFrame], RectifiedPair], Surface]
"""What an engine is: fuses a tile's frames, and returns the triangles of the tile's own blocks,
without its rim.
"""


def engine(name: str) -> FuseTile:
    """The engine of that name. Only one that is chosen is imported.

    Raises PluginError for one that no installed package adds; DeviceError, with the command that
    installs it, where it needs a library that is missing.
    """
    found: FuseTile = fuse_tile if name == "tiles" else load("engines", name, needs=("__call__",))
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
