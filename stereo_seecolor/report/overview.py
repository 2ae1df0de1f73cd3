"""The page's overview of the dive: facts, example frames, methods, settings and citations, as
values of the template.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from statistics import median
from typing import Any

import numpy as np

from stereo_seecolor.color.white_point import DOUBT
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import flat
from stereo_seecolor.errors import ColorError, InputError
from stereo_seecolor.mapping.raster.structure import EDGES_M, StructureAtScale
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.report.map_images import TerrainImages
from stereo_seecolor.report.squares import FILE, Squares, squares_of
from stereo_seecolor.report.terrain_roughness import TerrainRoughness, terrain_roughness
from stereo_seecolor.report.texts import digits, duration, length, phrase
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
        """The roughness of the map's terrain without noise; None without a terrain, or with one
        that cannot be read.
        """
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
        """The metrics of the map's squares without noise; None without a terrain. Raises InputError
        if their table is damaged.
        """
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
            raise InputError(
                f"{path}: is damaged ({error}): make the map again with stereo-seecolor fuse"
            ) from error

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


NAMED_FRAMES = 8
"""Frames of a warning that are named; the others are counted. So many fill a line on a screen."""
CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True)
class Fact:
    """A number of the dive, with its label."""

    label: str
    value: str


def dive_facts(facts: DiveFacts) -> list[Fact]:
    """The dive in numbers; what is unknown is left out."""
    done = phrase("fact.frames_value", ok=facts.count("ok"), pairs=len(facts.pairs))
    range_m, coverage = facts.typical("median_range_m"), facts.typical("coverage")
    area_m2 = facts.map.area_m2 if facts.map else None
    rugosity = _rugosity(facts.structure, length) if facts.structure else {}
    values = {
        "frames": done,
        "duration": facts.duration_s and duration(facts.duration_s),
        "track": facts.track_m and length(facts.track_m),
        "area": area_m2 and phrase("unit.m2", value=digits(area_m2)),
        "rugosity": rugosity.get("rugosity"),
        "range": range_m and length(range_m),
        "pixel": facts.ground_pixel_m and length(facts.ground_pixel_m),
        "coverage": coverage and phrase("fact.coverage_value", percent=f"{coverage:.0%}"),
    }
    return [
        Fact(phrase(f"fact.{key}", **rugosity), value) for key, value in values.items() if value
    ] + _halving(facts)


def _rugosity(structure: StructureAtScale, length_text: Callable[[float], str]) -> dict[str, str]:
    """Surface rugosity with its standard error, and the scale and the squares it belongs to."""
    text = f"{structure.mean.rugosity_area:.2f}"
    if np.isfinite(structure.standard_error.rugosity_area):
        text += f" ± {structure.standard_error.rugosity_area:.2f}"
    return {
        "rugosity": text,
        "cell": length_text(structure.scale_m),
        "edge": f"{structure.edge_m:g}",
    }


def _halving(facts: DiveFacts) -> list[Fact]:
    """The distance over which light of each channel halves, at the median range."""
    range_m = facts.typical("median_range_m")
    if facts.water is None or range_m is None:
        return []
    rates = -np.log(facts.water.attenuation(np.array(range_m))) / range_m
    return [
        Fact(
            phrase("fact.halving", channel=phrase(f"channel.{channel}")), length(math.log(2) / rate)
        )
        for channel, rate in zip(CHANNELS, rates, strict=True)
        if rate > 0
    ]


EXAMPLES = 6
"""Frames of the overview."""
_EXTREMES: tuple[tuple[str, str, Callable[..., FrameRow]], ...] = (
    ("why.nearest", "median_range_m", min),
    ("why.farthest", "median_range_m", max),
    ("why.most_measured", "coverage", max),
    ("why.least_measured", "coverage", min),
    ("why.hardest_color", "unrecoverable_fraction", max),
)


def example_frames(facts: DiveFacts) -> list[tuple[str, str]]:
    """(frame, key of the text with the reason), at most six: extremes of what was measured, then
    frames spread over the dive.
    """
    rows = [row for row in facts.pairs if row.status == "ok"]
    picks: dict[str, str] = {}
    if rows:
        picks[rows[len(rows) // 2].name] = "why.middle"
    for why, fact, best in _EXTREMES:
        known = [row for row in rows if fact in row.facts and row.name not in picks]
        if known:
            picks[best(known, key=lambda row, fact=fact: row.facts[fact]).name] = why
    for row in rows[:: max(1, len(rows) // EXAMPLES)]:
        picks.setdefault(row.name, "why.spread")
    return list(picks.items())[:EXAMPLES]


def methods(facts: DiveFacts) -> str:
    """A paragraph of methods with this run's own numbers; what is unknown is left out."""
    return " ".join([*_methods_of_pairs(facts), *_methods_of_water(facts), *_methods_of_map(facts)])


