"""OUT while a run writes into it: locked for one run at a time, with every file known to the
manifest before it is there; OUT/map is replaced as a whole or not at all.
"""

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from calibration.errors import counted
from stereo_seecolor.config import OutputConfig
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import files_below, flush_folder, output_errors
from stereo_seecolor.run_folder.cache import forget_refinement
from stereo_seecolor.run_folder.dive_files import DiveFiles
from stereo_seecolor.run_folder.frame_products import FrameProducts
from stereo_seecolor.run_folder.layout import (
    MAP,
    ORIGINAL,
    PAGE,
    PRODUCTS,
    Stamp,
    refuse_links,
    state,
)
from stereo_seecolor.run_folder.lock import held
from stereo_seecolor.run_folder.manifest import DiveRecord, Manifest
from stereo_seecolor.run_folder.owned_files import OwnedFiles, remove_empty_folders
from stereo_seecolor.run_folder.ownership import (
    FolderRequest,
    Owner,
    check_ownership,
    refuse_files_of_others,
    refuse_inputs,
    refuse_used,
)


class RunFolder:
    """The output folder OUT of one run; a context manager that locks it.

    Entering takes the lock, refuses a folder that is not this dive's, and deletes what a killed run
    left half written. frames: the products of single frames. dive: files of the whole dive. owned:
    the files that the program wrote.

    Raises OutputError if the folder cannot be written, is locked by another run, or holds something
    else.
    """

    def __init__(self, root: Path, request: FolderRequest) -> None:
        self.root = root
        self.manifest, self.owned = Manifest(root), OwnedFiles(root)
        self.frames = FrameProducts(root, self.owned, self.manifest)
        self.dive = DiveFiles(root, self.owned, self.manifest)
        self._request, self._hold = request, ExitStack()

    def __reduce__(self) -> "tuple[Callable[[Path, str], RunFolder], tuple[Path, str]]":
        return RunFolder.on_worker, (self.root, self.frames.token)

    @classmethod
    def on_worker(cls, root: Path, token: str) -> Self:
        """Open the folder in another process for work on single frames, while the process whose
        lease has this token locks it.
        """
        folder = cls(root, FolderRequest(Owner("worker", {})))
        folder.frames.token = token
        return folder

    def reads(self, name: str) -> bool:
        """Tell whether a file of OUT is an input of this run."""
        return (self.root / name).resolve() in {path.resolve() for path in self._request.inputs}

    def __enter__(self) -> Self:
        refuse_links(self.root)
        if not self.manifest.exists():
            refuse_used(self.root)
        with ExitStack() as hold:
            self.frames.token = hold.enter_context(held(self.root)).token
            check_ownership(self.manifest, self._request)
            self._begin()
            self._hold = hold.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.owned.flush()
        self._hold.close()

    @classmethod
    @contextmanager
    def existing(cls, root: Path, command: str, inputs: Sequence[Path] = ()) -> Iterator[Self]:
        """Lock a finished run's folder for a command that adds a map or another file of the whole
        dive.

        inputs: files that the command reads, which are not to be replaced. Raises OutputError.
        """
        refuse_inputs(command, root, inputs)
        refuse_links(root)
        with held(root) as holder:
            folder = cls.on_worker(root, holder.token)
            folder.dive.record = folder.manifest.dive()
            refuse_files_of_others(folder.manifest)
            yield folder

    def _begin(self) -> None:
        if self._request.overwrite and self.manifest.exists():
            self._delete_everything()
        earlier = self.manifest.dive() if self.manifest.exists() else DiveRecord()
        self.owned.remove_leftovers()
        self.dive.record = replace(earlier, identity=self._request.owner.identity())
        self.manifest.save_dive(self.dive.record)

    def _delete_everything(self) -> None:
        """Delete all that the manifest names, and folders that are empty then."""
        for frame in self.manifest.frames():
            self.frames.discard(frame.name)
        dive = self.manifest.dive()
        self.owned.delete(dive.files, dive.files)
        forget_refinement(self.root)
        self.manifest.save_dive(DiveRecord(identity=dive.identity))
        for folder in (MAP, PAGE, *PRODUCTS, ORIGINAL):
            remove_empty_folders(self.root / folder)


# The disk space that a run needs: stated before it begins; a run that cannot finish is refused.


@dataclass(frozen=True)
class BytesAPixel:
    """Bytes for each pixel of a product, measured on synthetic pairs of 1280x1024 with 8 bits
    (docs/performance.md, *Disk*); real ones take as much or less.
    """

    cloud: float = 13.8
    picture: float = 1.6
    map: float = 4.0
    deflated_range: float = 2.1
    deflated_std: float = 1.2
    others: float = 0.25
    least: float = 0.4
    """Fraction of the need that a run takes at least: clouds hold known pixels only, pictures of
    haze are small.
    """


BYTES = BytesAPixel()


def need_bytes(output: OutputConfig, pixels: int, corrected: bool) -> float:
    """Estimate the bytes of a pair. corrected: with its picture and cloud, not with its range
    alone.
    """
    total = BYTES.others
    total += BYTES.deflated_range + BYTES.deflated_std if output.deflated_maps else 2 * BYTES.map
    total += corrected * (BYTES.picture + BYTES.cloud * output.with_clouds)
    return pixels * total


@dataclass(frozen=True)
class DiskSpace:
    """The bytes that a number of pairs need on the disk of OUT, and the bytes that are free
    there.
    """

    pairs: int
    need: float
    free: float

    @classmethod
    def checked(cls, root: Path, pairs: int, pair_bytes: float) -> "DiskSpace":
        """Compute need and free space for the pairs that are left. Raises OutputError where the
        disk is too small.
        """
        room = cls(pairs, pairs * pair_bytes, shutil.disk_usage(root).free)
        if room.need * BYTES.least > room.free:
            raise OutputError(
                f"{root}: {room.line}: set output.preset=lean, or choose an --out on another disk"
            )
        return room

    @property
    def line(self) -> str:
        """One line for the user, before the work begins."""
        needs = f"{counted(self.pairs, 'pair')} need{'s' if self.pairs == 1 else ''}"
        return (
            f"disk: {needs} about {self.need / 1e9:.2g} GB, and {self.free / 1e9:.2g} GB are free"
        )

    @property
    def is_low(self) -> bool:
        """Tell whether the disk may turn out too small."""
        return self.need > self.free


# OUT/map, replaced as a whole or not at all: the new map is built beside it, and takes its place
# in one rename.

BUILDING, OLD = "map_building", "map_old"


def fusion_folder(root: Path) -> Path:
    """The folder of features and finished tiles, from which a fusion that was killed continues."""
    return state(root, "fusion")


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
    folder.dive.update(_with_map(folder.dive.record, files, made_from))


def _with_map(dive: DiveRecord, files: dict[str, tuple[Stamp, ...]], made_from: str) -> DiveRecord:
    others = {path: stamps for path, stamps in dive.files.items() if not path.startswith(f"{MAP}/")}
    return replace(dive, files={**others, **files}, made_from={**dive.made_from, MAP: made_from})


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
    """Delete the earlier map; files in it that are not of this program are kept in
    OUT/set_aside.
    """
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
