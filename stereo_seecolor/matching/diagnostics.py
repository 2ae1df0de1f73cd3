"""Diagnostics of a pair: images that cannot be matched, and untrustworthy range maps."""

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.matching.census import Census, census
from stereo_seecolor.matching.gray import Gray
from stereo_seecolor.records import Map

Indices = NDArray[np.int64]
FULL_SCALE = 65280
"""Gray of 255 in an 8-bit image."""

# the limits were chosen on the synthetic reef and on real frames that were degraded on purpose
BLACK, SATURATED = 0.02 * FULL_SCALE, 0.985 * FULL_SCALE
"""An image is black if its brightest hundredth is darker, saturated if half of it is brighter."""
TEXTURE = 0.25 * 256
"""Least standard deviation of an image reduced to 1/2 or 1/4: a quarter of an 8-bit level, the
effect of rounding.
"""
BLANK, BLANK_PX, BLANK_LEVEL = 4, 5, 8 * 256
"""A black frame has less contrast than the first (the effect of rounding) in windows of the second
of the reduced image, and is darker than the third, the level of a black frame in JPEG.
"""
RIM_PX = 9
"""The edge of a black frame lies at the same place in both images at any range, so this margin
(half of it less half of BLANK_PX) is left out, too.
"""
WINDOW = (16, 64)
"""Rows and columns of a window in which texture may repeat, pixels of the reduced image."""
REPEATED_SIMILARITY = 0.85
"""Least ratio of the second peak of the autocorrelation to the first at which matches are
ambiguous.
"""
REPEATED, ONE_SIDED = 0.05, 0.01
"""Fractions of the image above which there is a warning."""
EXCESS_PX = 6.0
"""Least excess of a hole in a row over the length of an occlusion for an object that the right
image lacks.
"""
VERTICAL_GAIN = 0.05
"""Fraction by which the cost of shifted rows must be lower than that of unshifted rows; unshifted
rows must have a lower cost than some other shifts.
"""
VERTICAL_SEARCH_PX, VERTICAL_PX = 4, 0.75
"""Largest shift of rows that is tested, and the least that causes a warning."""
DETAIL_PX, COARSE_PX, DETAIL_EVERY = 4, 24, 8
"""Half of the width of the details whose contrast, over that of coarse ones, tells how sharp an
image is; of coarse ones; at which columns and rows.
"""
LEAST_LIGHT = 0.01 * FULL_SCALE
"""Added to what contrast is relative to, since black has none."""


def unusable(left: Gray, right: Gray) -> str | None:
    """Give the reason why a pair, reduced, cannot be matched at all; None if it can."""
    for side, image in (("left", left), ("right", right)):
        half, most = np.percentile(image[::4, ::4], (50, 99))
        if most < BLACK:
            return f"the {side} image is black"
        if half > SATURATED:
            return f"the {side} image is saturated"
        if float(image.std()) < TEXTURE:
            return f"the {side} image is uniform: there is nothing to match"
    if np.array_equal(left, right):
        return "left and right are the same image"
    return None


def blank(image: Gray) -> NDArray[np.bool_]:
    """Mark the pixels of a reduced image that are black and uniform: a frame around the content,
    the corners of a round or an undistorted image, shadows clipped to black. (H, W) bool.
    """
    around = np.ones((BLANK_PX, BLANK_PX), np.uint8)
    most, least = cv2.dilate(image, around), cv2.erode(image, around)
    black = (most < BLANK_LEVEL) & (most - least < BLANK)
    return np.asarray(
        cv2.dilate(
            black.view(np.uint8),
            np.ones((RIM_PX, RIM_PX), np.uint8),
        )
        > 0
    )


