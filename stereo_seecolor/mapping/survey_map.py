"""START HERE: a survey's finished frames into the map of a reef."""

import shutil
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.files.map_files import whole
from stereo_seecolor.mapping.frame_index import FrameIndex, Progress, silent
from stereo_seecolor.mapping.raster.products import Piece, write_products
from stereo_seecolor.mapping.recovered import Frames, Salvage, Unplaced
from stereo_seecolor.mapping.surface import islands
from stereo_seecolor.mapping.surface.fusion import Surface, check_available, fuse_tile
from stereo_seecolor.mapping.surface.join import write_map
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.tile_store import TileStore
from stereo_seecolor.mapping.surface.tiles import Tile, cut
from stereo_seecolor.mapping.track import pose_graph
from stereo_seecolor.mapping.track.odometry import estimate, priors_from
from stereo_seecolor.mapping.track.placement import Placement, place, upright
from stereo_seecolor.mapping.track.tum_file import write_tum
from stereo_seecolor.records import GeoOrigin, SurveyFrame, Trajectory


@dataclass(frozen=True, eq=False)
class MapSummary:
    """What became of a survey.

    frames, placed: how many there were, and how many found their place. pieces: frames in each piece, the main one first.
    unplaced: the others, each with the reason, and those whose files were lost on the way. files: all that was written.
    points: of the main cloud.
    """

    frames: int
    placed: int
    pieces: tuple[int, ...]
    unplaced: tuple[Unplaced, ...]
    files: tuple[Path, ...]
    points: int
    seconds: float
    warnings: tuple[str, ...]


def build_map(
    frames: Sequence[SurveyFrame],
    pair: RectifiedPair,
    out_dir: Path,
    config: MappingConfig,
    trajectory: Trajectory | None = None,
    progress: Progress = silent,
) -> MapSummary:
    """Place the frames, fuse them and write all map products into ``out_dir``.

    frames: read lazily, several times, one at a time; one that raises FrameError is named and left out.
    trajectory: poses from a file; None: own stereo odometry.
    Piece 0, the one with most frames, is written to out_dir itself, others to out_dir/piece_<n>.

    Raises DeviceError before the first frame if Open3D is missing, or GTSAM for a trajectory taken as a prior; MappingError if
    nothing can be read or placed; OutputError if the disk is full: finished tiles are kept, and the next run goes on from them.
    """
    check_available()
    if trajectory is not None and config.poses == "prior":
        pose_graph.check_available()
    started = time.perf_counter()
    found = Salvage(frames)
    index = FrameIndex.build(found, pair, BLOCK * config.voxel_m / 2, progress)
    if len(index.lost) == len(frames):
        raise MappingError(f"none of the {len(frames)} frames can be read: {next(iter(index.lost.values()), 'there are none')}")
    placement = _place(found, pair, config, index, trajectory, progress)
    sizes = np.bincount(placement.pieces[placement.pieces >= 0])
    origin = trajectory.origin if trajectory else None
    files: list[Path] = []
    points = 0
    for number in range(len(sizes)):
        folder = out_dir if number == 0 else out_dir / f"piece_{number}"
        written, count = _build_piece(found, pair, folder, config, index, placement, number, origin, progress)
        files += written
        points = points or count
    _remove_pieces_of_earlier_maps(out_dir, len(sizes))
    lost_on_the_way = [frame for i, frame in found.lost.items() if placement.pieces[i] >= 0]
    return MapSummary(
        frames=len(index.names),
        placed=int(sizes.sum()) - len(lost_on_the_way),
        pieces=tuple(sizes.tolist()),
        unplaced=(*placement.unplaced, *lost_on_the_way),
        files=tuple(files),
        points=points,
        seconds=time.perf_counter() - started,
        warnings=placement.warnings,
    )


def _remove_pieces_of_earlier_maps(out_dir: Path, count: int) -> None:
    for folder in out_dir.glob("piece_*"):
        if folder.name.removeprefix("piece_").isdigit() and int(folder.name.removeprefix("piece_")) >= count:
            shutil.rmtree(folder, ignore_errors=True)


def _place(
    frames: Frames,
    pair: RectifiedPair,
    config: MappingConfig,
    index: FrameIndex,
    trajectory: Trajectory | None,
    progress: Progress,
) -> Placement:
    """By the trajectory, by our own odometry, or by our own odometry held to the trajectory."""
    if trajectory is None:
        return upright(estimate(frames, pair, config, index, (), progress), index, "unknown")
    given = upright(place(index, trajectory, config), index, trajectory.up)
    if config.poses == "given":
        return given
    return estimate(frames, pair, config, index, priors_from(given, config), progress)


def _build_piece(
    frames: Frames,
    pair: RectifiedPair,
    folder: Path,
    config: MappingConfig,
    index: FrameIndex,
    placement: Placement,
    number: int,
    origin: GeoOrigin | None,
    progress: Progress,
) -> tuple[list[Path], int]:
    chosen = np.flatnonzero(placement.pieces == number)
    trajectory, cloud, mesh = folder / "trajectory.tum", folder / "cloud.ply", folder / "mesh.ply"
    with whole(trajectory) as path:
        write_tum(path, index, placement.T_world_camera, chosen)
    tiling = cut(index, placement.T_world_camera, chosen, config.voxel_m, config.tile_m)
    store = TileStore(folder / ".tiles", tiling, placement.T_world_camera[chosen], index.checksums[chosen])
    for done, tile in enumerate(tiling.tiles):
        if not store.has(tile):
            store.save(tile, fuse_tile(tile, tiling, _read(frames, tile, placement.T_world_camera), pair))
        progress("fusing tiles", done + 1, len(tiling.tiles))
    kept = islands.keepers((store.load(tile) for tile in tiling.tiles), tiling.tile_m)
    for tile, parts in zip(tiling.tiles, kept, strict=True):
        if not parts.all():
            store.save(tile, islands.only(store.load(tile), parts))

    def surfaces() -> Iterator[Surface]:
        return (store.load(tile) for tile in tiling.tiles)

    points, _ = write_map(surfaces(), tiling.tile_m, cloud, mesh)
    piece = Piece(folder, surfaces, index, placement.T_world_camera, chosen, origin)
    products = write_products(piece, frames, pair, config, folder / ".tiles", progress)
    store.clear()
    return [trajectory, cloud, mesh, *products], points


def _read(frames: Frames, tile: Tile, T_world_camera: NDArray[np.float64]) -> Iterator[tuple[SurveyFrame, NDArray[np.float64]]]:
    """The tile's frames that can be read, the next one being read while one is fused."""
    with ThreadPoolExecutor(max_workers=1) as reader:
        upcoming = reader.submit(frames.__getitem__, tile.frames[0])
        for i, following in zip(tile.frames, (*tile.frames[1:], None), strict=True):
            frame = upcoming.result()
            if following is not None:
                upcoming = reader.submit(frames.__getitem__, following)
            if isinstance(frame, SurveyFrame):
                yield frame, T_world_camera[i]
