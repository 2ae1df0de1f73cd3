"""How likely it is that a disparity is right to within one pixel."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Map


@dataclass(frozen=True)
class ConfidenceWeights:
    """Logistic regression: log odds = uniqueness * sqrt(min(u, 1)) + support * s + relief * log(r + least_relief_px) + offset.

    Fitted to drawn reefs and scenes of cards in clear to turbid water; docs/matching.md shows it on others and on real images.
    """

    uniqueness: float = 1.77
    support: float = 6.94
    relief: float = -0.513
    offset: float = -6.33
    least_relief_px: float = 0.05


WEIGHTS = ConfidenceWeights()
_LOG_2 = float(np.log(2))
_UNIQUENESS, _SUPPORT, _RELIEF = WEIGHTS.uniqueness / _LOG_2, WEIGHTS.support / _LOG_2, WEIGHTS.relief
_OFFSET, _LEAST_RELIEF = WEIGHTS.offset / _LOG_2, WEIGHTS.least_relief_px


@compiled
def judge_rows(least: float, uniqueness: Map, support: Map, relief: Map, disparity: Map, confidence: Map) -> None:
    """Fill the confidence that |disparity error| <= 1 px, of pixels known or not; make disparities NaN where it is under ``least``.

    uniqueness: as the search gave it. support: fraction of known neighbors. relief: pixels (refine_rows).
    """
    one, unknown, least_relief, bound = np.float32(1), np.float32(np.nan), np.float32(_LEAST_RELIEF), np.float32(least)
    per_uniqueness, per_support = np.float32(_UNIQUENESS), np.float32(_SUPPORT)
    per_relief, offset = np.float32(_RELIEF), np.float32(_OFFSET)
    for y in range(confidence.shape[0]):
        unique_row, support_row, relief_row = uniqueness[y], support[y], relief[y]
        disparity_row, confidence_row = disparity[y], confidence[y]
        for x in range(confidence_row.size):
            odds = per_uniqueness * np.sqrt(min(unique_row[x], one)) + per_support * support_row[x] + offset
            odds += per_relief * _log2(relief_row[x] + least_relief)
            chance = one / (one + _exp2(-odds))
            confidence_row[x] = chance
            disparity_row[x] = disparity_row[x] if chance >= bound else unknown


@compiled(inline=True)
def _log2(x: Any) -> Any:
    """Within 2e-5, for x > 0 (any number for NaN). The library's is called for one number at a time, this goes sixteen at once."""
    bits = np.float32(x).view(np.int32)
    m = np.int32((bits & np.int32(0x7FFFFF)) | np.int32(0x3F800000)).view(np.float32) - np.float32(1)
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
