"""What surrounds each pixel in matched disparities: evidence for confidence and fattened edges."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from stereo_seecolor.matching.disparity import MatchedDisparity
from stereo_seecolor.matching.gray import Gray
from stereo_seecolor.records import Map

# chosen on synthetic scenes and on half of a real dive
EVERY = 4
"""Pixels from one sample to the next; denser samples do not improve the confidence."""
NEIGHBORHOOD = 7
"""Side of the neighborhood, samples: 28 pixels, the size of a branching coral, not of a branch."""
ROUGHEST_PX = 4.0
"""Larger deviations are edges or mismatches; they count as this."""


@dataclass(frozen=True, eq=False)
class Context:
    """Maps (h, w) of samples, each in the middle of 4 x 4 pixels.

    known: fraction of the neighborhood that passed the checks.
    roughness: mean |disparity - mean of 3 x 3| of the samples in the neighborhood, pixels.
    disparity: pixels, with or without passed checks, inf where there is none. farthest: the minimum
    over 5 x 5 samples.
    levels: gray, 0..255.
    """

    known: Map
    roughness: Map
    disparity: Map
    farthest: Map
    levels: Map

    @classmethod
    def of(cls, matched: MatchedDisparity, left: Gray) -> "Context":
        """Sample the matched disparities of the left image."""
        best = _samples(matched.best)
        checked = np.isfinite(_samples(matched.disparity)).astype(np.float32)
        disparity = np.where(np.isnan(best), np.float32(np.inf), best)
        window = (NEIGHBORHOOD,) * 2
        farthest = cv2.erode(disparity, np.ones((5, 5), np.uint8), borderValue=np.inf)
        levels = _samples(left).astype(np.float32) / 256
        return cls(cv2.blur(checked, window), _roughness(best), disparity, farthest, levels)


def enlarged(samples: Map, shape: tuple[int, ...]) -> Map:
    """Interpolate samples (h, w) for each pixel of an image of that shape: (H, W) float32."""
    height, width = samples.shape
    whole = cv2.resize(
        samples,
        (width * EVERY, height * EVERY),
        interpolation=cv2.INTER_LINEAR,
    )
    below, beyond = (max(0, side - have) for side, have in zip(shape, whole.shape, strict=True))
    whole = (
        cv2.copyMakeBorder(whole, 0, below, 0, beyond, cv2.BORDER_REPLICATE)
        if below or beyond
        else whole
    )
    return np.asarray(whole[: shape[0], : shape[1]], np.float32)


def _samples(image: Any) -> Any:
    first = EVERY // 2
    return np.ascontiguousarray(image[first::EVERY, first::EVERY])


def _roughness(best: Map) -> Map:
    there = np.isfinite(best).astype(np.float32)
    known = np.nan_to_num(best)
    mean = cv2.blur(known, (3, 3)) / np.maximum(cv2.blur(there, (3, 3)), np.float32(0.1))
    departure = np.minimum(np.abs(known - mean), np.float32(ROUGHEST_PX)) * there
    window = (NEIGHBORHOOD,) * 2
    return np.asarray(
        cv2.blur(departure, window) / np.maximum(cv2.blur(there, window), np.float32(0.01))
    )
