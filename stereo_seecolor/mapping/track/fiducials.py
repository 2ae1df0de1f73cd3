"""Markers of known size, distance or place: the scale of a rig from them, and constraints on its
bundle adjustment.

A rig's scale is one number for all of its ranges. Features cannot improve it, since they are
measured with that same rig. So it is estimated by itself, from all known lengths and the rig's
calibration, each weighted by its standard error; all ranges are then scaled by this factor, and the
lengths and places hold the shape of the track as factors of its bundle adjustment.
"""

from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MarkersConfig
from stereo_seecolor.mapping.control_points import FEWEST
from stereo_seecolor.mapping.marker_detection import MarkerDetector
from stereo_seecolor.mapping.marker_placing import PlacedSighting, place
from stereo_seecolor.mapping.marker_tables import Places, read_bars, read_places
from stereo_seecolor.mapping.placed_markers import MARKER_SETTINGS as MARKER
from stereo_seecolor.mapping.placed_markers import (
    PlacedMarker,
    ScaleCheck,
    bar_checks,
    doubled,
    placed_markers,
    size_check,
)
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.mapping.survey_frames import Frames
from stereo_seecolor.mapping.track.image_space import Observed
from stereo_seecolor.mapping.track.known_points import Known, KnownLength, KnownPlace
from stereo_seecolor.mapping.track.shared_points import TrackObservations
from stereo_seecolor.records import Array, SurveyFrame


@dataclass(frozen=True)
class MarkSettings:
    """How far knowledge of markers is trusted."""

    # of a rig's scale: what calibrations leave, as for measures without another statement
    rig_scale_std: float = 0.005
    # of a given length, a fraction of it: a printed tag, a bar measured by tape
    given_std: float = 5e-4
    told_sigmas: float = 3.0  # beyond which a disagreement is named
    elsewhere_sigmas: float = 10.0  # of navigation, by which surveyed places may differ from it,
    elsewhere_m: float = 1.0  # and so far in any case


SETTINGS = MarkSettings()


