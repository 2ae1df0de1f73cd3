"""Find the calibration among the files of a dive."""

import os
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from calibration import CalibrationError, StereoRig
from calibration.formats import format_name, load_rig_of_images
from stereo_seecolor.files.names import natural_key
from stereo_seecolor.inputs.sides import DEEPEST

EXTENSIONS = frozenset(
    {".yaml", ".yml", ".json", ".xml", ".mat", ".npz", ".cam", ".calib", ".txt", ".cfg", ".conf"}
    | {".toml", ".krtd", ".npy", ".csv"}
)

ARCHIVES = frozenset({".zip", ".gz", ".tgz", ".7z", ".rar"})

LARGEST_BYTES = 20_000_000
"""A calibration is smaller: MATLAB objects with all their corners have a few hundred kilobytes."""


@dataclass(frozen=True, eq=False)
class FoundCalibration:
    """A rig and where it was read: a file, or a folder with the files of a rig."""

    path: Path
    format: str
    rig: StereoRig


def find_calibration(places: Sequence[Path], size: tuple[int, int]) -> tuple[FoundCalibration, ...]:
    """All calibrations in the places. Those for images of ``size`` (width, height) come first, of
    them those given by name, each group in natural order.
    """
    paths = _all_candidates(places)
    found = [one for path in paths if (one := _try_load(path, size))]
    folders = sorted(_folders(places, paths) - {one.path.parent for one in found})
    found += [one for folder in folders if (one := _try_load(folder, size))]
    if not found:  # a camera in each of two folders, as EuRoC has them
        above = sorted({folder.parent for folder in folders if folder not in places})
        found = [one for folder in above if (one := _try_load(folder, size))]
    return tuple(
        sorted(found, key=lambda one: (one.rig.left.image_size != size, one.path not in places))
    )


def _folders(places: Sequence[Path], paths: Sequence[Path]) -> set[Path]:
    """Folders that may hold files of a rig: that of a file given by name holds anything."""
    given = Counter(place.parent for place in places if place in paths)
    return {path.parent for path in paths if path not in places or given[path.parent] > 1}


def refused_calibrations(places: Sequence[Path], size: tuple[int, int]) -> tuple[str, ...]:
    """A line for each calibration that cannot be used, with the reason."""
    refused = [
        f"{path}: is an archive: unpack it, if it holds the calibration"
        for path in sorted(candidates(places, ARCHIVES, LARGEST_BYTES))
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
        candidates(places, EXTENSIONS, LARGEST_BYTES), key=lambda path: natural_key(str(path))
    )


def candidates(
    places: Sequence[Path], extensions: Collection[str], largest_bytes: int
) -> set[Path]:
    """Files that may be of a kind: the places, and files with extensions up to DEEPEST below."""
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
