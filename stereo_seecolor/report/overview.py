"""The overview of the dive on the page: facts, example frames, settings; values of the template."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import flat
from stereo_seecolor.mapping.raster.structure import StructureAtScale
from stereo_seecolor.records import FrameRow
from stereo_seecolor.report.facts import DiveFacts
from stereo_seecolor.report.texts import digits, duration, length, phrase

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
    rugosity = rugosity_texts(facts.structure, length) if facts.structure else {}
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


def rugosity_texts(
    structure: StructureAtScale, length_text: Callable[[float], str]
) -> dict[str, str]:
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


def changed_settings(config: RunConfig) -> list[Fact]:
    """Settings that differ from the defaults, by their full name."""
    default = flat(RunConfig().model_dump(mode="json"))
    mine = flat(config.model_dump(mode="json"))
    return [
        Fact(key, json.dumps(value)) for key, value in mine.items() if default.get(key) != value
    ]