def repeated(image: Gray, search_px: int) -> NDArray[np.bool_]:
    """Mark the pixels of a reduced image whose rows repeat within the disparities searched, so that
    any of them would match: (H, W) bool.

    From the autocorrelation of windows: a second peak nearly as high as the first.
    """
    height, width = image.shape
    mask = np.zeros(image.shape, np.bool_)
    rows = min(WINDOW[0], height)
    columns = min(WINDOW[1], width)
    tops = [*range(0, height - rows, rows), height - rows]
    lefts = [*range(0, width - columns, columns // 2), width - columns]
    windows = np.stack(
        [[image[y : y + rows, x : x + columns] for x in lefts] for y in tops]
    ).astype(np.float32)
    windows -= windows.mean(axis=-1, keepdims=True)
    power = (np.abs(np.fft.rfft(windows, 2 * columns)) ** 2).sum(axis=-2)
    lags = np.arange(min(search_px, columns // 2) + 1)
    similarity = np.fft.irfft(power)[..., : lags.size] * (columns / (columns - lags))
    energy = np.maximum(similarity[..., :1], rows * columns * TEXTURE**2)
    past_first_peak = np.maximum.accumulate(similarity < 0.3 * energy, axis=-1)
    again = np.where(past_first_peak, similarity / energy, 0).max(axis=-1) > REPEATED_SIMILARITY
    for i, j in np.argwhere(again):
        mask[tops[i] : tops[i] + rows, lefts[j] : lefts[j] + columns] = True
    return mask


def repetition_warning(repeated: NDArray[np.bool_]) -> str | None:
    """Return a warning if a large part of the image repeats itself, else None."""
    fraction = float(repeated.mean())
    if fraction < REPEATED:
        return None
    return (
        f"the texture repeats over {fraction:.0%} of the left image: many ranges match there, "
        "so none is given"
    )


def one_sided_warning(
    left: Gray, disparity: Map, repeated: NDArray[np.bool_], scale: int
) -> str | None:
    """Return a warning if the left image shows a textured object that the right one lacks (a fish,
    a partly covered lens), else None.

    left, disparity: at reduced size; disparities in pixels of the full size, ``scale`` times this
    one. A hole in a row is an occlusion if it is as long as the jump of disparity across it.
    """
    unmatched = _long_holes(disparity, scale)
    texture = cv2.blur(cv2.absdiff(left, cv2.blur(left, (5, 5))), (5, 5)) > 256
    unmatched &= texture & ~repeated
    fraction = float(
        cv2.morphologyEx(
            cv2.medianBlur(unmatched, 5), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)
        ).mean()
    )
    if fraction < ONE_SIDED:
        return None
    why = (
        "a moving object, a covered lens, or a surface outside matching.min_range_m to "
        "matching.max_range_m"
    )
    return f"{fraction:.1%} of the left image has no match: {why}"


def _long_holes(disparity: Map, scale: int) -> NDArray[np.uint8]:
    """1 in the holes of a row that are longer than the occlusion that their ends make."""
    rows, columns = np.nonzero(np.isfinite(disparity))
    known = disparity[rows, columns]
    length = np.diff(columns) - 1
    occluded = np.maximum(np.diff(known), 0) / np.float32(scale)
    long = (length > 0) & (np.diff(rows) == 0)
    long &= length - occluded > EXCESS_PX
    hole = np.zeros(disparity.shape, np.uint8)
    for row, before, after in zip(
        rows[1:][long], columns[:-1][long], columns[1:][long], strict=True
    ):
        hole[row, before + 1 : after] = 1
    return hole


def rows_are_off(vertical_px: float) -> bool:
    """Tell whether the same point lies on different rows of the two images; False for NaN."""
    return abs(vertical_px) >= VERTICAL_PX


def vertical_disparity_warning(vertical_px: float) -> str | None:
    """Return a warning if the same point lies on different rows of the two images, else None."""
    if not rows_are_off(vertical_px):
        return None
    return (
        f"vertical disparity of {vertical_px:+.1f} px between left and right: the calibration "
        "no longer fits, ranges are biased"
    )


def vertical_disparity_px(left: Gray, right: Gray, disparity: Map) -> float:
    """How many pixels the right image's rows lie below the left ones'; NaN where unknown."""
    most = VERTICAL_SEARCH_PX
    return vertical_px_of(_row_costs(census(left), census(right), disparity, most))


def vertical_px_of(cost: NDArray[np.float64]) -> float:
    """The shift of rows, pixels, with the least cost of -most..most; NaN if none is clear."""
    best, most = int(np.argmin(cost)), len(cost) // 2
    compared = cost.max() if best == most else cost[most]
    if cost[best] >= (1 - VERTICAL_GAIN) * compared:
        return float("nan")
    if not 0 < best < cost.size - 1:
        return float(best - most)
    below, here, above = cost[best - 1 : best + 2]
    return float(best - most + 0.5 * (below - above) / max(max(below, above) - here, 1e-9))


def _row_costs(left: Census, right: Census, disparity: Map, most: int) -> NDArray[np.float64]:
    """Bits by which matched pixels differ, for shifts of rows from -most to most; every 16th pixel
    of every 16th row.
    """
    y, x, met = _matched(disparity, most, 16)
    shifted = right[y + np.arange(-most, most + 1)[:, None], met]
    differing = np.bitwise_count(left[y, x] ^ shifted)
    return np.asarray(differing.sum(axis=1), np.float64)


def _matched(disparity: Map, margin: int, every: int) -> tuple[Indices, Indices, Indices]:
    """(n,) row, column and column in the right image of matched pixels: every so many pixels of
    every so many rows, without a margin above and below.
    """
    height, width = disparity.shape
    rows = np.arange(margin, height - margin, every)  # none in a small image
    y, x = np.meshgrid(rows, np.arange(0, width, every), indexing="ij")
    known = np.isfinite(disparity[y, x])
    y, x = y[known], x[known]
    return y, x, np.clip(x - np.rint(disparity[y, x]).astype(np.int64), 0, width - 1)


def right_sharpness(left: Gray, right: Gray, disparity: Map) -> float:
    """Compute the contrast of details, relative to that of coarse ones, in the right image over
    that in the left one at the same points; NaN where none are matched.

    Medians of the contrast along columns, which disparities do not change. Veil, another tone curve
    and another exposure change the contrast of all details alike: 0.89 to 1.06 on two synthetic
    dives and a real one with one of these on one side, or with a side that sees one color alone.
    With right images blurred by 1, 2, 3 px 0.8, 0.53, 0.37 (synthetic), 0.88, 0.62, 0.43 (real).
    """
    reach, every = COARSE_PX, DETAIL_EVERY
    y, x, met = _matched(disparity, reach, every)
    if not y.size:
        return float("nan")
    of_left, of_right = _sharpness(left, y, x), _sharpness(right, y, met)
    return of_right / of_left if of_left else float("nan")


def _sharpness(image: Gray, y: Indices, x: Indices) -> float:
    """The contrast of details over that of coarse ones; NaN where there are none."""
    coarse = _contrast(image, y, x, COARSE_PX)
    fine = _contrast(image, y, x, DETAIL_PX)
    return fine / coarse if coarse else float("nan")


def _contrast(image: Gray, y: Indices, x: Indices, reach: int) -> float:
    """Median contrast of pixels with those ``reach`` rows above and below."""
    above, here, below = (image[y + step, x].astype(np.float64) for step in (-reach, 0, reach))
    light = above + 2 * here + below + LEAST_LIGHT
    return float(np.median(np.abs(2 * here - above - below) / light))
