"""The page's verdict on a dive: whether it is good, and what to examine before its use."""

import re
from dataclasses import dataclass

from stereo_seecolor.color.white_point import DOUBT
from stereo_seecolor.mapping.raster.gaps import MISSING_FRACTION
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.report.facts import DiveFacts, RowFacts
from stereo_seecolor.report.texts import phrase


@dataclass(frozen=True)
class VerdictLimits:
    """Limits beyond which the page tells the user to examine the results."""

    # single frames of a good dive have warnings: turbid water, a fish before the lens
    warned_fraction: float = 0.1
    # less of a frame that moves, a fish or a soft coral, is left out and changes nothing else
    unmatched_fraction: float = 0.05
    coverage: float = 0.6  # a textured reef is measured to 80-95 %; sand or blur leave less
    unrecoverable_fraction: float = 0.1  # more of a frame without one of its colors is seen by eye
    placed_fraction: float = 0.95  # a frame in twenty may point into the blue
    length_std: float = 0.01  # relative: areas are then uncertain by 2 %, volumes by 3 %


LIMITS = VerdictLimits()


@dataclass(frozen=True)
class Verdict:
    """A verdict. good: nothing needs to be examined. line: the verdict in a sentence. reasons: what
    to examine, a sentence each.
    """

    good: bool
    line: str
    reasons: tuple[str, ...]


def judge_so_far(facts: RowFacts) -> Verdict:
    """The verdict on the pairs that a run has processed so far."""
    reasons = (*_of_pairs(facts), *_of_pixels(facts))
    return Verdict(
        not reasons, phrase("verdict.look_so_far" if reasons else "verdict.good_so_far"), reasons
    )


def judge(facts: DiveFacts) -> Verdict:
    """The verdict on a finished run."""
    reasons = (
        *_of_shards(facts),
        *_of_pairs(facts),
        *_of_pixels(facts),
        *_of_white(facts),
        *_of_scale(facts),
        *_of_map(facts),
    )
    if not facts.run.frames:
        return Verdict(False, phrase("verdict.nothing"), reasons)
    return Verdict(not reasons, phrase("verdict.look" if reasons else "verdict.good"), reasons)


def _of_shards(facts: DiveFacts) -> list[str]:
    missing = facts.run.totals.get("missing_shards", [])
    return [phrase("verdict.shards", shards=", ".join(missing))] if missing else []


def _of_pairs(facts: RowFacts) -> list[str]:
    reasons = []
    for status in ("failed", "pending", "unpaired"):
        if count := facts.count(status):
            reasons.append(phrase(f"verdict.{status}", count=count, pairs=len(facts.pairs)))
    warned = sum(any(map(_matters, row.warnings)) for row in facts.pairs)
    if warned > LIMITS.warned_fraction * len(facts.pairs):
        reasons.append(phrase("verdict.warned", count=warned, pairs=len(facts.pairs)))
    return reasons


def _matters(warning: str) -> bool:
    """Whether a frame's warning says more than that something small moved in it."""
    if warning.startswith(DOUBT):  # of the white point: the verdict has a reason of its own
        return False
    small = re.match(r"([\d.]+)% of the left image has no match", warning)
    return small is None or float(small[1]) >= 100 * LIMITS.unmatched_fraction


def _of_pixels(facts: RowFacts) -> list[str]:
    reasons = []
    coverage, lost = facts.typical("coverage"), facts.typical("unrecoverable_fraction")
    if coverage is not None and coverage < LIMITS.coverage:
        reasons.append(phrase("verdict.coverage", percent=f"{coverage:.0%}"))
    if lost is not None and lost > LIMITS.unrecoverable_fraction:
        reasons.append(phrase("verdict.unrecoverable", percent=f"{lost:.0%}"))
    return reasons


def _of_white(facts: RowFacts) -> list[str]:
    """The doubt of the white point of most frames, as in frames.csv."""
    doubts = [one for row in facts.pairs for one in row.warnings if one.startswith(DOUBT)]
    named = [f"{doubt[0].upper()}{doubt[1:]}." for doubt in doubts]
    return named[:1] if len(named) > len(facts.pairs) / 2 else []


def _of_scale(facts: DiveFacts) -> list[str]:
    """An uncertain scale makes all lengths, areas and volumes of a dive wrong alike."""
    std = calibration_std(facts.run).total if facts.run.geometry else 0.0
    return [phrase("verdict.scale", percent=f"{std:.1%}")] if std > LIMITS.length_std else []


def _of_map(facts: DiveFacts) -> list[str]:
    if facts.map is None:
        return []
    reasons = []
    placed, frames = len(facts.map.track), len(facts.run.frames)
    if placed < LIMITS.placed_fraction * frames:
        reasons.append(phrase("verdict.placed", placed=placed, frames=frames))
    if facts.map.pieces:
        reasons.append(phrase("verdict.pieces", pieces=facts.map.pieces + 1))
    if (missing := facts.map.missing_fraction) > MISSING_FRACTION:
        reasons.append(phrase("verdict.missing", percent=f"{missing:.0%}"))
    return reasons
