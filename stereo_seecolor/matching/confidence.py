"""How likely it is that a disparity is right to within one pixel."""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Map

RIVAL_WEIGHT, SUPPORT_WEIGHT, RELIEF_WEIGHT, OFFSET = 1.77, 6.94, -0.513, -6.33
"""Logistic regression on synthetic reefs and card scenes in clear to turbid water (docs/matching.md: reliability on others)."""
LEAST_RELIEF_PX = 0.05


@compiled
def trust_rows(least: float, rival: Map, support: Map, relief: Map, disparity: Map, sure: Map) -> None:
    """sure = P(|disparity error| <= 1 px) from its lead over its rival, known neighbors and relief; NaN where under ``least``."""
    one, unknown, least_relief, least_sure = np.float32(1), np.float32(np.nan), np.float32(LEAST_RELIEF_PX), np.float32(least)
    per_rival, per_support = np.float32(RIVAL_WEIGHT / np.log(2)), np.float32(SUPPORT_WEIGHT / np.log(2))
    per_relief, offset = np.float32(RELIEF_WEIGHT), np.float32(OFFSET / np.log(2))
    for y in range(sure.shape[0]):
        rival_row, support_row, relief_row, disparity_row, sure_row = rival[y], support[y], relief[y], disparity[y], sure[y]
        for x in range(sure_row.size):
            odds = per_rival * np.sqrt(min(rival_row[x], one)) + per_support * support_row[x] + offset
            odds += per_relief * _log2(relief_row[x] + least_relief)
            chance = one / (one + _exp2(-odds))
            sure_row[x] = chance
            disparity_row[x] = disparity_row[x] if chance >= least_sure else unknown


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
