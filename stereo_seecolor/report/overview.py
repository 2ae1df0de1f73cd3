"""The page's overview of the dive: facts, methods, settings and citations, as values of the template."""

import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import flat
from stereo_seecolor.report.dive_facts import DiveFacts
from stereo_seecolor.report.texts import digits, duration, length, phrase
from stereo_seecolor.run_folder.finished_map import FinishedMap

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
    rugosity, cell_m = (facts.map.site.get("surface_rugosity"), facts.map.cell_m["dem_m"]) if facts.map else (None, 0.0)
    area_m2 = facts.map.area_m2 if facts.map else None
    values = {
        "frames": done,
        "duration": facts.duration_s and duration(facts.duration_s),
        "track": facts.track_m and length(facts.track_m),
        "area": area_m2 and phrase("unit.m2", value=digits(area_m2)),
        "rugosity": rugosity and phrase("fact.rugosity_value", rugosity=f"{rugosity:.2f}", cell=length(cell_m)),
        "range": range_m and length(range_m),
        "pixel": facts.ground_pixel_m and length(facts.ground_pixel_m),
        "coverage": coverage and phrase("fact.coverage_value", percent=f"{coverage:.0%}"),
    }
    return [Fact(phrase(f"fact.{key}"), value) for key, value in values.items() if value] + _halving(facts)


def _halving(facts: DiveFacts) -> list[Fact]:
    """The distance over which light of each channel halves, at the median range."""
    range_m = facts.typical("median_range_m")
    if facts.water is None or range_m is None:
        return []
    rates = -np.log(facts.water.attenuation(np.array(range_m))) / range_m
    return [
        Fact(phrase("fact.halving", channel=phrase(f"channel.{channel}")), length(math.log(2) / rate))
        for channel, rate in zip(CHANNELS, rates, strict=True)
        if rate > 0
    ]


def methods(facts: DiveFacts) -> str:
    """A paragraph of methods with this run's own numbers; what is unknown is left out."""
    return " ".join([*_methods_of_pairs(facts), *_methods_of_water(facts), *_methods_of_map(facts)])


def _methods_of_pairs(facts: DiveFacts) -> list[str]:
    geometry, range_m, coverage = facts.run.geometry, facts.typical("median_range_m"), facts.typical("coverage")
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
    through = np.median([water.attenuation(np.array(1.0)) for water in facts.waters.values()], axis=0)
    lock = phrase(f"methods.lock.{facts.run.config.color.lock}")
    sentences = [phrase("methods.water", lock=lock, **_by_channel(through))]
    errors = facts.water.standard_errors.get("y") if facts.water else None
    if errors is not None and np.isfinite(errors).all():
        sentences.append(phrase("methods.water_errors", **_by_channel(errors)))
    if facts.run.config.color.method == "robust":
        sentences += _methods_of_white(facts)
    if facts.typical("light_gain") is not None:
        sentences.append(phrase("methods.light"))
    return sentences


def _methods_of_white(facts: DiveFacts) -> list[str]:
    """How the white point was found, with its standard error where that is known: the largest of the three channels'."""
    robust = facts.run.config.color.robust
    if robust.white_point == "scene":
        errors = facts.water.standard_errors.get("white") if facts.water else None
        known = facts.water is not None and errors is not None and bool(np.isfinite(errors).all())
        percent = f"{np.max(np.asarray(errors) / facts.water.white):.0%}" if known and facts.water else ""
        said = phrase("methods.white_error", percent=percent) if known else ""
        return [phrase(f"methods.white.{robust.scene_colors}") + said + "."]
    return [phrase("methods.white.none" if robust.white_point == "none" else "methods.white.given") + "."]


def _by_channel(values: Any) -> dict[str, str]:
    return {channel: digits(float(value), 2) for channel, value in zip(CHANNELS, values, strict=True)}


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
    sentences = [phrase("methods.map", **numbers), phrase(f"methods.track.{_kind_of_track(made)}")]
    if made.range_scale != 1:
        sentences.append(phrase("methods.scale", factor=digits(made.range_scale, 4)))
    if "surface_rugosity" in made.site:
        cell = digits(1000 * made.cell_m["dem_m"])
        sentences.append(phrase("methods.map_rugosity", rugosity=f"{made.site['surface_rugosity']:.2f}", cell=cell))
    residuals = [point.position_residual_m for point in made.track if point.position_residual_m is not None]
    if residuals:
        sentences.append(phrase("methods.poses", residual=digits(float(np.median(residuals)), 2)))
    return sentences


def _kind_of_track(made: FinishedMap) -> str:
    given = any(point.position_residual_m is not None for point in made.track)
    return "given" if given else "own"


def citations(facts: DiveFacts) -> list[str]:
    """The works to cite."""
    return [phrase("cite.program", version=facts.run.version), phrase("cite.deepseecolor"), phrase("cite.seathru")]


def changed_settings(config: RunConfig) -> list[Fact]:
    """Settings that differ from the defaults, by their full name."""
    default = flat(RunConfig().model_dump(mode="json"))
    mine = flat(config.model_dump(mode="json"))
    return [Fact(key, json.dumps(value)) for key, value in mine.items() if default.get(key) != value]
