"""The cache of a run: what it found and a rerun need not find again, in OUT/.state: moment tables,
light, fit of the water, refined rig, and plan.

Each file begins with the hash of what its content was made from; the content is deflated. A file
that is damaged, or of another hash, is as if it were not there.
"""

import contextlib
import hashlib
import platform
import re
import shutil
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from calibration import CalibrationError, StereoRig
from calibration.bounded_text import load_json
from calibration.formats import native
from calibration.formats.reading.section import Section
from calibration.rig_errors import RangeError
from stereo_seecolor.compute.sequences import Names
from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files.atomic import (
    TEMPORARY_PREFIX,
    files_below,
    remove_leftovers,
    write_replaceable,
)
from stereo_seecolor.files.contained import regular_bytes
from stereo_seecolor.files.json_records import Record, as_record
from stereo_seecolor.files.json_values import JsonText, StreamedList
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.raw_arrays import read_arrays, write_arrays
from stereo_seecolor.records import Image, Map, Mask
from stereo_seecolor.run_folder.layout import WATER, cache_file, scratch_folder
from stereo_seecolor.run_folder.water_file import read_waters
from stereo_seecolor.water.model import Water

KEY_CHARACTERS = 64
"""Of a hash by ``content_key``."""


def keep(path: Path, key: str, content: Iterable[bytes]) -> None:
    """Write content, piece by piece, under the hash of what it was made from. Raises
    OutputError.
    """
    write_replaceable(path, _file(key, content))


def _file(key: str, content: Iterable[bytes]) -> Iterator[bytes]:
    yield key.encode()
    deflate = zlib.compressobj(1)
    for piece in content:
        yield deflate.compress(piece)
    yield deflate.flush()


def kept(path: Path, key: str) -> bytes | None:
    """The content of that hash; None where there is none, or it is damaged."""
    try:
        file = regular_bytes(path)
        same = file[:KEY_CHARACTERS] == key.encode()
        return zlib.decompress(file[KEY_CHARACTERS:]) if same else None
    except (OSError, zlib.error):
        return None


def _kept_object(path: Path, key: str) -> dict[str, Any]:
    """The object that JSON under that hash holds. Raises ValueError where there is none."""
    content = load_json(kept(path, key) or b"")
    if not isinstance(content, dict):
        raise ValueError("holds no object")
    return content


def _kept_record(kind: type[Record], path: Path, key: str) -> Record | None:
    """The record that JSON under that hash holds; None where there is none."""
    try:
        return as_record(kind, _kept_object(path, key))
    except ValueError:
        return None


@dataclass(frozen=True)
class KeptLight:
    """A solved light.

    note: what the run reported of it. light: the content of a Light, None = not used.
    linked: frames that show the same as the one before them.
    """

    note: str
    light: dict[str, Any] | None
    linked: Collection[str]

    def save(self, root: Path, key: str) -> None:
        """Keep it under the hash of all that it was solved from. Raises OutputError."""
        content = {
            "note": self.note,
            "light": self.light,
            "linked": StreamedList(lambda: self.linked),
        }
        keep(cache_file(root, "light"), key, JsonText(content))

    @classmethod
    def load(cls, root: Path, key: str) -> "KeptLight | None":
        """Read that of an earlier run; None where there is none."""
        try:
            content = _kept_object(cache_file(root, "light"), key)
            return cls(**{**content, "linked": Names(content["linked"])})
        except (ValueError, TypeError, KeyError):
            return None


@dataclass(frozen=True)
class KeptFit:
    """A finished fit. notes: what the run reported of it. sha256: of water.json after it."""

    notes: tuple[str, ...]
    sha256: str

    @classmethod
    def of(cls, notes: tuple[str, ...], content: Iterable[bytes]) -> "KeptFit":
        """Record a fit that gave the water.json of this content."""
        digest = hashlib.sha256()
        for piece in content:
            digest.update(piece)
        return cls(notes, digest.hexdigest())

    def save(self, root: Path, key: str) -> None:
        """Keep it under the hash of all that the waters were fitted to. Raises OutputError."""
        keep(cache_file(root, "fit"), key, JsonText(asdict(self)))

    @classmethod
    def load(cls, root: Path, key: str) -> "KeptFit | None":
        """Read that of an earlier run; None where there is none."""
        return _kept_record(cls, cache_file(root, "fit"), key)

    def waters(self, root: Path, names: Iterable[str]) -> Mapping[str, Water] | None:
        """Read the waters of water.json; None where it is gone, or not what the fit gave."""
        path = root / WATER
        try:
            same = hashlib.sha256(regular_bytes(path)).hexdigest() == self.sha256
            return read_waters(path, names) if same else None
        except (OSError, InputError):
            return None


