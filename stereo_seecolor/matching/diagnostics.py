"""Diagnostics of a pair: images that cannot be matched, and warnings about range maps that should
not be trusted.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import Rectification
from calibration.field_checks.matches import find_matches
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.errors import MatchingError
from stereo_seecolor.matching.census import PATTERN, census_at, padded
from stereo_seecolor.matching.gray import Gray, sides_without_texture
from stereo_seecolor.records import Map, RangeMap, StereoFrame

FULL_SCALE = 65280
"""Gray of 255 in an 8-bit image."""


@dataclass(frozen=True)
class DiagnosticsConstants:
    """Gray levels are of FULL_SCALE. All were set on the synthetic reef and on real frames spoilt
    on purpose.

    black, saturated: the brightest hundredth of a black image is darker, half of a saturated image
    is brighter.
    texture: least standard deviation of an image reduced to 1/2 or 1/4: a quarter of an 8-bit
    level, which is rounding alone.
    blank, blank_px: a black frame has less contrast than this (rounding alone) in windows of so
    many pixels of the reduced image, and is darker than blank_level, as that of a JPEG may be.
    rim_px: its edge, which lies at the same place in both images whatever the range, is left out
    with it: to half of this less half of blank_px.
    window: rows and columns of a window, pixels of the reduced image, in which texture may repeat
    itself.
    repeated_similarity: second peak of the autocorrelation over the first, from which on any of
    them would match.
    repeated, one_sided: fractions of the image above which there is a warning.
    excess_px: how much longer than an occlusion a hole in a row must be to be something that the
    right image lacks.
    vertical_gain: rows shifted must agree better than unshifted ones by this fraction to count;
    unshifted ones than some others.
    vertical_search_px, vertical_px: shifts of rows that are tried, and the least that is warned of.
    """

    black: float = 0.02 * FULL_SCALE
    saturated: float = 0.985 * FULL_SCALE
    texture: float = 0.25 * 256
    blank: int = 4
    blank_px: int = 5
    rim_px: int = 9
    blank_level: int = 8 * 256
    window: tuple[int, int] = (16, 64)
    repeated_similarity: float = 0.85
    repeated: float = 0.05
    one_sided: float = 0.01
    excess_px: float = 6.0
    vertical_gain: float = 0.05
    vertical_search_px: int = 4
    vertical_px: float = 0.75


DIAGNOSTICS_CONSTANTS = DiagnosticsConstants()


def unusable(left: Gray, right: Gray) -> str | None:
    """Give the reason why a pair, reduced, cannot be matched at all; None if it can."""
    for side, image in (("left", left), ("right", right)):
        half, most = np.percentile(image[::4, ::4], (50, 99))
        if most < DIAGNOSTICS_CONSTANTS.black:
            return f"the {side} image is black"
        if half > DIAGNOSTICS_CONSTANTS.saturated:
            return f"the {side} image is saturated"
        if float(image.std()) < DIAGNOSTICS_CONSTANTS.texture:
            return f"the {side} image is uniform: there is nothing to match"
    if np.array_equal(left, right):
        return "left and right are the same image"
    return None


def blank(image: Gray) -> NDArray[np.bool_]:
    """Mark the pixels of a reduced image that are black and even: a frame around the picture, the
    corners of a round or an undistorted one, shadows cut off at black. (H, W) bool.
    """
    around = np.ones((DIAGNOSTICS_CONSTANTS.blank_px, DIAGNOSTICS_CONSTANTS.blank_px), np.uint8)
    most, least = cv2.dilate(image, around), cv2.erode(image, around)
    black = (most < DIAGNOSTICS_CONSTANTS.blank_level) & (
        most - least < DIAGNOSTICS_CONSTANTS.blank
    )
    return np.asarray(
        cv2.dilate(
            black.view(np.uint8),
            np.ones((DIAGNOSTICS_CONSTANTS.rim_px, DIAGNOSTICS_CONSTANTS.rim_px), np.uint8),
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
    rows, columns = (
        min(DIAGNOSTICS_CONSTANTS.window[0], height),
        min(DIAGNOSTICS_CONSTANTS.window[1], width),
    )
    tops = [*range(0, height - rows, rows), height - rows]
    lefts = [*range(0, width - columns, columns // 2), width - columns]
    windows = np.stack(
        [[image[y : y + rows, x : x + columns] for x in lefts] for y in tops]
    ).astype(np.float32)
    windows -= windows.mean(axis=-1, keepdims=True)
    power = (np.abs(np.fft.rfft(windows, 2 * columns)) ** 2).sum(axis=-2)
    lags = np.arange(min(search_px, columns // 2) + 1)
    similarity = np.fft.irfft(power)[..., : lags.size] * (columns / (columns - lags))
    energy = np.maximum(similarity[..., :1], rows * columns * DIAGNOSTICS_CONSTANTS.texture**2)
    past_first_peak = np.maximum.accumulate(similarity < 0.3 * energy, axis=-1)
    again = (
        np.where(past_first_peak, similarity / energy, 0).max(axis=-1)
        > DIAGNOSTICS_CONSTANTS.repeated_similarity
    )
    for i, j in np.argwhere(again):
        mask[tops[i] : tops[i] + rows, lefts[j] : lefts[j] + columns] = True
    return mask


def repetition_warning(repeated: NDArray[np.bool_]) -> str | None:
    """Warn if a good part of the image repeats itself; None if not."""
    fraction = float(repeated.mean())
    if fraction < DIAGNOSTICS_CONSTANTS.repeated:
        return None
    return (
        f"the texture repeats over {fraction:.0%} of the left image: many ranges match there, "
        "so none is given"
    )


def one_sided_warning(
    left: Gray, disparity: Map, repeated: NDArray[np.bool_], scale: int
) -> str | None:
    """Warn if the left image shows something textured that the right one lacks: a fish, or a lens
    half covered; None if not.

    left, disparity: small, the disparity in pixels of the full size, ``scale`` times this one. A
    hole in a row as long as the disparity jumps up across it is an occlusion; a longer one is not.
    """
    unmatched = np.zeros(disparity.shape, np.uint8)
    _long_holes(disparity, np.float32(scale), DIAGNOSTICS_CONSTANTS.excess_px, unmatched)
    texture = cv2.blur(cv2.absdiff(left, cv2.blur(left, (5, 5))), (5, 5)) > 256
    unmatched &= texture & ~repeated
    fraction = float(
        cv2.morphologyEx(
            cv2.medianBlur(unmatched, 5), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)
        ).mean()
    )
    if fraction < DIAGNOSTICS_CONSTANTS.one_sided:
        return None
    why = (
        "a moving object, a covered lens, or a surface outside matching.min_range_m to "
        "matching.max_range_m"
    )
    return f"{fraction:.1%} of the left image has no match: {why}"


@compiled
def _long_holes(disparity: Map, scale: Any, excess_px: float, hole: NDArray[np.uint8]) -> None:
    """1 in the holes of a row that are longer than the occlusion that the disparities at their ends
    make.
    """
    height, width = disparity.shape
    for y in range(height):
        before = width
        for x in range(width):
            if not np.isfinite(disparity[y, x]):
                continue
            if (
                x - before > 1
                and x - before - 1 - max(disparity[y, x] - disparity[y, before], 0) / scale
                > excess_px
            ):
                hole[y, before + 1 : x] = 1
            before = x


def vertical_disparity_warning(vertical_px: float) -> str | None:
    """Warn if the same point lies on different rows of the two images; None if not."""
    if not abs(vertical_px) >= DIAGNOSTICS_CONSTANTS.vertical_px:
        return None
    return (
        f"vertical disparity of {vertical_px:+.1f} px between left and right: the calibration "
        "no longer fits, ranges are biased"
    )


def vertical_disparity_px(left: Gray, right: Gray, disparity: Map) -> float:
    """Estimate how many pixels the right image's rows lie below the matching left ones; NaN where
    that cannot be estimated.
    """
    most = DIAGNOSTICS_CONSTANTS.vertical_search_px
    return vertical_px_of(_row_costs(padded(left), padded(right), PATTERN, disparity, most))


def vertical_px_of(cost: NDArray[np.float64]) -> float:
    """The shift of rows, pixels, with the least of the costs of shifts -most..most; NaN where none
    stands out.
    """
    best, most = int(np.argmin(cost)), len(cost) // 2
    compared = cost.max() if best == most else cost[most]
    if cost[best] >= (1 - DIAGNOSTICS_CONSTANTS.vertical_gain) * compared:
        return float("nan")
    if not 0 < best < cost.size - 1:
        return float(best - most)
    below, here, above = cost[best - 1 : best + 2]
    return float(best - most + 0.5 * (below - above) / max(max(below, above) - here, 1e-9))


@compiled
def _row_costs(
    left: Gray, right: Gray, pattern: NDArray[np.int64], disparity: Map, most: int
) -> NDArray[np.float64]:
    """Bits by which matched pixels differ, for shifts of rows from -most to most; every 16th pixel
    of every 16th row.
    """
    height, width = disparity.shape
    cost = np.zeros(2 * most + 1, np.float64)
    for y in range(most, height - most, 16):
        for x in range(0, width, 16):
            if not np.isfinite(disparity[y, x]):
                continue
            met = min(max(x - int(np.rint(disparity[y, x])), 0), width - 1)
            here = census_at(left, pattern, y, x)
            for i in range(cost.size):
                different = here ^ census_at(right, pattern, y + i - most, met)
                different -= (different >> np.uint32(1)) & np.uint32(0x55555555)
                different = (different & np.uint32(0x33333333)) + (
                    (different >> np.uint32(2)) & np.uint32(0x33333333)
                )
                different = (different + (different >> np.uint32(4))) & np.uint32(0x0F0F0F0F)
                cost[i] += np.uint32(different * np.uint32(0x01010101)) >> np.uint32(24)
    return cost


# Check that the two images of a pair show the same scene, by how much of them matched and by
# whether they have texture to match.


@dataclass(frozen=True)
class PairCheckConstants:
    """Thresholds of the check.

    least_coverage: below this fraction of the pixels a pair fails; pairs off by one frame reach
    0.01 to 0.02 (synthetic reef).
    swap_coverage: below this fraction it is worth matching the pair the other way round; good pairs
    reach 0.6 and more. swap_tries: so many pairs of a dive are matched the other way round, since
    that costs as much as matching itself.
    least_points, rows_px: so many points in both images whose rows are off by more show one scene
    with a rig that has moved; pairs of two scenes have 4 at most.
    """

    least_coverage: float = 0.05
    swap_coverage: float = 0.35
    swap_tries: int = 3
    least_points: int = 40
    rows_px: float = 1.5


PAIR_CHECK_CONSTANTS = PairCheckConstants()
NO_OVERLAP = "the two images do not show the same thing"
ROWS_OFF = "their rows are off"
"""In the messages of pairs that fail for that, so that their neighbors can be tried."""


def coverage(range_map: RangeMap) -> float:
    """Compute the fraction of the left image's pixels that have a measured range."""
    return float(np.isfinite(range_map.measured_m).mean())


