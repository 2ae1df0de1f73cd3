"""START HERE: ``build_map`` makes the map of a reef from a survey's finished frames.

It places the frames, fuses their ranges tile by tile into a surface, and writes the cloud, mesh,
terrain, mosaic and metrics.
"""

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.library_threads import one_thread_in_products
from stereo_seecolor.compute.threads import Threads, in_background
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import DeviceError, MappingError
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.frame_index import FrameIndex, PointSampling, Progress, silent
from stereo_seecolor.mapping.kept_frames import KeptFrames
from stereo_seecolor.mapping.limits import check_extent, check_tiling, check_voxel
from stereo_seecolor.mapping.map_records import comment, write_description, write_poses, write_track
from stereo_seecolor.mapping.navigation.comparison import Navigation
from stereo_seecolor.mapping.placing import PlacedSurvey, place_survey
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.gaps import MISSING_FRACTION
from stereo_seecolor.mapping.raster.georeference import Georeference
from stereo_seecolor.mapping.raster.products import Rasters, write_preview, write_rasters
from stereo_seecolor.mapping.sizes import with_mosaic_cell, with_voxel
from stereo_seecolor.mapping.surface import small_parts
from stereo_seecolor.mapping.surface.engines import engine, fuse
from stereo_seecolor.mapping.surface.extraction import MIN_WEIGHT
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.parts import write_map
from stereo_seecolor.mapping.surface.tile_store import TileStore
from stereo_seecolor.mapping.surface.tiles import Tiling, cut
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.mapping.survey_frames import Frames, ReadableFrames, Unplaced
from stereo_seecolor.mapping.track.fiducials import read_known
from stereo_seecolor.mapping.track.marker_fit import MarkersFit
from stereo_seecolor.records import SurveyFrame, Trajectory

WITHOUT_GEO = (
    "no GeoTIFF of mosaic, terrain and metrics, and no LAZ: pip install "
    "'stereo-seecolor[geo]' (rasterio, pyproj, laspy)"
)


@dataclass(frozen=True, eq=False)
class MapSummary:
    """The outcome of a map.

    frames, placed: number of frames, and of those that were placed. components: frames in each
    connected component, the largest first. unplaced: the other frames, each with the reason, and
    those whose files were lost meanwhile. files: all that was written.
    points: number of points of the main cloud. seconds: time that the map took. navigation: given
    poses compared with the images, None where none were given. markers: how the map fits the
    markers, None without mapping.markers. missing_fraction: of the measured ground of the main
    component, what has no height.
    """

    frames: int
    placed: int
    components: tuple[int, ...]
    unplaced: tuple[Unplaced, ...]
    files: tuple[Path, ...]
    points: int
    seconds: float
    warnings: tuple[str, ...]
    navigation: Navigation | None = None
    markers: MarkersFit | None = None
    missing_fraction: float = 0.0

    @property
    def problems(self) -> tuple[str, ...]:
        """What makes a map less than a success: frames or ground that are missing, separate parts,
        given poses that contradict the images or could not be tested, given lengths of markers that
        cannot be right, two markers with one number.
        """
        poses, markers = self.navigation, self.markers
        found = {
            f"{len(self.unplaced)} of {self.frames} frames are not in the map": self.unplaced,
            f"the map is in {len(self.components)} parts": len(self.components) > 1,
            f"{self.missing_fraction:.0%} of the measured ground is missing from the map": (
                self.missing_fraction > MISSING_FRACTION
            ),
            "the given poses could not be tested": poses and not poses.relative_poses,
            poses.advice if poses else "": poses and poses.relative_poses and not poses.fits,
            "the given poses put one place more than a voxel apart": poses and poses.blurred,
            "given markers cannot be right": markers and (markers.refused or markers.doubled),
        }
        return tuple(text for text, is_so in found.items() if is_so)

    def moved(self, old: Path, new: Path) -> "MapSummary":
        """The summary of the same map once it was moved from the folder ``old`` to ``new``."""
        return replace(self, files=tuple(new / path.relative_to(old) for path in self.files))


@dataclass(frozen=True)
class Workspace:
    """Where a map is made: folder of unfinished work, receiver of progress, machine.

    scratch: a folder of features and tiles, from which a stopped map continues if they were made
    from the same inputs; None for one in the map's folder. It is deleted when the map is done.
    """

    scratch: Path | None = None
    progress: Progress = silent
    compute: Compute = field(default_factory=lambda: Threads(1))


