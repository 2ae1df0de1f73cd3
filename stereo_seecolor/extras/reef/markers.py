"""``markers``: tags and scale bars found in a fused run, against what is known of them."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.transforms import rigid_transform
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.extras.reef.metric_tables import write_tables
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.free_places import new_folder, refuse_filled
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.mapping.control_points import UPSIDE_DOWN, ControlFit, control_fit
from stereo_seecolor.mapping.marker_detection import FAMILIES, MarkerDetector
from stereo_seecolor.mapping.marker_placing import PlacedSighting, place
from stereo_seecolor.mapping.marker_tables import read_bars, read_places
from stereo_seecolor.mapping.placed_markers import (
    PlacedMarker,
    ScaleCheck,
    bar_checks,
    doubled,
    placed_markers,
    size_check,
    two_of_a_number,
)
from stereo_seecolor.progress import Listener, Silence
from stereo_seecolor.records import FrameRow, Trajectory
from stereo_seecolor.run_folder.own_paths import refuse_own_place
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

MOST_LOOKED_AT = 20
"""Frames in which markers of other families are looked for."""


@dataclass(frozen=True)
class Known:
    """Known lengths and places of markers. edge_m: edge of the black border of each. bars, points:
    CSV files (docs/markers.md).
    """

    edge_m: float | None = None
    family: str = "36h11"
    bars: Path | None = None
    points: Path | None = None


@dataclass(frozen=True, eq=False)
class FoundMarkers:
    """Markers found in a map. frames: number of frames of the map. markers: seen in two or more.

    size: known against measured edge, of all markers. bars: the same of each scale bar, by its
    ends. control: fit to the surveyed places. None where nothing is known. doubts: lines for
    numbers that two markers have. not_found: bars by their ends.
    """

    frames: int
    markers: tuple[PlacedMarker, ...]
    size: ScaleCheck | None
    bars: dict[str, ScaleCheck]
    control: ControlFit | None
    files: tuple[Path, ...] = ()
    doubts: tuple[str, ...] = ()
    not_found: tuple[str, ...] = ()

    @property
    def wrong(self) -> bool:
        """Whether a given length is impossible, surveyed places do not fit, or doubts exist."""
        return any(check.wrong for check in (self.size, *self.bars.values()) if check) or bool(
            self.doubts or (self.control and self.control.doubt)
        )


def markers(
    out: Path, known: Known, folder: Path | None = None, listener: Listener | None = None
) -> FoundMarkers:
    """Find markers in the corrected frames of the map in ``out``.

    folder: new or empty, for markers.csv and, with control points, trajectory.tum, the track in
    their coordinates.
    Raises InputError for a run without a map, or tables that cannot be used; OutputError.
    """
    if folder:
        refuse_filled(folder)
        refuse_own_place(folder)
    if known.edge_m is not None and not known.edge_m > 0:
        raise InputError(f"--size {known.edge_m:g}: give the edge of the black square in meters")
    detector = MarkerDetector(known.family)
    bars = read_bars(known.bars) if known.bars else {}
    if known.points:
        read_places(known.points)  # what cannot be read is named before all frames are looked at
    posed = open_posed_run(out)
    places = read_places(known.points, posed.map.origin) if known.points else None
    shift = rigid_transform(np.eye(3), posed.offset_m)
    T = {frame.name: shift @ T for frame, T in zip(posed.frames, posed.T_map_camera, strict=True)}
    seen = _observations(posed, detector, listener or Silence())
    twice = doubled(seen)
    found = tuple(placed_markers([one for one in seen if one.number not in twice], T))
    if not found and not twice:
        families = [name for name in FAMILIES if name != known.family and _shows(posed, name)]
        others = (
            f"the frames show {', or '.join(families)}: give --family"
            if families
            else "no other family was found either; markers that are too small, blurred or "
            "covered are not detected"
        )
        raise InputError(
            f"{out}: shows no marker of {known.family} in two frames or more: {others}"
        )
    checks = {
        f"{first}-{second}": check for (first, second), check in bar_checks(found, bars).items()
    }
    result = FoundMarkers(
        frames=len(posed.frames),
        markers=found,
        size=size_check(found, known.edge_m, detector.cells) if known.edge_m else None,
        bars=checks,
        control=control_fit(found, places.points, places.stds_m) if places else None,
        doubts=_doubts(found, twice),
        not_found=tuple(f"{a}-{b}" for a, b in bars if f"{a}-{b}" not in checks),
    )
    if result.control and result.control.is_upside_down(found, np.array(list(T.values()))):
        raise InputError(f"{known.points}: {UPSIDE_DOWN}")
    return _written(result, T, folder) if folder else result


def _doubts(found: Sequence[PlacedMarker], twice: set[int]) -> tuple[str, ...]:
    return (
        *([two_of_a_number(sorted(twice))] if twice else []),
        *(
            f"the observations of marker {marker.number} lie {marker.residual_m:.2f} m apart: two "
            "markers of one number, or a track that drifted"
            for marker in found
            if marker.residual_m > marker.edge_m
        ),
    )


def _shows(posed: PosedRun, family: str) -> bool:
    """Tell whether two frames show the same marker of a family; every few frames of a long dive."""
    detector, frames, seen = MarkerDetector(family), SurveyFrames(posed.run), set[int]()
    for number in range(0, len(frames), -(-len(frames) // MOST_LOOKED_AT)):
        with suppress(FrameError):
            numbers = {one.number for one in detector.find(frames[number].color)}
            if numbers & seen:
                return True
            seen |= numbers
    return False


def _observations(
    posed: PosedRun, detector: MarkerDetector, listener: Listener
) -> list[PlacedSighting]:
    frames, placed = SurveyFrames(posed.run, posed.map.range_scale), []
    listener.begin("markers", len(frames))
    for number in range(len(frames)):
        try:
            frame = frames[number]
        except FrameError:
            continue
        found = [
            place(observation, frame, posed.geometry) for observation in detector.find(frame.color)
        ]
        placed += [each for each in found if each is not None]
        listener.advance(FrameRow(frame.name))
    return placed


def _written(result: FoundMarkers, T: dict[str, np.ndarray], folder: Path) -> FoundMarkers:
    rows = [vars(marker) for marker in result.markers]
    if result.control:
        rows = [
            row
            | {"control_residual_m": result.control.residuals_m.get(row["number"], float("nan"))}
            for row in rows
        ]
    with new_folder(folder) as building:
        write_tables(building, {"markers": rows})
        if result.control:
            moved = np.array([result.control.T @ each for each in T.values()])
            write_tum(
                building / "trajectory.tum",
                Trajectory(tuple(T), np.arange(len(T), dtype=float), moved),
            )
    return replace(result, files=tuple(sorted(files_below(folder))))