@dataclass(frozen=True)
class KeptRefinement:
    """A refined rig.

    rig: the content of a native rig file. pairs: name -> SHA-256 of each file of the pairs it rests
    on. note: what the run said of it.
    """

    rig: dict[str, Any]
    pairs: Mapping[str, Mapping[str, str]]
    note: str

    def save(self, root: Path, key: str) -> None:
        """Keep it under the hash of the rig before and of how images are read. Raises
        OutputError.
        """
        keep(cache_file(root, "refined_rig"), key, JsonText(asdict(self)))

    @classmethod
    def load(cls, root: Path, key: str) -> "tuple[KeptRefinement, StereoRig] | None":
        """Read that of an earlier run, and its rig; None where there is none."""
        found = _kept_record(cls, cache_file(root, "refined_rig"), key)
        if found is None:
            return None
        try:
            return found, native.parse(Section("the refined rig", found.rig))
        except CalibrationError:
            return None


@dataclass(frozen=True)
class KeptRigCheck:
    """What the check of a dive's rig found.

    notes: of the run. ranges_are_wrong: of the dive. ranges: their error, where it was measured.
    left_out: name of a pair that is not of the dive's rig -> why.
    """

    notes: tuple[str, ...]
    ranges_are_wrong: bool
    ranges: RangeError | None
    left_out: Mapping[str, str]

    def save(self, root: Path, key: str) -> None:
        """Keep it under the hash of the rig and of the dive's pairs. Raises OutputError."""
        keep(cache_file(root, "rig_check"), key, JsonText(asdict(self)))

    @classmethod
    def load(cls, root: Path, key: str) -> "KeptRigCheck | None":
        """Read that of an earlier run; None where there is none."""
        return _kept_record(cls, cache_file(root, "rig_check"), key)


def forget_refinement(root: Path) -> None:
    """Delete the refined rig of an earlier run."""
    cache_file(root, "refined_rig").unlink(missing_ok=True)


@dataclass(frozen=True)
class Cost:
    """The cost of a run. memory_bytes: largest memory of one process."""

    core_hours: float
    wall_hours: float
    disk_bytes: int
    memory_bytes: int


@dataclass(frozen=True)
class Compared:
    """A predicted cost and the measured one, on so many cores. The predicted memory is that of a
    process that does one pair at a time.
    """

    cores: int
    planned: Cost
    measured: Cost


@dataclass(frozen=True)
class KeptPlan:
    """A prediction.

    pairs: that it holds for. core_seconds_per_pair: of one core. fit_s: seconds of one core for
    what is done once. disk_bytes: of the output. memory_bytes: of one process. pass_seconds: of one
    core for each pair, by pass.
    """

    pairs: int
    core_seconds_per_pair: float
    fit_s: float
    disk_bytes: int
    memory_bytes: int
    pass_seconds: dict[str, float]

    def save(self, root: Path, config: RunConfig) -> None:
        """Keep the prediction for a dive of so many pairs with these settings. Raises
        OutputError.
        """
        keep(cache_file(root, "plan"), _plan_key(self.pairs, config), JsonText(asdict(self)))

    @staticmethod
    def check_place(root: Path) -> None:
        """Raise OutputError where something else lies in the place of the prediction."""
        file = cache_file(root, "plan")
        try:
            key = regular_bytes(file)[:KEY_CHARACTERS].decode("ascii", "replace")
            if re.fullmatch(f"[0-9a-f]{{{KEY_CHARACTERS}}}", key) and kept(file, key):
                return
        except FileNotFoundError:
            return
        except OSError as error:
            raise OutputError(f"{file}: {error.strerror}") from error
        raise OutputError(
            f"{file}: is not a plan of this program: move it elsewhere, or give another --out"
        )

    @classmethod
    def load(cls, root: Path, pairs: int, config: RunConfig) -> "KeptPlan | None":
        """Read the prediction for a dive of so many pairs with these settings; None where there is
        none.
        """
        return _kept_record(cls, cache_file(root, "plan"), _plan_key(pairs, config))

    def cost(self, cores: int) -> Cost:
        """Compute the cost on so many cores; what is done once runs on one of them."""
        work_s = self.pairs * self.core_seconds_per_pair
        return Cost(
            (work_s + self.fit_s) / 3600,
            (work_s / cores + self.fit_s) / 3600,
            self.disk_bytes,
            self.memory_bytes,
        )


