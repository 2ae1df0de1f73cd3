"""Find trajectories among the files of a dive."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereo_seecolor.commands.inspect_rig import candidates
from stereo_seecolor.errors import InputError, MappingError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.trajectories import read_trajectory, trajectory_format
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import place
from stereo_seecolor.records import Trajectory

EXTENSIONS = frozenset(
    {".tum", ".txt", ".csv", ".tsv", ".data", ".xml", ".dim2", ".json", ".gpx", ".nmea", ".kml"}
    | {".jsonl", ".geojson", ".log"}
)
TABLE, JOINED = "table of navigation", "tables of navigation, joined by time"
"""What the format of a table is called, and of tables such as of positions and of attitudes."""
LARGEST_BYTES = 100_000_000
"""A day of navigation at 10 Hz has some 80 MB."""


@dataclass(frozen=True)
class FoundPoses:
    """A trajectory. poses: finite ones. pairs: with one; by: "name", "time" or "order"."""

    path: Path
    format: str
    poses: int
    pairs: int
    by: str


def find_poses(
    places: Sequence[Path], pairs: Sequence[Pair], others: Collection[Path]
) -> tuple[tuple[FoundPoses, ...], tuple[str, ...]]:
    """Find all trajectories in the places, ordered by path, and say why the others of a known
    format cannot be read.

    others: files that are known to be something else.
    """
    found: list[FoundPoses] = []
    unread: list[str] = []
    parts: list[Path] = []
    for path in sorted(candidates(places, EXTENSIONS, LARGEST_BYTES) - set(others)):
        with suppress(InputError):
            if (kind := trajectory_format(path)) is not None:
                try:
                    one, notes = _facts(path, kind, read_trajectory(path), pairs)
                    found.append(one)
                    unread += notes
                except InputError as error:
                    unread.append(f"poses: {error}")
                    parts.append(path)
    parts += [one.path for one in found if parts and one.format == TABLE]
    if len(parts) > 1:
        path = Path(",".join(map(str, sorted(parts))))
        with suppress(InputError):  # of tables that each lack something, read as one
            one, notes = _facts(path, JOINED, read_trajectory(path), pairs)
            found.append(one)
            unread += notes
    return tuple(found), tuple(unread)


def _facts(
    path: Path, kind: str, trajectory: Trajectory, pairs: Sequence[Pair]
) -> tuple[FoundPoses, list[str]]:
    """What a trajectory holds, and what a map with it would say of the pairs' poses."""
    finite = np.isfinite(trajectory.T_world_camera).all(axis=(1, 2))
    by = "order"
    if any(trajectory.names):
        by = "name"
    elif np.isfinite(trajectory.timestamps_s).any():
        by = "time"
    number, notes = 0, [f"poses: {note}" for note in trajectory.notes]
    if pairs:
        times_s = [np.nan if pair.timestamp_s is None else pair.timestamp_s for pair in pairs]
        index = FrameIndex(tuple(pair.name for pair in pairs), np.array(times_s), ())
        try:
            placement = place(index, trajectory)
            number = int(np.count_nonzero(placement.components >= 0))
            notes += [f"poses: {path.name}: {note}" for note in placement.warnings]
        except MappingError as error:
            notes.append(f"poses: {path.name}: {error}")
    found = FoundPoses(path, kind, int(finite.sum()), number, by)
    return found, notes