def _methods_of_pairs(facts: DiveFacts) -> list[str]:
    geometry = facts.run.geometry
    range_m, coverage = facts.typical("median_range_m"), facts.typical("coverage")
    if geometry is None or range_m is None or coverage is None:
        return []
    width, height = geometry.image_size
    refined = [phrase("methods.refine")] if facts.run.config.input.refine else []
    return [
        phrase(
            "methods.pairs",
            ok=facts.count("ok"),
            pairs=len(facts.pairs),
            width=width,
            height=height,
            baseline=digits(1000 * geometry.baseline_m, 4),
            focal=digits(geometry.focal_px, 4),
            version=facts.run.version,
        ),
        phrase(
            "methods.range",
            coverage=f"{coverage:.0%}",
            range=digits(range_m),
            pixel=digits(1000 * range_m / geometry.focal_px),
        ),
        *refined,
    ]


def _methods_of_water(facts: DiveFacts) -> list[str]:
    if not facts.waters:
        return []
    through = np.median(
        [water.attenuation(np.array(1.0)) for water in facts.waters.values()], axis=0
    )
    lock = facts.run.config.color.lock
    shared = phrase(f"methods.lock.{'sliding' if isinstance(lock, int) else lock}")
    sentences = [phrase("methods.water", lock=shared, **_by_channel(through))]
    errors = facts.water.standard_errors.get("y") if facts.water else None
    if errors is not None and np.isfinite(errors).all():
        sentences.append(phrase("methods.water_errors", **_by_channel(errors)))
    if facts.run.config.color.method == "robust":
        sentences += _methods_of_white(facts)
    if facts.typical("light_gain") is not None:
        sentences.append(phrase("methods.light"))
    return [*_methods_of_response(facts), *sentences]


def _methods_of_response(facts: DiveFacts) -> list[str]:
    """How values of the files were read as light; nothing where they were taken as they are."""
    color = facts.run.config.color
    if color.encoding == "as-is":
        return []
    sentences = [phrase(f"methods.response.{color.encoding}")]
    if any(color.pedestal):
        parts = zip(CHANNELS, color.pedestal, strict=True)
        percent = {channel: f"{100 * value:.1f}" for channel, value in parts}
        sentences.append(phrase("methods.pedestal", **percent))
    return sentences


def _methods_of_white(facts: DiveFacts) -> list[str]:
    """How the white point was found, with its standard error where that is known: the largest of
    the three channels'.
    """
    robust = facts.run.config.color.robust
    if robust.fits_white:
        errors = facts.water.standard_errors.get("white") if facts.water else None
        known = facts.water is not None and errors is not None and bool(np.isfinite(errors).all())
        percent = (
            f"{np.max(np.asarray(errors) / facts.water.white):.0%}" if known and facts.water else ""
        )
        said = phrase("methods.white_error", percent=percent) if known else ""
        return [phrase(f"methods.white.{robust.white_point}") + said + "."]
    return [
        phrase("methods.white.none" if robust.white_point == "none" else "methods.white.given")
        + "."
    ]


def _by_channel(values: Any) -> dict[str, str]:
    return {
        channel: digits(float(value), 2) for channel, value in zip(CHANNELS, values, strict=True)
    }


def _methods_of_map(facts: DiveFacts) -> list[str]:
    made = facts.map
    if made is None or made.area_m2 is None or facts.track_m is None:
        return []
    numbers = {
        "placed": len(made.track),
        "track": digits(facts.track_m),
        "voxel": digits(1000 * made.cell_m["voxel_m"]),
        "area": digits(made.area_m2),
    }
    residuals = [
        point.position_residual_m for point in made.track if point.position_residual_m is not None
    ]
    track = phrase(f"methods.track.{'given' if residuals else 'own'}")
    sentences = [phrase("methods.map", **numbers), track]
    if made.range_scale != 1:
        sentences.append(phrase("methods.scale", factor=digits(made.range_scale, 4)))
    if facts.structure:
        values = _rugosity(facts.structure, lambda meters: f"{digits(1000 * meters)} mm")
        sentences.append(phrase("methods.map_rugosity", **values))
    if residuals:
        sentences.append(phrase("methods.poses", residual=digits(float(np.median(residuals)), 2)))
    return sentences


def citations(facts: DiveFacts) -> list[str]:
    """The works to cite."""
    return [
        phrase("cite.program", version=facts.run.version),
        phrase("cite.deepseecolor"),
        phrase("cite.seathru"),
    ]


def changed_settings(config: RunConfig) -> list[Fact]:
    """Settings that differ from the defaults, by their full name."""
    default = flat(RunConfig().model_dump(mode="json"))
    mine = flat(config.model_dump(mode="json"))
    return [
        Fact(key, json.dumps(value)) for key, value in mine.items() if default.get(key) != value
    ]
