"""Find the calibration and trajectories among the files of a dive, and test the calibration on
sample pairs.
"""

import os
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration import CalibrationError, Rectification, StereoRig
from calibration.checks import RowCheck
from calibration.field_checks.conventions import resolve_convention
from calibration.field_checks.mistakes import FoundMistake
from calibration.field_checks.quick_check import quick_check
from calibration.formats import format_name, load_rig_of_images
from calibration.rig import for_channels
from calibration.suspicions import suspicions
from stereo_seecolor.checks.changes import find_change
from stereo_seecolor.checks.range_limits import RangeLimits, range_limits
from stereo_seecolor.checks.rig import judge_rig, matches_of
from stereo_seecolor.checks.sample import DECIDING_PAIRS
from stereo_seecolor.commands.calibrate import RigFacts, rig_facts
from stereo_seecolor.commands.inspect_dive import Misfit, SampleMeasures, measure, misfits
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import folder_keys, natural_key, stem_of_path
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.inputs.sides import DEEPEST
from stereo_seecolor.inputs.trajectories import read_trajectory, trajectory_format
from stereo_seecolor.matching.gray import sides_without_texture
from stereo_seecolor.records import Image, Trajectory, is_monochrome

# Find the calibration among the files of a dive.

INSPECT_RIG_EXTENSIONS = frozenset(
    {
        ".yaml",
        ".yml",
        ".json",
        ".xml",
        ".mat",
        ".npz",
        ".cam",
        ".calib",
        ".txt",
        ".cfg",
        ".conf",
        ".toml",
        ".krtd",
        ".npy",
        ".csv",
    }
)

ARCHIVES = frozenset({".zip", ".gz", ".tgz", ".7z", ".rar"})

INSPECT_RIG_LARGEST_BYTES = 20_000_000
"""A calibration is smaller: MATLAB objects with all their corners have a few hundred kilobytes."""


@dataclass(frozen=True, eq=False)
class FoundCalibration:
    """A rig and where it was read: a file, or a folder with the files of a rig."""

    path: Path
    format: str
    rig: StereoRig


def find_calibration(places: Sequence[Path], size: tuple[int, int]) -> tuple[FoundCalibration, ...]:
    """All calibrations in the places. Those for images of ``size`` (width, height) come first, each
    group in natural order.
    """
    paths = _all_candidates(places)
    found = [one for path in paths if (one := _try_load(path, size))]
    folders = sorted(_folders(places, paths) - {one.path.parent for one in found})
    found += [one for folder in folders if (one := _try_load(folder, size))]
    if not found:  # a camera in each of two folders, as EuRoC has them
        above = sorted({folder.parent for folder in folders if folder not in places})
        found = [one for folder in above if (one := _try_load(folder, size))]
    return tuple(sorted(found, key=lambda one: one.rig.left.image_size != size))


def _folders(places: Sequence[Path], paths: Sequence[Path]) -> set[Path]:
    """Folders that may hold the files of a rig: those of a single file that was given by name hold
    anything else.
    """
    given = Counter(place.parent for place in places if place in paths)
    return {path.parent for path in paths if path not in places or given[path.parent] > 1}


def refused_calibrations(places: Sequence[Path], size: tuple[int, int]) -> tuple[str, ...]:
    """A line for each file that is a calibration by its content but cannot be used, with the
    reason.
    """
    refused = [
        f"{path}: is an archive: unpack it, if it holds the calibration"
        for path in sorted(candidates(places, ARCHIVES, INSPECT_RIG_LARGEST_BYTES))
        if path.suffix.lower() in ARCHIVES
    ]
    for path in _all_candidates(places):
        with suppress(CalibrationError):
            kind = format_name(path)
            try:
                load_rig_of_images(path, size)
            except CalibrationError as error:
                refused.append(f"{error} ({kind} format)")
    return tuple(refused)


def _all_candidates(places: Sequence[Path]) -> list[Path]:
    return sorted(
        candidates(places, INSPECT_RIG_EXTENSIONS, INSPECT_RIG_LARGEST_BYTES),
        key=lambda path: natural_key(str(path)),
    )


def candidates(
    places: Sequence[Path], extensions: Collection[str], largest_bytes: int
) -> set[Path]:
    """Files that may be of a kind: places that are files, and files of these extensions up to
    DEEPEST folders below the others.
    """
    return {path for place in places for path in _in_place(place, extensions, largest_bytes)}


def _in_place(place: Path, extensions: Collection[str], largest_bytes: int) -> Iterator[Path]:
    if place.is_file():
        yield place
        return
    for folder, below, names in os.walk(place):
        here = Path(folder)
        below[:] = [
            name
            for name in below
            if name[0] != "." and len(here.relative_to(place).parts) < DEEPEST
        ]
        for path in (here / name for name in names if Path(name).suffix.lower() in extensions):
            if path.is_file() and 0 < path.stat().st_size < largest_bytes:
                yield path


def _try_load(path: Path, size: tuple[int, int]) -> FoundCalibration | None:
    try:
        return FoundCalibration(path, format_name(path), load_rig_of_images(path, size))
    except CalibrationError:
        return None


# A calibration that ``inspect`` found, tested on sample pairs of the dive.