@dataclass(frozen=True, eq=False)
class Marks:
    """The markers found, by frame, and their measures: edge, bars by both ends' numbers, places.

    cells: across a marker. doubled: numbers that two markers have, which are not used.
    """

    observations: dict[int, list[PlacedSighting]]
    edge_m: float | None
    bars: dict[tuple[int, int], float]
    places: Places
    cells: int = 0
    doubled: tuple[int, ...] = ()

    @classmethod
    def found(cls, survey: Survey, config: MarkersConfig) -> "Marks":
        """Find markers in all frames of a survey. Raises InputError for unusable tables."""
        bars, places = read_known(config)
        look = partial(_sightings, survey.frames, survey.geometry, config.family)
        found, count = list[list[PlacedSighting]](), len(survey.frames)
        for own in survey.compute.each(look, range(count)):
            found.append(own)
            survey.progress("looking for markers", len(found), count)
        twice = doubled(chain.from_iterable(found))
        single = {
            frame: [each for each in own if each.number not in twice]
            for frame, own in enumerate(found)
        }
        cells = MarkerDetector(config.family).cells
        return cls(single, config.edge_m, bars, places, cells, tuple(sorted(twice)))

    def scaled(self, scale: float) -> "Marks":
        """Scale the ranges of the rig by a factor."""
        moved = {
            frame: [
                replace(
                    each, corners_m=scale * each.corners_m, std=(each.std[0], each.std[1] / scale)
                )
                for each in own
            ]
            for frame, own in self.observations.items()
        }
        return replace(self, observations=moved)

    def without(self, lengths: set[str]) -> "Marks":
        """Drop some of what is known, by the names of its checks."""
        edge_m = None if EDGES in lengths else self.edge_m
        bars = {ends: length for ends, length in self.bars.items() if _name(*ends) not in lengths}
        places = Places({}, {}, self.places.origin) if PLACES in lengths else self.places
        return replace(self, edge_m=edge_m, bars=bars, places=places)

    def placed(self, T_world_camera: Array) -> list[PlacedMarker]:
        """Markers that two placed frames show; T_world_camera: (N, 4, 4), NaN if not placed."""
        known = {f"{i}": T for i, T in enumerate(T_world_camera) if np.isfinite(T).all()}
        return placed_markers(
            [replace(each, frame=f"{i}") for i, own in self.observations.items() for each in own],
            known,
        )

    @property
    def known(self) -> list[str]:
        """The names of what is known of bars and places."""
        return [_name(*ends) for ends in self.bars] + [PLACES] * bool(self.places.points)

    def checks(self, T_world_camera: Array) -> dict[str, ScaleCheck]:
        """Compare what is known with the map, by name."""
        markers = self.placed(T_world_camera)
        checks = {_name(*ends): check for ends, check in bar_checks(markers, self.bars).items()}
        size = size_check(markers, self.edge_m, self.cells) if self.edge_m else None
        spread = _spread_check(markers, self.places)
        return checks | ({EDGES: size} if size else {}) | ({PLACES: spread} if spread else {})

    def joined(
        self, observations: TrackObservations, frames: set[int]
    ) -> tuple[TrackObservations, list[Known]]:
        """Observations by frame, with those of the markers' corners; and what is known of these."""
        own = [(frame, each) for frame in sorted(frames) for each in self.observations[frame]]
        views = Counter(each.number for _, each in own)
        numbers = sorted(number for number, count in views.items() if count >= MARKER.fewest_views)
        start = int(observations.point.max(initial=-1)) + 1
        corners = {
            number: tuple(range(start + 4 * k, start + 4 * k + 4))
            for k, number in enumerate(numbers)
        }
        seen = [
            (frame, each, corners[each.number]) for frame, each in own if each.number in corners
        ]
        if not seen:
            return observations, []
        points = np.concatenate([each.corners_m for _, each, _ in seen])
        std = np.repeat([[each.std[0], each.std[0], each.std[1]] for _, each, _ in seen], 4, axis=0)
        all_points = np.concatenate(
            [
                observations.seen.points,
                np.column_stack([points[:, :2], np.ones(len(points))]) / points[:, 2:],
            ]
        )
        joined = TrackObservations(
            frame=np.concatenate(
                [observations.frame, np.repeat([frame for frame, _, _ in seen], 4)]
            ),
            point=np.concatenate(
                [observations.point, np.concatenate([keys for _, _, keys in seen])]
            ),
            seen=Observed(all_points, np.concatenate([observations.seen.std, std])),
            near=np.concatenate([observations.near, 1 / points[:, 2]]),
        )
        return joined, [*self._lengths(corners), *self._places(corners)]

    def _lengths(self, corners: dict[int, tuple[int, ...]]) -> list[KnownLength]:
        lengths: list[tuple[tuple[int, ...], tuple[int, ...], float]] = [
            ((keys[i],), (keys[j],), self.edge_m * (1 if (j - i) % 2 else 2**0.5))
            for keys in corners.values()
            for i, j in combinations(range(4), 2)
            if self.edge_m
        ]
        lengths += [
            (corners[first], corners[second], length_m)
            for (first, second), length_m in self.bars.items()
            if first in corners and second in corners
        ]
        return [KnownLength(a, b, m, SETTINGS.given_std * m) for a, b, m in lengths]

    def _places(self, corners: dict[int, tuple[int, ...]]) -> list[KnownPlace]:
        places = self.places
        found = [n for n in places.points if n in corners]
        known = [KnownPlace(corners[n], places.points[n], places.stds_m[n]) for n in found]
        return known if len(known) >= FEWEST else []


EDGES, PLACES = "edges", "surveyed positions"


def read_known(config: MarkersConfig) -> tuple[dict[tuple[int, int], float], Places]:
    """Lengths of scale bars by the markers at their ends, meters, and places of markers.

    Raises InputError for a table that cannot be used.
    """
    bars = read_bars(config.bars) if config.bars else {}
    return bars, read_places(config.points) if config.points else Places({}, {})


def _name(first: int, second: int) -> str:
    return f"bar {first}-{second}"


def _spread_check(markers: list[PlacedMarker], places: Places) -> ScaleCheck | None:
    """How far surveyed places are apart, by the map and as given: from their middle."""
    own = [marker for marker in markers if marker.number in places.points]
    if len(own) < FEWEST:
        return None
    here = np.array([marker.place_m for marker in own])
    there = np.array([places.points[marker.number] for marker in own])
    reach = [
        float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum())) for points in (here, there)
    ]
    off = [np.hypot(places.stds_m[marker.number], marker.std_m) for marker in own]
    return ScaleCheck(
        reach[0] / reach[1], float(np.sqrt(np.mean(np.square(off)))) / reach[1], len(own)
    )


def _sightings(
    frames: Frames, geometry: RectifiedPair, family: str, number: int
) -> list[PlacedSighting]:
    """Find and place the markers of the frame of a number."""
    frame = frames[number]
    if not isinstance(frame, SurveyFrame):
        return []
    found = MarkerDetector(family).find(frame.color)
    placed = (place(observation, frame, geometry) for observation in found)
    return [each for each in placed if each is not None]
