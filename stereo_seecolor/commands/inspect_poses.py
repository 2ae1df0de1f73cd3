"""Find trajectories among the files of a dive."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereo_seecolor.commands.inspect_rig import candidates
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import folder_keys, stem_of_path
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.trajectories import read_trajectory, trajectory_format
from stereo_seecolor.records import Trajectory

EXTENSIONS = frozenset(
    {".tum", ".txt", ".csv", ".tsv", ".data", ".xml", ".dim2", ".json", ".gpx", ".nmea", ".kml"}
    | {".jsonl", ".geojson", ".log"}
)
TABLE = "table of navigation"
"""What the format of a table is called."""
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
                    trajectory = read_trajectory(path)
                    found.append(_facts(path, kind, trajectory, pairs))
                    unread += [f"poses: {note}" for note in trajectory.notes]
                except InputError as error:
                    unread.append(f"poses: {error}")
                    parts.append(path)
    parts += [one.path for one in found if parts and one.format == TABLE]
    if len(parts) > 1 and (together := _together(parts, pairs)):
        found.append(together)
    return tuple(found), tuple(unread)


def _together(parts: Sequence[Path], pairs: Sequence[Pair]) -> FoundPoses | None:
    """Tables that each lack something, such as positions, attitudes and depths, read as one."""
    path = Path(",".join(map(str, sorted(parts))))
    try:
        return _facts(path, "tables of navigation, joined by time", read_trajectory(path), pairs)
    except InputError:
        return None


def _facts(path: Path, kind: str, trajectory: Trajectory, pairs: Sequence[Pair]) -> FoundPoses:
    finite = np.isfinite(trajectory.T_world_camera).all(axis=(1, 2))
    names = {
        key for name in trajectory.names if name for key in (stem_of_path(name), *folder_keys(name))
    }
    times_s = trajectory.timestamps_s[finite & np.isfinite(trajectory.timestamps_s)]
    if names:
        number, by = sum(bool({pair.name, pair.left.stem} & names) for pair in pairs), "name"
    elif times_s.size:
        number, by = sum(_is_within(pair, times_s.min(), times_s.max()) for pair in pairs), "time"
    else:
        number, by = min(len(pairs), int(finite.sum())), "order"
    return FoundPoses(path, kind, int(finite.sum()), number, by)


def _is_within(pair: Pair, first_s: float, last_s: float) -> bool:
    return pair.timestamp_s is not None and bool(
        first_s - 0.01 <= pair.timestamp_s <= last_s + 0.01
    )
