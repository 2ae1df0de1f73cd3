"""How likely it is that a disparity is right to within one pixel."""

import numpy as np

from stereo_seecolor.data import Map

STD_WEIGHT, RIVAL_WEIGHT, SUPPORT_WEIGHT, RELIEF_WEIGHT, OFFSET = -3.84, 1.63, 3.50, -0.83, -8.68
"""Logistic regression on synthetic scenes in clear to turbid water (docs/matching.md has its reliability on others)."""
LEAST_RELIEF_PX = 0.05


def confidence(std: Map, rival: Map, support: Map, relief: Map) -> Map:
    """P(|disparity error| <= 1 px) from its standard error, lead over its rival, known neighbours and relief around it."""
    logit = RIVAL_WEIGHT * np.sqrt(np.minimum(rival, 1)) + SUPPORT_WEIGHT * support + OFFSET
    logit += STD_WEIGHT * np.log(std) + RELIEF_WEIGHT * np.log(relief + np.float32(LEAST_RELIEF_PX))
    return np.asarray(1 / (1 + np.exp(-logit)), dtype=np.float32)
