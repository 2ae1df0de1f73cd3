"""The cache of a run: what it found and a rerun need not find again, in OUT/.state: moment tables,
light, fit of the water, refined rig, and plan.

Each file begins with the hash of what its content was made from; the content is deflated. A file
that is damaged, or of another hash, is as if it were not there.
"""

import hashlib
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from calibration import CalibrationError, StereoRig
from calibration.bounded_text import load_json
from calibration.formats import native
from calibration.formats.reading.section import Section
from calibration.rig_errors import RangeError
from stereo_seecolor.compute.names import Names
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files.atomic import files_below, write_replaceable
from stereo_seecolor.files.json_records import as_record
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


@dataclass(frozen=True)
class _Kept:
    """A record that the cache holds. file: its name there."""

    file: ClassVar[str]

    def save(self, root: Path, key: str) -> None:
        """Keep it under the hash of all that it was made from. Raises OutputError."""
        keep(cache_file(root, self.file), key, JsonText(self._content()))

    @classmethod
    def load(cls, root: Path, key: str) -> Self | None:
        """Read that of an earlier run; None where there is none."""
        try:
            return as_record(cls, load_json(kept(cache_file(root, cls.file), key) or b""))
        except ValueError:
            return None

    def _content(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class KeptLight(_Kept):
    """A solved light.

    note: what the run reported of it. light: the content of a Light, None = not used.
    linked: frames that show the same as the one before them.
    """

    file = "light"
    note: str
    light: dict[str, Any] | None
    linked: Sequence[str]

    @classmethod
    def load(cls, root: Path, key: str) -> Self | None:
        """Read that of an earlier run; None where there is none."""
        found = super().load(root, key)
        return found and replace(found, linked=Names(found.linked))

    def _content(self) -> dict[str, Any]:
        return {**vars(self), "linked": StreamedList(lambda: self.linked)}


@dataclass(frozen=True)
class KeptFit(_Kept):
    """A finished fit. notes: what the run reported of it. sha256: of water.json after it."""

    file = "fit"
    notes: tuple[str, ...]
    sha256: str

    @classmethod
    def of(cls, notes: tuple[str, ...], content: Iterable[bytes]) -> "KeptFit":
        """Record a fit that gave the water.json of this content."""
        digest = hashlib.sha256()
        for piece in content:
            digest.update(piece)
        return cls(notes, digest.hexdigest())

    def waters(self, root: Path, names: Iterable[str]) -> Mapping[str, Water] | None:
        """Read the waters of water.json; None where it is gone, or not what the fit gave."""
        path = root / WATER
        try:
            same = hashlib.sha256(regular_bytes(path)).hexdigest() == self.sha256
            return read_waters(path, names) if same else None
        except (OSError, InputError):
            return None


@dataclass(frozen=True)
class KeptRefinement(_Kept):
    """A refined rig.

    rig: the content of a native rig file. pairs: name -> SHA-256 of each file of the pairs it rests
    on. note: what the run said of it.
    """

    file = "refined_rig"
    rig: dict[str, Any]
    pairs: Mapping[str, Mapping[str, str]]
    note: str

    @property
    def stereo_rig(self) -> StereoRig | None:
        """The rig; None where its content is damaged."""
        try:
            return native.parse(Section("the refined rig", self.rig))
        except CalibrationError:
            return None


@dataclass(frozen=True)
class KeptRigCheck(_Kept):
    """What the check of a dive's rig found.

    notes: of the run. ranges_are_wrong: of the dive. ranges: their error, where it was measured.
    left_out: name of a pair that is not of the dive's rig -> why.
    """

    file = "rig_check"
    notes: tuple[str, ...]
    ranges_are_wrong: bool
    ranges: RangeError | None
    left_out: Mapping[str, str]


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
class KeptPlan(_Kept):
    """A prediction, kept under its ``key``.

    pairs: that it holds for. core_seconds_per_pair: of one core. fit_s: seconds of one core for
    what is done once. disk_bytes: of the output. memory_bytes: of one process. pass_seconds: of one
    core for each pair, by pass.
    """

    file = "plan"
    pairs: int
    core_seconds_per_pair: float
    fit_s: float
    disk_bytes: int
    memory_bytes: int
    pass_seconds: dict[str, float]

    @staticmethod
    def key(pairs: int, config: RunConfig) -> str:
        """The hash of so many pairs with these settings."""
        return content_key(pairs, config.model_dump(mode="json"))

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

    def cost(self, cores: int) -> Cost:
        """Compute the cost on so many cores; what is done once runs on one of them."""
        work_s = self.pairs * self.core_seconds_per_pair
        return Cost(
            (work_s + self.fit_s) / 3600,
            (work_s / cores + self.fit_s) / 3600,
            self.disk_bytes,
            self.memory_bytes,
        )


def used_bytes(root: Path) -> int:
    """Sum the sizes of all files of OUT."""
    return sum(path.stat().st_size for path in files_below(root))
