"""Facts of a dive, from its output folder: what the page and its paragraph of methods state."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from statistics import median

from stereo_seecolor.color.white_point import DOUBT
from stereo_seecolor.errors import ColorError, InputError
from stereo_seecolor.files.whole_files import damaged_map
from stereo_seecolor.mapping.raster.structure import EDGES_M, StructureAtScale
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.report.map_images import TerrainImages
from stereo_seecolor.report.squares import FILE, Squares, squares_of
from stereo_seecolor.report.terrain_roughness import TerrainRoughness, terrain_roughness
from stereo_seecolor.run_folder.finished_map import FinishedMap, open_map
from stereo_seecolor.run_folder.finished_run import FinishedRun
from stereo_seecolor.run_folder.frame_table import Problem, problems_of
from stereo_seecolor.run_folder.frames_csv import read_frames
from stereo_seecolor.run_folder.layout import FRAMES_TABLE, TERRAIN
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run
from stereo_seecolor.run_folder.water_file import read_waters

STATED_EDGE_M = 1.0
"""Edge of the squares of which the overview states the rugosity."""


@dataclass(frozen=True)
class RowFacts:
    """Facts from the rows of frames.csv, also of a dive under way. rows: in dive order."""

    rows: tuple[FrameRow, ...]

    @property
    def pairs(self) -> tuple[FrameRow, ...]:
        """Rows of pairs, without files that found no partner."""
        return tuple(row for row in self.rows if row.status != "unpaired")

    def count(self, status: str) -> int:
        """Number of rows of that status."""
        return sum(row.status == status for row in self.rows)

    def typical(self, fact: str) -> float | None:
        """The median of a column over all frames; None where it is empty."""
        values = [row.facts[fact] for row in self.rows if fact in row.facts]
        return median(values) if values else None

    @cached_property
    def problems(self) -> tuple[Problem, ...]:
        """Kinds of errors and warnings, the most frequent first, without the doubt of the white
        point: the verdict says it once for the dive.
        """
        every = problems_of(self.rows)
        return tuple(problem for problem in every if not problem.what.startswith(DOUBT))


@dataclass(frozen=True)
class DiveFacts(RowFacts):
    """Facts of a finished run. rows: of frames.csv. waters: by frame name, empty where unknown.
    map, posed: None without a map.
    """

    run: FinishedRun
    waters: Mapping[str, Water]
    map: FinishedMap | None
    posed: PosedRun | None

    @classmethod
    def of(cls, run: FinishedRun, *, with_map: bool = True) -> "DiveFacts":
        """Read the facts of a run. Raises InputError if its tables are missing or damaged."""
        rows = read_frames(run.root / FRAMES_TABLE, list(run.totals["stage_seconds"]))
        made = open_map(run.root) if with_map else None
        return cls(rows, run, _waters(run), made, open_posed_run(run.root) if made else None)

    @property
    def water(self) -> Water | None:
        """The one water of all frames, None where each has its own."""
        contents = {id(water): water for water in self.waters.values()}
        return next(iter(contents.values())) if len(contents) == 1 else None

    @property
    def track_m(self) -> float | None:
        """Length of the track through all placed frames, meters."""
        if self.map is None or len(self.map.track) < 2:
            return None
        points = [(point.x_m, point.y_m, point.z_m) for point in self.map.track]
        return sum(math.dist(a, b) for a, b in pairwise(points))

    @property
    def duration_s(self) -> float | None:
        """Seconds from the first to the last frame, None where names hold no time."""
        times = [row.timestamp_s for row in self.pairs if row.timestamp_s is not None]
        return max(times) - min(times) if len(times) > 1 else None

    @property
    def ground_pixel_m(self) -> float | None:
        """Edge of a pixel on the bottom at the median range, meters."""
        range_m, geometry = self.typical("median_range_m"), self.run.geometry
        return range_m / geometry.focal_px if range_m is not None and geometry is not None else None

    @cached_property
    def roughness(self) -> TerrainRoughness | None:
        """The roughness of the map's terrain without noise; None without a readable terrain."""
        made, posed = self.map, self.posed
        if made is None or posed is None or not made.area_m2:
            return None
        path = made.folder / TERRAIN
        edges_m = [edge_m for edge_m in EDGES_M if edge_m <= STATED_EDGE_M]
        square_m, frames = made.cell_m["metrics_m"], posed.survey
        try:
            images = TerrainImages.open(path) if path.is_file() else None
            if images is None:
                return None
            return terrain_roughness(posed, frames, images, square_m, edges_m)
        except InputError:
            return None  # named with the page's other parts

    @cached_property
    def squares(self) -> Squares | None:
        """The metrics of the map's squares without noise, if any. Raises InputError if damaged."""
        path = self.map.folder / FILE if self.map else None
        if path is None or not path.is_file() or self.roughness is None:
            return None
        try:
            return squares_of(
                path.read_bytes(),
                self.roughness.scale_m,
                self.roughness.squares,
                calibration_std(self.run).total,
            )
        except (OSError, ValueError, KeyError, IndexError) as error:
            raise damaged_map(path, error) from error

    @property
    def structure(self) -> StructureAtScale | None:
        """The structure of the map's squares of 1 m, or of the largest ones below that it holds,
        as ``metrics`` states it; None without any.
        """
        return self.roughness.structure if self.roughness else None


def _waters(run: FinishedRun) -> Mapping[str, Water]:
    try:
        return read_waters(run.water_file, [frame.name for frame in run.frames])
    except (InputError, ColorError):
        return {}
