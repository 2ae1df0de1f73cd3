"""Confidence: the probability that a disparity is right to within one pixel."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.context import Context, enlarged
from stereo_seecolor.records import Map


@dataclass(frozen=True)
class ConfidenceWeights:
    """Logistic regression: log odds = uniqueness * sqrt(min(u, 1)) + support * s + relief * log(r +
    least_relief_px)
    + known * k + roughness * log(q + least_relief_px) + fattening * g + offset.

    Fitted to half of a real reef dive, whose views check each other, and to synthetic cards and
    boulders in clear to hazy water; docs/matching.md shows it on others.
    """

    uniqueness: float = 3.16
    support: float = 0.93
    relief: float = -0.401
    known: float = 1.5
    roughness: float = -0.795
    fattening: float = -2.09
    offset: float = -2.36
    least_relief_px: float = 0.05


WEIGHTS = ConfidenceWeights()
BORDER_PX = 0.5
"""Disparities whose match lies closer than this to the left or right end of the right image are
rejected, pixels: points just outside the image are often matched with its outermost column (nine of
ten of the wrong pixels there, on a synthetic plane).
"""
_LOG_2 = float(np.log(2))
_UNIQUENESS = WEIGHTS.uniqueness / _LOG_2
_SUPPORT = WEIGHTS.support / _LOG_2
_RELIEF = WEIGHTS.relief
_FATTENING, _LEAST_RELIEF = WEIGHTS.fattening / _LOG_2, WEIGHTS.least_relief_px


def surroundings(context: Context, shape: tuple[int, ...]) -> Map:
    """Compute the contribution of the surroundings of each pixel to its log odds (base 2): (H, W)
    float32 for an image of that shape.
    """
    rough = np.log(context.roughness + np.float32(WEIGHTS.least_relief_px))
    odds = (WEIGHTS.known * context.known + WEIGHTS.roughness * rough + WEIGHTS.offset) / _LOG_2
    return enlarged(odds.astype(np.float32), shape)


def least_odds(least: float) -> float:
    """The log odds (base 2) below which no confidence reaches ``least``, less for rounding."""
    return float(np.log2(max(least, 1e-30)) - np.log2(max(1 - least, 1e-30))) - 1e-3


@compiled
def weigh_rows(evidence: tuple[Map, Map, Map, Map], odds: Map) -> None:
    """Write the log odds (base 2) that |disparity error| <= 1 px, without fattening, of all pixels,
    with or without passed checks.

    evidence: uniqueness of the search; support and relief of refine_rows; surroundings.
    """
    uniqueness, support, relief, around = evidence
    one, least_relief = np.float32(1), np.float32(_LEAST_RELIEF)
    per_uniqueness = np.float32(_UNIQUENESS)
    per_support = np.float32(_SUPPORT)
    per_relief = np.float32(_RELIEF)
    for y in range(odds.shape[0]):
        unique_row, support_row, relief_row = uniqueness[y], support[y], relief[y]
        around_row, odds_row = around[y], odds[y]
        for x in range(odds_row.size):
            total = (
                per_uniqueness * np.sqrt(min(unique_row[x], one))
                + per_support * support_row[x]
                + around_row[x]
            )
            odds_row[x] = total + per_relief * _log2(relief_row[x] + least_relief)


@compiled
def judge_rows(least: Any, fattening: Map, disparity: Map, confidence: Map) -> None:
    """Turn the log odds in ``confidence`` into probabilities; set disparities to NaN where the
    confidence is below ``least``, or where they lie at or beyond the border of the right image.
    """
    nearest, farthest = np.float32(BORDER_PX), np.float32(confidence.shape[1] - 1 - BORDER_PX)
    one = np.float32(1)
    unknown = np.float32(np.nan)
    bound = np.float32(least)
    per_fattening = np.float32(_FATTENING)
    for y in range(confidence.shape[0]):
        disparity_row, confidence_row, fat_row = disparity[y], confidence[y], fattening[y]
        for x in range(confidence_row.size):
            chance = one / (one + _exp2(-(confidence_row[x] + per_fattening * fat_row[x])))
            confidence_row[x] = chance
            met = np.float32(x) - disparity_row[x]
            disparity_row[x] = (
                disparity_row[x]
                if (chance >= bound) & (met >= nearest) & (met <= farthest)
                else unknown
            )


@compiled(inline=True)
def _log2(x: Any) -> Any:
    """Within 2e-5, for x > 0 (any number for NaN). The library's is called for one number at a
    time, this goes sixteen at once.
    """
    bits = np.float32(x).view(np.int32)
    m = np.int32((bits & np.int32(0x7FFFFF)) | np.int32(0x3F800000)).view(np.float32) - np.float32(
        1
    )
    curve = np.float32(0.41560596) + m * (np.float32(-0.19357559) + m * np.float32(0.045149))
    curve = m * (np.float32(1.44191704) + m * (np.float32(-0.70909641) + m * curve))
    return np.float32((bits >> np.int32(23)) - np.int32(127)) + curve


@compiled(inline=True)
def _exp2(x: Any) -> Any:
    """Within 5e-6 of its value, for x cut to -100..100."""
    x = min(max(x, np.float32(-100)), np.float32(100))
    whole = np.int32(np.floor(x))
    f = x - np.float32(whole)
    curve = np.float32(0.24154982) + f * (np.float32(0.05174426) + f * np.float32(0.013702))
    scale = np.int32((whole + np.int32(127)) << np.int32(23)).view(np.float32)
    return scale * (np.float32(1) + f * (np.float32(0.69300392) + f * curve))
