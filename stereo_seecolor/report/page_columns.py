"""Columns of numbers, one value for each frame, for the page's strip, filters and plots."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from stereo_seecolor.report.facts import DiveFacts
from stereo_seecolor.run_folder.finished_map import TrackPoint

Column = list[float | None]
DIGITS = 5
"""Significant digits of a plotted number: a screen shows three."""


def columns(facts: DiveFacts) -> dict[str, Any]:
    """Names, status and kinds of problems of all rows of frames.csv, in their order."""
    problems = facts.problems
    of_frame: dict[str, list[int]] = {}
    for number, problem in enumerate(problems):
        for name in problem.names:
            of_frame.setdefault(name, []).append(number)
    return {
        "names": [row.name for row in facts.rows],
        "status": [row.status for row in facts.rows],
        "errors": {str(i): row.error for i, row in enumerate(facts.rows) if row.error},
        "problems": [problem.what for problem in problems],
        "problems_of": {
            str(i): of_frame[row.name] for i, row in enumerate(facts.rows) if row.name in of_frame
        },
    }


def plots(facts: DiveFacts) -> dict[str, dict[str, Column]]:
    """Plot -> curve -> a number or None for each row; plots of one number or none are left out."""
    known = sorted({key for row in facts.rows for key in row.facts})
    made = {key: {"": [row.facts.get(key) for row in facts.rows]} for key in known}
    made |= _water(facts) | _track(facts)
    stages = dict.fromkeys(stage for row in facts.rows for stage in row.seconds)
    made["seconds"] = {stage: [row.seconds.get(stage) for row in facts.rows] for stage in stages}
    rounded = {
        plot: {name: _rounded(column) for name, column in curves.items()}
        for plot, curves in made.items()
    }
    return {
        plot: curves
        for plot, curves in rounded.items()
        if any(len({*column} - {None}) > 1 for column in curves.values())
    }


def _rounded(column: Iterable[float | None]) -> Column:
    return [
        float(f"{value:.{DIGITS}g}") if value is not None and math.isfinite(value) else None
        for value in column
    ]


def _water(facts: DiveFacts) -> dict[str, dict[str, Column]]:
    """Each frame's water at 1 m, and the attenuation's error; empty if frames share one."""
    if facts.water is not None or not facts.waters:
        return {}
    near = np.array(1.0)
    unknown = np.full(3, np.nan)
    of_frame = {
        name: (
            -np.log(water.attenuation(near)),
            water.backscatter(near),
            water.standard_errors.get("y", unknown),
        )
        for name, water in facts.waters.items()
    }
    made: dict[str, dict[str, Column]] = {}
    plots = ("water_attenuation", "water_backscatter", "water_attenuation_std")
    for kind, plot in enumerate(plots):
        made[plot] = {
            channel: [
                float(of_frame[row.name][kind][c]) if row.name in of_frame else None
                for row in facts.rows
            ]
            for c, channel in enumerate(("red", "green", "blue"))
        }
    return made


def _track(facts: DiveFacts) -> dict[str, dict[str, Column]]:
    if facts.map is None:
        return {}
    track = facts.map.track
    of_frame = {
        "speed_m_s": _speeds(track),
        "height_m": {point.name: point.z_m for point in track},
        "position_residual_m": {point.name: point.position_residual_m for point in track},
    }
    return {
        plot: {"": [values.get(row.name) for row in facts.rows]}
        for plot, values in of_frame.items()
    }


def _speeds(track: Sequence[TrackPoint]) -> Mapping[str, float | None]:
    """Frame -> speed from the frame before it, m/s; None without rising times, and at first."""
    speeds: dict[str, float | None] = {}
    for a, b in pairwise(track):
        seconds = 0.0
        if a.timestamp_s is not None and b.timestamp_s is not None:
            seconds = b.timestamp_s - a.timestamp_s
        distance_m = math.dist((a.x_m, a.y_m, a.z_m), (b.x_m, b.y_m, b.z_m))
        speeds[b.name] = distance_m / seconds if seconds > 0 else None
    return speeds
