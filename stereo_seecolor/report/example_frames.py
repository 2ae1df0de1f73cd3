"""Six example frames of a dive: the extremes of what was measured."""

from collections.abc import Callable

from stereo_seecolor.records import FrameRow
from stereo_seecolor.report.overview import DiveFacts

COUNT = 6


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
    for row in rows[:: max(1, len(rows) // COUNT)]:
        picks.setdefault(row.name, "why.spread")
    return list(picks.items())[:COUNT]


_EXTREMES: tuple[tuple[str, str, Callable[..., FrameRow]], ...] = (
    ("why.nearest", "median_range_m", min),
    ("why.farthest", "median_range_m", max),
    ("why.most_measured", "coverage", max),
    ("why.least_measured", "coverage", min),
    ("why.hardest_color", "unrecoverable_fraction", max),
)
