"""Facts of a run and its map for the page."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from statistics import median

from stereo_seecolor.errors import ColorError, InputError
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.run_folder.finished_map import FinishedMap, open_map
from stereo_seecolor.run_folder.finished_run import FinishedRun
from stereo_seecolor.run_folder.frames_csv import read_frames
from stereo_seecolor.run_folder.frames_table import Problem, problems_of
from stereo_seecolor.run_folder.layout import FRAMES_TABLE
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run
from stereo_seecolor.run_folder.water_file import read_waters


@dataclass(frozen=True)
class RowFacts:
    """Facts from the rows of frames.csv, of a finished dive or one under way. rows: in the dive's order."""

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
        """Kinds of errors and warnings, the most frequent first."""
        return tuple(problems_of(self.rows))


@dataclass(frozen=True)
class DiveFacts(RowFacts):
    """Facts of a finished run. rows: of frames.csv. waters: by frame name, empty where unknown. map, posed: None without a map."""

    run: FinishedRun
    waters: Mapping[str, Water]
    map: FinishedMap | None
    posed: PosedRun | None

    @classmethod
    def of(cls, run: FinishedRun) -> "DiveFacts":
        """Read the facts of a run. Raises InputError if frames.csv or the map is missing or damaged."""
        rows = read_frames(run.root / FRAMES_TABLE, list(run.totals["stage_seconds"]))
        made = open_map(run.root)
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


def _waters(run: FinishedRun) -> Mapping[str, Water]:
    try:
        return read_waters(run.water_file, [frame.name for frame in run.frames])
    except (InputError, ColorError):
        return {}