@dataclass(frozen=True)
class CalibrationFacts:
    """A calibration that was found, tested on the dive. vertical: the right camera is above or
    below the left one.

    rows: vertical disparity on sample pairs, None where too few points were found in both images.
    """

    path: Path
    format: str
    rig: RigFacts
    vertical: bool
    rows: RowCheck | None
    suspicions: tuple[str, ...]


@dataclass(frozen=True)
class Tested:
    """A calibration tested on sample pairs.

    misfits: pairs that do not show one scene. fitting: at least one pair shows one. limits: limits
    of range to be set.
    mistake: the likely mistake where pairs do not fit the calibration.
    """

    facts: CalibrationFacts | None = None
    misfits: tuple[Misfit, ...] = ()
    measured: SampleMeasures | None = None
    fitting: bool = True
    limits: tuple[RangeLimits, ...] = ()
    mistake: FoundMistake | None = None

    @property
    def rows(self) -> RowCheck | None:
        """Vertical disparity on sample pairs, None where too few points were found in both
        images.
        """
        return self.facts.rows if self.facts else None

    @property
    def agrees(self) -> bool:
        """True unless sample pairs show that no ranges can be had from these images with this
        calibration.
        """
        return self.fitting and not (self.rows and self.rows.refusal)

    @property
    def exchanged(self) -> bool:
        """True if left and right are to be exchanged."""
        return self.mistake.exchanged if self.mistake else bool(self.rows and self.rows.swapped)


NOTHING_TESTED = Tested()


def tested_calibration(
    found: FoundCalibration, pairing: Pairing, sample: Sequence[Pair], config: RunConfig
) -> Tested:
    """Test a calibration on sample pairs: one scene, rows, mistakes, limits of range; and measure
    pairs unless it is unusable.
    """
    rig = _settled_rig(found.rig, sample[:DECIDING_PAIRS], config)
    wrong = misfits(rig, pairing, sample, config)
    fitting = [pair for pair in sample if pair.name not in {misfit.pair for misfit in wrong}]
    rectification = Rectification.from_rig(rig)
    change = find_change(rectification, pairing.pairs, config.input)
    pairs, fitting = change.shared(pairing.pairs), list(change.shared(fitting))
    matches = list(matches_of(rectification, fitting, config.input).matches.values())
    judged = judge_rig(rig, matches, pairs, config.input, change)
    judged = judged.with_motion(rig, matches, pairs, config.input)
    rows, mistake = judged.rows, judged.mistake
    limits = _range_limits(rectification, _images(fitting, config), config)
    x_m, y_m, _ = rig.R.T @ rig.T_right_left[:3, 3]
    vertical = bool(abs(y_m) > abs(x_m))
    facts = CalibrationFacts(
        found.path, found.format, rig_facts(rig), vertical, rows, suspicions(rig)
    )
    unrelated = rows is None and mistake is None and any(_have_texture(fitting, config))
    if not fitting or unrelated or mistake or (rows and (rows.swapped or rows.refusal)):
        return Tested(facts, wrong, fitting=bool(fitting) and not unrelated, mistake=mistake)
    matching = config.matching.model_copy(update={limit.key: limit.fits_m for limit in limits})
    measured = measure(
        rig, fitting, len(pairing.pairs), config.model_copy(update={"matching": matching})
    )
    return Tested(facts, wrong, measured, limits=limits)


def _settled_rig(rig: StereoRig, sample: Sequence[Pair], config: RunConfig) -> StereoRig:
    images = _images(sample, config)
    rig = for_channels(rig, is_monochrome(images[0][0]))
    with suppress(CalibrationError):  # too few points to tell: said of the rows
        return resolve_convention(rig, images)
    return rig


def _range_limits(
    rectification: Rectification, images: list[tuple[Image, Image]], config: RunConfig
) -> tuple[RangeLimits, ...]:
    ranges_m = [quick_check(rectification, both).range_m for both in images]
    return range_limits(np.concatenate([np.zeros(0), *ranges_m]), config.matching)


def _have_texture(sample: Sequence[Pair], config: RunConfig) -> list[bool]:
    return [
        not sides_without_texture(frame) for frame in map(FrameReader(config.input).read, sample)
    ]


def _images(sample: Sequence[Pair], config: RunConfig) -> list[tuple[Image, Image]]:
    frames = map(FrameReader(config.input).read, sample)
    return [(frame.left, frame.right) for frame in frames]


# Find trajectories among the files of a dive.

INSPECT_POSES_EXTENSIONS = frozenset(
    {".tum", ".txt", ".csv", ".tsv", ".data", ".xml", ".dim2", ".json", ".gpx", ".nmea", ".kml"}
    | {".jsonl", ".geojson", ".log"}
)
TABLE = "table of navigation"
"""What the format of a table is called."""
INSPECT_POSES_LARGEST_BYTES = 100_000_000
"""A day of navigation at 10 Hz has some 80 MB."""


@dataclass(frozen=True)
class FoundPoses:
    """A trajectory. poses: number of finite ones. pairs: number of pairs that have one of them; by:
    "name", "time" or "order".
    """

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
    for path in sorted(
        candidates(places, INSPECT_POSES_EXTENSIONS, INSPECT_POSES_LARGEST_BYTES) - set(others)
    ):
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
