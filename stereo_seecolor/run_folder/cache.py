"""The cache of a run: what it found and a rerun need not find again, in OUT/.state: moment tables,
light, fit of the water, refined rig, and plan.

Each file begins with the hash of what its content was made from; the content is deflated. A file
that is damaged, or of another hash, is as if it were not there.
"""

import hashlib
import re
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calibration import CalibrationError, StereoRig
from calibration.bounded_text import load_json
from calibration.formats import native
from calibration.formats.reading.section import Section
from calibration.rig_errors import RangeError
from stereo_seecolor.compute.names import Names
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files.atomic import files_below, write_replaceable
from stereo_seecolor.files.json_records import Record, as_record
from stereo_seecolor.files.json_values import JsonText, StreamedList
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.whole_files import regular_bytes
from stereo_seecolor.run_folder.layout import WATER, cache_file
from stereo_seecolor.run_folder.water_file import read_waters
from stereo_seecolor.water.model import Water

KEY_CHARACTERS = 64
"""Of a hash by ``content_key``."""


def keep(path: Path, key: str, content: Iterable[bytes]) -> None:
    """Write content, piece by piece, under the hash of its sources. Raises OutputError."""
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
    text = kept(path, key)
    content = load_json(text or b"")
    if not isinstance(content, dict):
        raise ValueError("holds no object")
    return content


def _kept_record(kind: type[Record], path: Path, key: str) -> Record | None:
    """The record that JSON under that hash holds; None where there is none."""
    try:
        content = _kept_object(path, key)
        return as_record(kind, content)
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
        """Keep it under the hash of the rig before and of the settings. Raises OutputError."""
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
        """Keep the prediction for so many pairs with these settings. Raises OutputError."""
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
        """Read the prediction for so many pairs with these settings; None if none."""
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
