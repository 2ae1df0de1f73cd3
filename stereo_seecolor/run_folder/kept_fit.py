"""Record of what the waters of water.json were fitted to, kept in OUT so that a rerun that changes nothing does not fit them
again.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.run_folder.layout import WATER, fit_file
from stereo_seecolor.run_folder.water_file import read_waters
from stereo_seecolor.water.model import Water


@dataclass(frozen=True)
class KeptFit:
    """A finished fit. key: hash of all that the waters were fitted to. notes: what the run reported of the fit. sha256: of
    water.json after it.
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
            with path.open("rb") as file:
                same = hashlib.file_digest(file, "sha256").hexdigest() == self.sha256
            return read_waters(path, names) if same else None
        except (OSError, InputError):
            return None
