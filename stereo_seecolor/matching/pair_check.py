"""Checks that the images of a pair show the same scene, by matched fraction and texture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration import Rectification
from calibration.verification.matches import find_matches
from calibration.verification.mistake_table import EXCHANGE, EXCHANGED
from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.errors import MatchingError
from stereo_seecolor.matching.image_texture import sides_without_texture
from stereo_seecolor.records import RangeMap, StereoFrame


@dataclass(frozen=True)
class PairCheckConstants:
    """Thresholds of the check.

    least_coverage: below this fraction of the pixels a pair fails; pairs off by one frame reach
    0.01 to 0.02 (synthetic reef).
    swap_coverage: below this fraction the pair is matched with left and right exchanged; good pairs
    reach 0.6 and more. swap_tries: largest number of pairs of a dive for this test, which takes as
    long as matching.
    least_points, rows_px: least number of matched points with a vertical disparity above rows_px
    for which a pair counts as one scene with a rig that has moved; pairs of two scenes have at most
    4.
    """

    least_coverage: float = 0.05
    swap_coverage: float = 0.35
    swap_tries: int = 3
    least_points: int = 40
    rows_px: float = 1.5


PAIR_CHECK_CONSTANTS = PairCheckConstants()
NO_OVERLAP = "the two images do not show the same scene"
ROWS_OFF = "their rows are off"
"""Part of the messages of pairs that fail for this reason; a run then tests their neighbors."""


def coverage(range_map: RangeMap) -> float:
    """The fraction of the pixels of the left image with a measured range, 0..1."""
    return float(np.isfinite(range_map.measured_m).mean())


class PairCheck:
    """The check of the pairs of a dive; safe to call from many threads.

    match: computes the range map of a raw pair, also to test another pairing:
    ``coverage(match(StereoFrame(name, left, right_of_the_next)))``.
    rectification: of the rig; it distinguishes a wrong calibration from another scene. refines:
    whether the settings ask for a rig that is refined on the dive.
    """

    def __init__(
        self,
        match: Callable[[StereoFrame], RangeMap],
        rectification: Rectification | None = None,
        refines: bool = False,
    ) -> None:
        self._match = match
        self._rectification = rectification
        self._cure = "" if refines else " (run --refine corrects this)"
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
            f"show): a camera has moved since the calibration{self._cure}, or the images were not "
            "exposed at the same moment"
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
                    raise MatchingError(f"{name}: {EXCHANGED}: {numbers}: {EXCHANGE}")
        if self._swapped_pair is not None:
            raise MatchingError(
                f"{name}: {EXCHANGED}: {matched:.0%} of the pixels match as given, and "
                f"{self._swapped_pair} matched better the other way round: {EXCHANGE}"
            )


def _without_texture(show: str, matched: float) -> str:
    return (
        f"only {matched:.1%} of the pixels match: {show} too little texture to match (open water, "
        "even sand, turbid water, a dark frame): no range is known"
    )