def _plan_key(pairs: int, config: RunConfig) -> str:
    return content_key(pairs, config.model_dump(mode="json"))


def used_bytes(root: Path) -> int:
    """Sum the sizes of all files of OUT."""
    return sum(path.stat().st_size for path in files_below(root))


# Pixels that a later pass over the dive needs, so that no input is decoded and rectified twice.


@dataclass(frozen=True)
class KeptPixelsLimits:
    """Limits of memory and disk."""

    memory_bytes: int = (
        160 << 20
        # 16 frames of 1.3 megapixels; reading one back from a file takes 4 ms where decoding takes
        # 30
    )
    free_disk_bytes: int = 4 << 30  # no files where less is free: OUT itself needs it


LIMITS = KeptPixelsLimits()


@dataclass(frozen=True, eq=False)
class FramePixels:
    """A rectified left image; its ranges and which of them were measured, None where they must be
    read from OUT.
    """

    image: Image
    range_m: Map | None = None
    measured: Mask | None = None

    def alone(self) -> "FramePixels":
        """Copy the ranges out of the larger block of memory that a match allocates, so that the
        block is freed.
        """
        return replace(self, range_m=None if self.range_m is None else self.range_m.copy())

    @property
    def size(self) -> int:
        """The bytes that it takes in memory."""
        return sum(
            array.nbytes for array in (self.image, self.range_m, self.measured) if array is not None
        )


class KeptPixels:
    """Pixels of frames, each under the hash of what they were made from.

    All processes of the run on this machine share the files: a process that does not hold OUT keeps
    pixels in files only, as a later pass may run in any process. A process of another machine keeps
    nothing: its file would cross the network twice.
    """

    def __init__(self, root: Path | None, in_memory: bool = True) -> None:
        self._root, self._in_memory = root, in_memory
        self._lock = Lock()
        self._memory: dict[tuple[str, str], FramePixels] = {}
        self._bytes = 0

    def __reduce__(
        self,
    ) -> tuple[Callable[[Path | None, str], "KeptPixels"], tuple[Path | None, str]]:
        return KeptPixels.on_worker, (self._root, platform.node())

    @classmethod
    def on_worker(cls, root: Path | None, host: str) -> "KeptPixels":
        """Open the pixels in another process. host: the machine of the process that holds OUT."""
        return cls(root if host == platform.node() else None, in_memory=False)

    def keep(self, name: str, key: str, pixels: FramePixels) -> None:
        """Keep a frame's pixels if there is room; frames that came first stay."""
        if self._root is None:
            return
        with self._lock:
            if (name, key) in self._memory:
                return
            fits = self._in_memory and self._bytes + pixels.size <= LIMITS.memory_bytes
            if fits:
                self._memory[name, key] = pixels.alone()
                self._bytes += pixels.size
        if not fits:
            self._write(self._file(self._root, name, key), pixels.image)

    def find(self, name: str, key: str) -> FramePixels | None:
        """Look up a frame's pixels; None where they are not kept."""
        found = self._memory.get((name, key))
        if found is not None or self._root is None:
            return found
        images = read_arrays(self._file(self._root, name, key), 1)
        return FramePixels(images[0]) if images else None

    def drop(self, name: str, key: str) -> None:
        """Delete the pixels of a frame that no later pass needs."""
        with self._lock:
            dropped = self._memory.pop((name, key), None)
            self._bytes -= dropped.size if dropped else 0
        if dropped is None and self._root is not None:
            with contextlib.suppress(OSError):
                self._file(self._root, name, key).unlink()

    def clear(self) -> None:
        """Delete all pixels, of all processes."""
        self._memory.clear()
        self._bytes = 0
        if self._root is not None:
            remove_leftovers(scratch_folder(self._root))
            with contextlib.suppress(OSError):
                scratch_folder(self._root).rmdir()

    @staticmethod
    def _file(root: Path, name: str, key: str) -> Path:
        """Named as a temporary file, which the next run removes where this one is killed."""
        return scratch_folder(root) / f"{TEMPORARY_PREFIX}{content_key(name, key)}.npy"

    @staticmethod
    def _write(file: Path, image: Image) -> None:
        with contextlib.suppress(OSError):  # a full disk: it is decoded again
            if file.exists():
                return
            file.parent.mkdir(exist_ok=True)
            if shutil.disk_usage(file.parent).free >= LIMITS.free_disk_bytes:
                write_arrays(file, [image])