class PairCheck:
    """The check of the pairs of a dive; safe to call from many threads.

    match: the range map of a pair as the cameras gave it. The same function tells whether another
    pairing would fit: ``coverage(match(StereoFrame(name, left, right_of_the_next)))``.
    rectification: of the rig, by which rows that are off are told from another scene.
    """

    def __init__(
        self,
        match: Callable[[StereoFrame], RangeMap],
        rectification: Rectification | None = None,
    ) -> None:
        self._match = match
        self._rectification = rectification
        self._tries_left = PAIR_CHECK_CONSTANTS.swap_tries
        self._swapped_pair: str | None = None
        self._lock = Lock()

    def __call__(self, name: str, range_map: RangeMap, raw: Callable[[], StereoFrame]) -> RangeMap:
        """Return the range map, or one without a known pixel where both images lack the texture to
        be matched (open water, sand).

        Raises MatchingError if the sides look swapped, or if so little matched that the images are
        not of one scene, or one of them alone lacks texture (a covered lens).

        raw: gives the pair as the cameras gave it, which is hardly ever needed and need not stay in
        memory until here.
        """
        matched = coverage(range_map)
        if matched >= PAIR_CHECK_CONSTANTS.swap_coverage:
            return range_map
        if matched == 0 and range_map.warnings:
            raise MatchingError(f"{name}: {'; '.join(range_map.warnings)}")
        too_little = matched < PAIR_CHECK_CONSTANTS.least_coverage
        if too_little and (plain := sides_without_texture(raw())):
            if len(plain) == 1:
                raise MatchingError(
                    f"{name}: {_without_texture(f'the {plain[0]} image shows', matched)}"
                )
            unknown = _without_texture("both images show", matched)
            return RangeMap.unknown(range_map.range_m.shape, unknown)  # what matched may be noise
        self._check_swapped(name, matched, raw)
        if too_little and (rows := self._rows_off(raw)):
            raise MatchingError(f"{name}: only {matched:.1%} of the pixels match: {rows}")
        if too_little:
            raise MatchingError(
                f"{name}: only {matched:.1%} of the pixels match: {NO_OVERLAP} (are they of one "
                "pair?), or all of it lies outside matching.min_range_m to matching.max_range_m"
            )
        return range_map

    def _rows_off(self, raw: Callable[[], StereoFrame]) -> str:
        """That points are found in both images whose rows are off, and what to do; "" where not."""
        if self._rectification is None:
            return ""
        frame = raw()
        found = find_matches(self._rectification, frame.left, frame.right)
        if len(found.left) < PAIR_CHECK_CONSTANTS.least_points:
            return ""
        rows_px = float(np.median(np.abs(found.right[:, 1] - found.left[:, 1])))
        if rows_px < PAIR_CHECK_CONSTANTS.rows_px:
            return ""
        return (
            f"{ROWS_OFF} by {rows_px:.1f} px (median of {len(found.left)} points that both images "
            "show): a camera has moved since the calibration (run --refine mends that), or the "
            "images are not of one moment"
        )

    def _check_swapped(self, name: str, matched: float, raw: Callable[[], StereoFrame]) -> None:
        with self._lock:
            if self._swapped_pair is None and self._tries_left:
                self._tries_left -= 1
                frame = raw()
                other = coverage(self._match(StereoFrame(name, frame.right, frame.left)))
                if other > 3 * matched + 0.1:
                    self._swapped_pair = name
                    numbers = (
                        f"{matched:.0%} of the pixels match as given and {other:.0%} the "
                        "other way round"
                    )
                    raise MatchingError(
                        f"{name}: left and right look swapped: {numbers}: exchange --left and "
                        "--right"
                    )
        if self._swapped_pair is not None:
            raise MatchingError(
                f"{name}: left and right look swapped: {matched:.0%} of the pixels match as "
                f"given, and {self._swapped_pair} "
                "matched better the other way round: exchange --left and --right"
            )


def _without_texture(show: str, matched: float) -> str:
    return (
        f"only {matched:.1%} of the pixels match: {show} too little texture to match (open water, "
        "even sand, turbid water, a dark frame): no range is known"
    )
