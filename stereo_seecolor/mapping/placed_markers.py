"""Markers in the map: position, agreement of the observations, and size against the given one."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median_low

import numpy as np

from calibration.transforms import transform_points
from stereo_seecolor.mapping.marker_placing import PlacedSighting
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class MarkerSettings:
    """When a size disagrees."""

    wrong_size: float = 0.02  # off by more than this fraction, and by more than
    # standard errors: no rig's scale is off so far, so it is the size that was given
    wrong_sigmas: float = 5.0
    fewest_views: int = 2  # a marker seen once may be none
    same_mistake: float = 0.015  # of a length: as well as tape and rig agree


MARKER_SETTINGS = MarkerSettings()


@dataclass(frozen=True, eq=False)
class PlacedMarker:
    """A marker in the map.

    number: of the marker. views: frames behind it. x_m, y_m, z_m: its middle in the map's world.
    residual_m: RMS distance of the middles of its observations, through the track, from that.
    edge_m: mean length of its sides, with its standard error.
    """

    number: int
    views: int
    x_m: float
    y_m: float
    z_m: float
    residual_m: float
    edge_m: float
    edge_std_m: float

    @property
    def place_m(self) -> Array:
        """The middle of the marker: (3,)."""
        return np.array([self.x_m, self.y_m, self.z_m])

    @property
    def std_m(self) -> float:
        """The standard error of its middle."""
        return float(self.residual_m / np.sqrt(self.views))


@dataclass(frozen=True)
class ScaleCheck:
    """Lengths measured over lengths given: 1 where the rig's scale is right, with its standard
    error. wrong: it cannot be. cells: across a marker with its border, where its size was given.
    odd: numbers of markers of another size than most, left out.
    """

    ratio: float
    std: float
    lengths: int
    cells: int = 0
    odd: tuple[int, ...] = ()

    @property
    def wrong(self) -> bool:
        """Tell whether the scale is further off than any rig's can be, or sizes differ."""
        off = abs(self.ratio - 1)
        return bool(self.odd) or (
            off > MARKER_SETTINGS.wrong_size and off > MARKER_SETTINGS.wrong_sigmas * self.std
        )

    def cause(self, others: Iterable["ScaleCheck"]) -> str:
        """What of all usual mistakes explains a wrong length. others: the checks of all known
        lengths: where these differ, the scale of the rig is not the cause.
        """
        if self.odd:
            return (
                f"of another size than most: {', '.join(map(str, self.odd))}, left out here: give "
                "the distances between markers as bars instead"
            )
        mistakes = dict(UNITS)
        if self.cells:
            mistakes |= {
                "with the white margin": 1 + 2 / self.cells,
                "without the black border": 1 - 2 / self.cells,
            }
        same = max(MARKER_SETTINGS.same_mistake, 3 * self.std)
        likely = [of for of, times in mistakes.items() if abs(times * self.ratio - 1) < same]
        if likely:
            return f"as if given {', or '.join(likely)}"
        off = f"given {100 * (1 / self.ratio - 1):+.1f} % off what was measured"
        if any(abs(one.ratio / self.ratio - 1) > same + 3 * one.std for one in others):
            return f"{off}: this length is wrong, since others differ by another factor"
        return (
            f"{off}, more than rigs usually are: the given lengths or the scale of the calibration "
            "(baseline, square size, calibrated in air) are wrong, and the images do not show "
            "which: measure another length"
        )


UNITS = {
    "in millimeters": 1000.0, "in centimeters": 100.0, "in inches": 1 / 0.0254,
    "in feet": 1 / 0.3048,
}  # fmt: skip


def doubled(observations: Iterable[PlacedSighting]) -> set[int]:
    """Numbers of which one frame shows two markers, further apart than one is large."""
    by_frame: dict[tuple[str, int], list[PlacedSighting]] = defaultdict(list)
    for one in observations:
        by_frame[one.frame, one.number].append(one)
    return {
        number
        for (_, number), own in by_frame.items()
        for other in own[1:]
        if np.linalg.norm((other.corners_m - own[0].corners_m).mean(axis=0)) > own[0].edges_m.mean()
    }


def two_of_a_number(numbers: Iterable[int]) -> str:
    """The line for numbers that two markers have."""
    which = ", ".join(map(str, numbers))
    return f"one frame shows two markers of each of these numbers: {which}: left out"


def placed_markers(
    observations: Sequence[PlacedSighting], T_world_camera: dict[str, Array]
) -> list[PlacedMarker]:
    """Markers from all observations in frames with a pose (4, 4), by number; two views each."""
    by_number: dict[int, list[PlacedSighting]] = defaultdict(list)
    for observation in observations:
        if observation.frame in T_world_camera:
            by_number[observation.number].append(observation)
    return [
        _marker(number, own, T_world_camera)
        for number, own in sorted(by_number.items())
        if len(own) >= MARKER_SETTINGS.fewest_views
    ]


def _marker(number: int, observations: list[PlacedSighting], T: dict[str, Array]) -> PlacedMarker:
    middles = np.array(
        [transform_points(T[each.frame], each.corners_m).mean(axis=0) for each in observations]
    )
    place = np.median(middles, axis=0)
    edges = np.array([each.edges_m.mean() for each in observations])
    residual = float(np.sqrt(((middles - place) ** 2).sum(axis=1).mean()))
    std = float(edges.std(ddof=1) / np.sqrt(len(edges)))
    x_m, y_m, z_m = (float(value) for value in place)
    return PlacedMarker(
        number, len(observations), x_m, y_m, z_m, residual, float(edges.mean()), std
    )


def size_check(markers: Sequence[PlacedMarker], edge_m: float, cells: int) -> ScaleCheck | None:
    """The markers' edges against the length that all of them have; None without markers. cells:
    across a marker, with its black border.
    """
    if not markers:
        return None
    odd = _odd_sizes(markers)
    alike = [marker for marker in markers if marker.number not in odd]
    weights = np.array([marker.views for marker in alike], np.float64)
    ratios = np.array([marker.edge_m for marker in alike]) / edge_m
    stds = np.array([marker.edge_std_m for marker in alike]) / edge_m
    share = weights / weights.sum()
    std = float(np.sqrt((share**2) @ (stds**2)))
    return ScaleCheck(float(share @ ratios), std, len(alike), cells, odd)


def _odd_sizes(markers: Sequence[PlacedMarker]) -> tuple[int, ...]:
    """Numbers of markers whose edges differ from the median one by more than their errors."""
    median_m = median_low(marker.edge_m for marker in markers)
    least_m = MARKER_SETTINGS.wrong_size * median_m
    return tuple(
        marker.number
        for marker in markers
        if abs(marker.edge_m - median_m)
        > MARKER_SETTINGS.wrong_sigmas * marker.edge_std_m + least_m
    )


def bar_checks(
    markers: Sequence[PlacedMarker], bars: dict[tuple[int, int], float]
) -> dict[tuple[int, int], ScaleCheck]:
    """Distances of markers' middles against known lengths; bars without an end are left out."""
    found = {marker.number: marker for marker in markers}
    checks = {}
    for (first, second), length_m in bars.items():
        if first in found and second in found:
            a, b = found[first], found[second]
            ratio = float(np.linalg.norm(a.place_m - b.place_m)) / length_m
            std = float(np.hypot(a.std_m, b.std_m)) / length_m
            checks[first, second] = ScaleCheck(ratio, std, 1)
    return checks
