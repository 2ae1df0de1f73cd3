"""The surroundings of a pixel, sampled every few pixels: how much of them is known, and how rough they are."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from stereo_seecolor.matching.disparity import MatchedDisparity
from stereo_seecolor.matching.gray import Gray
from stereo_seecolor.records import Map


@dataclass(frozen=True)
class ContextConstants:
    """Found on synthetic scenes and on half of a real dive.

    every: pixels from one sample to the next; samples of every pixel say no more.
    window: side of the neighborhood that is judged as a whole, samples: 28 pixels, a branching coral rather than a branch.
    roughest_px: departures beyond this are edges or mismatches, and count alike.
    """

    every: int = 4
    window: int = 7
    roughest_px: float = 4.0


CONSTANTS = ContextConstants()


@dataclass(frozen=True, eq=False)
class Context:
    """Maps (h, w) of samples, each in the middle of 4 x 4 pixels.

    known: fraction of the neighborhood that passed the checks.
    roughness: mean |disparity - mean of 3 x 3| of the samples in the neighborhood, pixels.
    disparity: pixels, checked or not, inf where nothing was found. farthest: the least of these among 5 x 5 samples.
    levels: gray, 0..255.
    """

    known: Map
    roughness: Map
    disparity: Map
    farthest: Map
    levels: Map

    @classmethod
    def of(cls, found: MatchedDisparity, left: Gray) -> "Context":
        """Sample the matched disparities of the left image."""
        best, checked = _samples(found.best), np.isfinite(_samples(found.disparity)).astype(np.float32)
        disparity = np.where(np.isnan(best), np.float32(np.inf), best)
        window = CONSTANTS.window, CONSTANTS.window
        farthest = cv2.erode(disparity, np.ones((5, 5), np.uint8), borderValue=np.inf)
        levels = _samples(left).astype(np.float32) / 256
        return cls(cv2.blur(checked, window), _roughness(best), disparity, farthest, levels)


def enlarged(samples: Map, shape: tuple[int, ...]) -> Map:
    """Interpolate samples (h, w) for each pixel of an image of that shape: (H, W) float32."""
    height, width = samples.shape
    whole = cv2.resize(samples, (width * CONSTANTS.every, height * CONSTANTS.every), interpolation=cv2.INTER_LINEAR)
    below, beyond = (max(0, side - have) for side, have in zip(shape, whole.shape, strict=True))
    whole = cv2.copyMakeBorder(whole, 0, below, 0, beyond, cv2.BORDER_REPLICATE) if below or beyond else whole
    return np.asarray(whole[: shape[0], : shape[1]], np.float32)


def _samples(image: Any) -> Any:
    first = CONSTANTS.every // 2
    return np.ascontiguousarray(image[first :: CONSTANTS.every, first :: CONSTANTS.every])


def _roughness(best: Map) -> Map:
    there = np.isfinite(best).astype(np.float32)
    known = np.nan_to_num(best)
    mean = cv2.blur(known, (3, 3)) / np.maximum(cv2.blur(there, (3, 3)), np.float32(0.1))
    departure = np.minimum(np.abs(known - mean), np.float32(CONSTANTS.roughest_px)) * there
    window = CONSTANTS.window, CONSTANTS.window
    return np.asarray(cv2.blur(departure, window) / np.maximum(cv2.blur(there, window), np.float32(0.01)))
