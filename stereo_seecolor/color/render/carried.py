"""Interpolated ranges for unmeasured pixels, for color only, from neighbors of the same color.

    range = S(w z + e r) / S(w + e),   w = z^2 where the range z is measured, 0 elsewhere

S smooths along surfaces of one color and stops at edges (fast global smoother; Min et al. 2014,
doi:10.1109/TIP.2014.2366600). It is applied three times, from long to short reach: r is the result
of the reach before, so that the nearest measured ranges have the most weight. Occluded surfaces lie
behind, so farther neighbors have more weight; the few ranges far from all others, which are wrong
matches, are left out. Water changes color slowly with range: a quarter of the resolution suffices.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Image, Map, Mask


@dataclass(frozen=True)
class Smoother:
    """step_px: the resolution, in pixels of the image. reaches: smoothness, far to near; on one
    color 1000 reaches over some 30 steps, 10 over some 3, and 1 over one; each with its passes over
    rows and columns. An additional 100, or a single pass of 1000, makes bands in open water.

    color_sigma: difference of 8-bit values that counts as an edge: three times a camera's noise.
    farther: weight of the result of the reach before, relative to the mean weight of measured
    ranges; before the first reach it is the median range of the frame.
    strays: fraction of the ranges of a frame, nearest and farthest each, that are not used: a dozen
    wrong pixels at four times the range of a real reef made a spot of 80x90 pixels red.
    """

    step_px: int = 4
    reaches: tuple[tuple[float, int], ...] = ((1000.0, 2), (10.0, 1), (1.0, 1))
    color_sigma: float = 5.0
    farther: float = 0.01
    strays: float = 0.002


SAMPLE = 2
"""Quantiles use every second row and column of the small maps, which takes a quarter of the time.
"""


def carry_ranges(
    image: Image, range_m: Map, seen: Mask | None = None, smoother: Smoother | None = None
) -> Map:
    """Fill the unknown pixels of a range map.

    Args:
        image: (H, W, 3) RGB, uint8 or uint16.
        range_m: (H, W) float32, meters along the ray, NaN = unknown.
        seen: (H, W) bool, True where the image contains image data; elsewhere the range stays
            unknown. None = everywhere.
        smoother: Settings of the smoother; None = the defaults.

    Returns:
        (H, W) float32, meters; ``range_m`` itself if no range is known or none is missing.
    """
    smoother = smoother or Smoother()
    known = np.isfinite(range_m)
    missing = ~known if seen is None else ~known & seen
    if not missing.any() or not known.any():
        return range_m
    height, width = range_m.shape
    small = _smoothed(image, range_m, known, smoother)
    carried = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.copyTo(carried, missing.view(np.uint8), range_m.copy()))


def _smoothed(image: Image, range_m: Map, known: Mask, smoother: Smoother) -> NDArray[np.float32]:
    """Measured and carried ranges at the smoother's resolution."""
    step = smoother.step_px
    height, width = range_m.shape
    fx, fy = max(1 / step, 1 / width), max(1 / step, 1 / height)  # one pixel at least
    guide = cv2.resize(image, None, fx=fx, fy=fy, interpolation=cv2.INTER_AREA)
    guide = guide if guide.dtype == np.uint8 else cv2.convertScaleAbs(guide, alpha=1 / 257)
    size = guide.shape[1::-1]
    mask = known.view(np.uint8)
    total = cv2.resize(cv2.copyTo(range_m, mask), size, interpolation=cv2.INTER_AREA)
    density = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    mean_m = np.divide(total, density, out=np.zeros_like(total), where=density > 0)
    sample_m = mean_m[::SAMPLE, ::SAMPLE][density[::SAMPLE, ::SAMPLE] > 0]
    near_m, far_m = (
        np.quantile(sample_m, [smoother.strays, 1 - smoother.strays])
        if sample_m.size
        else (0.0, np.inf)
    )
    weight = density * mean_m**2 * ((mean_m >= near_m) & (mean_m <= far_m))
    farther = smoother.farther * float(weight.sum() / np.count_nonzero(density))
    carried = np.median(mean_m[density > 0])
    for reach, passes in smoother.reaches:
        smooth = cv2.ximgproc.createFastGlobalSmootherFilter(
            guide, reach, smoother.color_sigma, num_iter=passes
        )
        carried = smooth.filter(weight * mean_m + farther * carried) / smooth.filter(
            weight + farther
        )
    nearest_m, farthest_m, *_ = cv2.minMaxLoc(range_m, mask)
    return np.asarray(np.clip(carried, max(near_m, nearest_m), min(far_m, farthest_m)), np.float32)