def check(config: MappingConfig, trajectory: Trajectory | None) -> None:
    """Check the tables of markers, and needs of engine and UTM, before a frame is read.

    Other maps are made without GTSAM or rasterio, too, with a warning. Raises InputError for a
    table that cannot be used; DeviceError, with the command that installs it, where a library is
    missing; PluginError for an unknown engine; MappingError where the survey's place on Earth is
    not known.
    """
    read_known(config.markers)
    engine(config.engine)
    if config.crs != "utm":
        return
    if trajectory is None or not (
        trajectory.origin or (trajectory.absolute and trajectory.absolute.origin)
    ):
        what = "the poses have no position on Earth" if trajectory else "there are no poses"
        raise MappingError(
            f"mapping.crs: utm: {what}: give --poses with latitude and longitude, or leave "
            "mapping.crs out"
        )
    if not georeference.available():
        raise DeviceError(
            "mapping.crs: utm: needs pyproj, rasterio and laspy: pip install 'stereo-seecolor[geo]'"
        )


@one_thread_in_products()
def build_map(
    frames: Sequence[SurveyFrame],
    geometry: RectifiedPair,
    out_dir: Path,
    config: MappingConfig,
    trajectory: Trajectory | None = None,
    workspace: Workspace | None = None,
) -> MapSummary:
    """Place the frames, fuse them and write all map products into ``out_dir``, empty or new.

    frames: read when needed, several times, one at a time; one that raises FrameError is named in
    the summary and left out.
    trajectory: poses from a file; None for stereo odometry on the frames themselves.
    Component 0, the one with most frames, is written to out_dir itself, the others to
    out_dir/piece_<n>.

    Raises DeviceError before the first frame, see ``check``; MappingError if nothing can be read or
    placed, or if the settings would take more memory or disk than there is; OutputError if the disk
    is full: finished tiles are kept.
    """
    check(config, trajectory)
    workspace = workspace or Workspace()
    scratch = workspace.scratch or out_dir / ".scratch"
    started = time.perf_counter()
    found = ReadableFrames(frames)
    config = with_voxel(config, found, geometry)
    check_voxel(found, geometry, config.voxel_edge_m)
    kept = KeptFrames(found, scratch / "frames")
    index = _index(kept, geometry, config.voxel_edge_m, workspace, scratch)
    survey = Survey(kept, geometry, index, workspace.progress, workspace.compute, scratch)
    placed = _in_crs(place_survey(survey, config, trajectory), config)
    if placed.range_scale != 1:
        survey = survey.scaled(placed.range_scale)
    folders = [
        out_dir,
        *(out_dir / f"piece_{number}" for number in range(1, len(placed.placement.sizes))),
    ]
    built = [
        _build_component(survey, placed, number, config, folder, scratch, found.lost)
        for number, folder in enumerate(folders)
    ]
    shutil.rmtree(scratch, ignore_errors=True)
    summary = _summary(survey, placed, found.lost, built, time.perf_counter() - started)
    if summary.missing_fraction <= MISSING_FRACTION:
        return summary
    warning = (
        f"{summary.missing_fraction:.0%} of the measured ground is missing from the map: its "
        "ranges are too uncertain, or differ too much, for voxels of "
        f"{config.voxel_edge_m:g} m: fuse again with a larger mapping.voxel_m (auto: five pixels "
        "of the images)"
    )
    return replace(summary, warnings=(*summary.warnings, warning))


def _in_crs(placed: PlacedSurvey, config: MappingConfig) -> PlacedSurvey:
    """The placement in the coordinates of mapping.crs, as far as the place on Earth is known."""
    if config.crs == "local":
        return replace(placed, origin=None)
    if config.crs == "auto" or placed.origin is None:
        return placed
    T = georeference.in_utm(placed.placement.T_world_camera, placed.origin)
    return replace(
        placed,
        placement=replace(placed.placement, T_world_camera=T),
        origin=georeference.utm_of(placed.origin),
    )


