"""What a run keeps in OUT/.state so that a rerun need not find it again: light, fit of the water,
refined rig, and plan.

Each record is JSON under the hash of what it was made from; one that is damaged is as if it were
not there.
"""

import hashlib
import json
import zlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calibration import CalibrationError, StereoRig
from calibration.formats import native
from stereo_seecolor.compute.sequences import Names
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files.atomic import files_below, write_atomic, write_replaceable
from stereo_seecolor.files.contained import regular_bytes
from stereo_seecolor.files.encode import deflated
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.files.json_values import JsonText, StreamedList
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.run_folder.dive_files import read_waters
from stereo_seecolor.run_folder.layout import (
    WATER,
    fit_file,
    light_file,
    plan_file,
    refinement_files,
)
from stereo_seecolor.water.model import Water


@dataclass(frozen=True)
class KeptLight:
    """A solved light.

    key: hash of all that it was solved from. note: what the run reported of it. light: the content
    of a Light, None = not used.
    linked: frames that show the same as the one before them.
    """

    key: str
    note: str
    light: dict[str, Any] | None
    linked: Collection[str]

    def save(self, root: Path) -> None:
        """Write the record. Raises OutputError."""
        content = {
            "key": self.key,
            "note": self.note,
            "light": self.light,
            "linked": StreamedList(lambda: self.linked),
        }
        write_atomic(light_file(root), JsonText(content))

    @classmethod
    def load(cls, root: Path) -> "KeptLight | None":
        """Read the record of an earlier run; None where there is none, or it is damaged."""
        try:
            content = load_object(light_file(root))
            return cls(**{**content, "linked": Names(content["linked"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None


@dataclass(frozen=True)
class KeptFit:
    """A finished fit. key: hash of all that the waters were fitted to. notes: what the run reported
    of the fit. sha256: of water.json after it.
    """

    key: str
    notes: tuple[str, ...]
    sha256: str

    @classmethod
    def of(cls, key: str, notes: tuple[str, ...], content: Iterable[bytes]) -> "KeptFit":
        """Record a fit that gave the water.json of this content."""
        digest = hashlib.sha256()
        for piece in content:
            digest.update(piece)
        return cls(key, notes, digest.hexdigest())

    def save(self, root: Path) -> None:
        """Write the record. Raises OutputError."""
        write_atomic(fit_file(root), json.dumps(asdict(self)).encode())

    @classmethod
    def load(cls, root: Path) -> "KeptFit | None":
        """Read the record of an earlier run; None where there is none, or it is damaged."""
        try:
            return as_record(cls, load_object(fit_file(root)))
        except (OSError, ValueError):
            return None

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
    """A refinement as OUT keeps it.

    key: hash of the rig before and of how images are read. pairs: name -> SHA-256 of each file of
    the pairs it rests on.
    note: what the run said of it.
    """

    key: str
    pairs: Mapping[str, Mapping[str, str]]
    note: str

    def save(self, root: Path, rig: StereoRig) -> None:
        """Write the record with the rig that the run uses. Raises OutputError."""
        rig_file, file = refinement_files(root)
        write_atomic(rig_file, native.to_bytes(rig))
        write_atomic(file, json.dumps(asdict(self)).encode())

    @classmethod
    def load(cls, root: Path) -> "tuple[KeptRefinement, StereoRig] | None":
        """Read the record of an earlier run, and its rig; None where there is none, or it is
        damaged.
        """
        rig_file, file = refinement_files(root)
        try:
            return as_record(cls, load_object(file)), native.read(rig_file)
        except (OSError, ValueError, CalibrationError):
            return None


def forget_refinement(root: Path) -> None:
    """Delete the record of an earlier run."""
    for file in refinement_files(root):
        file.unlink(missing_ok=True)


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

    pairs, settings: number of pairs, and hash of the settings, that it holds for.
    core_seconds_per_pair: of one core. fit_s:
    seconds of one core for what is done once. disk_bytes: of the output. memory_bytes: of one
    process. pass_seconds: of one core for each pair, by pass.
    """

    pairs: int
    settings: str
    core_seconds_per_pair: float
    fit_s: float
    disk_bytes: int
    memory_bytes: int
    pass_seconds: dict[str, float]

    def save(self, root: Path) -> None:
        """Write the prediction. Raises OutputError."""
        write_atomic(plan_file(root), json.dumps(asdict(self)).encode())

    @staticmethod
    def check_place(root: Path) -> None:
        """Raise OutputError where something else lies in the place of the prediction."""
        file = plan_file(root)
        try:
            as_record(KeptPlan, load_object(file))
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            raise OutputError(
                f"{file}: is not a plan of this program: move it elsewhere, or give another --out"
            ) from error

    @classmethod
    def load(cls, root: Path, pairs: int, config: RunConfig) -> "KeptPlan | None":
        """Read the prediction for a dive of so many pairs with these settings; None where there is
        none, or it is damaged.
        """
        try:
            plan = as_record(cls, load_object(plan_file(root)))
        except (OSError, ValueError):
            return None
        return plan if (plan.pairs, plan.settings) == (pairs, settings_key(config)) else None

    def cost(self, cores: int) -> Cost:
        """Compute the cost on so many cores; what is done once runs on one of them."""
        work_s = self.pairs * self.core_seconds_per_pair
        return Cost(
            (work_s + self.fit_s) / 3600,
            (work_s / cores + self.fit_s) / 3600,
            self.disk_bytes,
            self.memory_bytes,
        )


def settings_key(config: RunConfig) -> str:
    """Hash all settings."""
    return content_key(config.model_dump(mode="json"))


def used_bytes(root: Path) -> int:
    """Sum the sizes of all files of OUT."""
    return sum(path.stat().st_size for path in files_below(root))


def keep_table(path: Path, key: str, packed: bytes) -> None:
    """Write it. Raises OutputError."""
    write_replaceable(path, key.encode() + deflated(packed))


def kept_table(path: Path, key: str) -> bytes | None:
    """The table of that key, packed; None where there is none, or it is damaged."""
    try:
        content = regular_bytes(path)
        return zlib.decompress(content[len(key) :]) if content.startswith(key.encode()) else None
    except (OSError, zlib.error):
        return None
