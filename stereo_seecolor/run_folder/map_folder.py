"""OUT/map, replaced as a whole or not at all: a new map takes its place in one rename."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from calibration.files import flush_folder
from stereo_seecolor.files.atomic import files_below, output_errors
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import MAP, state
from stereo_seecolor.run_folder.stamp import Stamp

BUILDING, OLD = "map_building", "map_old"
FUSION = "fusion"
"""Features and finished tiles, from which a fusion that was killed continues."""


@contextmanager
def building_map(folder: RunFolder, made_from: str) -> Iterator[Path]:
    """Give a folder to build a map in, which becomes OUT/map when the block ends without an error;
    on an error the earlier map stays.

    made_from: hash of the frames that it is made from. Raises OutputError.
    """
    building = state(folder.root, BUILDING)
    _recover(folder)
    with output_errors(building):
        shutil.rmtree(building, ignore_errors=True)
        building.mkdir(parents=True)
    yield building
    with output_errors(folder.root / MAP):
        _swap(folder, building, made_from)


def _swap(folder: RunFolder, building: Path, made_from: str) -> None:
    files: dict[str, tuple[Stamp, ...]] = {
        f"{MAP}/{path.relative_to(building).as_posix()}": (Stamp.of(path),)
        for path in files_below(building)
    }
    earlier = {
        path: stamps
        for path, stamps in folder.dive.record.files.items()
        if path.startswith(f"{MAP}/")
    }
    both = {path: files.get(path, ()) + earlier.get(path, ()) for path in files | earlier}
    folder.dive.update(replace(folder.dive.record, files={**folder.dive.record.files, **both}))
    place, old = folder.root / MAP, state(folder.root, OLD)
    if place.is_dir():
        place.rename(old)
    building.rename(place)
    flush_folder(folder.root)
    _remove_old(folder)
    dive = folder.dive.record
    others = {path: stamps for path, stamps in dive.files.items() if path not in both}
    made = {**dive.made_from, MAP: made_from}
    folder.dive.update(replace(dive, files={**others, **files}, made_from=made))


def _recover(folder: RunFolder) -> None:
    """Bring a folder in order whose fusion was killed while the maps changed places."""
    place, old = folder.root / MAP, state(folder.root, OLD)
    if not old.is_dir():
        return
    if place.exists():
        _remove_old(folder)
    else:
        old.rename(place)


def _remove_old(folder: RunFolder) -> None:
    """Delete the earlier map; files of others in it are kept in OUT/set_aside."""
    old = state(folder.root, OLD)
    if not old.is_dir():
        return
    for path in list(files_below(old)):
        name = f"{MAP}/{path.relative_to(old).as_posix()}"
        if any(stamp.is_of(path) for stamp in folder.dive.record.files.get(name, ())):
            path.unlink()
        else:
            folder.owned.quarantine(path, name)
    shutil.rmtree(old)  # empty folders alone