def _summary(
    survey: Survey,
    placed: PlacedSurvey,
    lost: Mapping[int, Unplaced],
    built: Sequence[tuple[list[Path], int, float]],
    seconds: float,
) -> MapSummary:
    """Summarize a map. lost: frames that could not be read, by number. built: files, number of
    points and missing fraction of each component.
    """
    placement = placed.placement
    # after they were placed
    lost_later = [frame for i, frame in lost.items() if placement.components[i] >= 0]
    return MapSummary(
        frames=len(survey.index.names),
        placed=sum(placement.sizes) - len(lost_later),
        components=placement.sizes,
        unplaced=(*placement.unplaced, *lost_later),
        files=tuple(path for files, *_ in built for path in files),
        points=next((points for _, points, _ in built if points), 0),
        seconds=seconds,
        warnings=placement.warnings + (() if georeference.available() else (WITHOUT_GEO,)),
        navigation=placed.navigation,
        markers=placed.markers,
        missing_fraction=built[0][-1],
    )


def _index(
    frames: Frames, geometry: RectifiedPair, voxel_m: float, workspace: Workspace, scratch: Path
) -> FrameIndex:
    """Index the frames, with points half a block apart, so that no block is missed.

    Voxels are made for points whose weight in a single view is enough for a surface.
    """
    sampling = PointSampling(
        spacing_m=BLOCK * voxel_m / 2, max_std_m=voxel_m / float(np.sqrt(MIN_WEIGHT))
    )
    index = FrameIndex.build(
        frames, geometry, sampling, workspace.progress, workspace.compute, scratch
    )
    if len(index.lost) == len(frames):
        raise MappingError(
            f"none of the {len(frames)} frames can be read: "
            f"{next(iter(index.lost.values()), 'there are none')}"
        )
    return index


def _build_component(
    survey: Survey,
    placed: PlacedSurvey,
    number: int,
    config: MappingConfig,
    folder: Path,
    scratch: Path,
    lost: dict[int, Unplaced],
) -> tuple[list[Path], int, float]:
    """Write the map of a component; return its files, the number of points of its cloud, and the
    part of the measured ground that has no height.

    scratch: folder of unfinished work. lost: gets frames that cannot be read any more.
    """
    component = Component.of(survey, placed.placement, number)
    check_extent(component, config.voxel_edge_m)
    tiling = cut(component, config.voxel_edge_m, config.tile_edge_m)
    config = with_mosaic_cell(config, component, tiling)
    check_tiling(tiling, config)
    place = Georeference(component.offset_m, placed.origin)
    files = [
        write_track(folder / "trajectory.tum", component),
        write_poses(folder / "poses.csv", component, placed),
    ]
    store = TileStore.of(scratch / "tiles" / f"{number}", tiling, component, config.engine)
    _fuse_tiles(component, tiling, store, config, lost)
    small_parts.drop(store, tiling)
    surfaces = partial(store.surfaces, tiling)
    with in_background(partial(write_map, surfaces(), tiling, folder, comment(place))) as written:
        with in_background(partial(write_preview, folder, surfaces)) as preview:
            rasters = Rasters.render(component, surfaces, config, folder / ".rasters")
        cloud, mesh, points = written.result()
        files += [cloud, mesh, preview.result()]
    files += write_rasters(folder, rasters, place) if rasters else ()
    area_m2, missing = (rasters.area_m2, rasters.missing_fraction) if rasters else (0.0, 1.0)
    shown = {"area_m2": area_m2, "missing_fraction": missing}
    files += [write_description(folder / "map.json", place, config, placed.range_scale, shown)]
    shutil.rmtree(folder / ".rasters", ignore_errors=True)
    return files, points, missing


def _fuse_tiles(
    component: Component,
    tiling: Tiling,
    store: TileStore,
    config: MappingConfig,
    lost: dict[int, Unplaced],
) -> None:
    """Fuse all tiles that are not finished."""
    survey, left = component.survey, [tile for tile in tiling.tiles if not store.has(tile)]
    empty = replace(tiling, tiles=())
    work = partial(fuse, store, empty, survey.frames, survey.geometry, config.engine)
    placed = ((tile, component.T_local_camera[list(tile.frames)]) for tile in left)
    finished = len(tiling.tiles) - len(left)
    for done, gone in enumerate(survey.compute.tiles(work, placed), finished + 1):
        lost.update(gone)
        survey.progress(f"fusing tiles{component.label}", done, len(tiling.tiles))
