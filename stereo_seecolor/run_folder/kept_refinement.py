"""The outcome of the refinement of a run's rig, kept in OUT so that a rerun uses the same rig and does not refine again."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from calibration import CalibrationError, StereoRig
from calibration.formats import native
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.run_folder.layout import refinement_files


@dataclass(frozen=True)
class KeptRefinement:
    """A refinement as OUT keeps it.

    key: hash of the rig before and of how images are read. pairs: name -> SHA-256 of each file of the pairs it rests on.
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
        """Read the record of an earlier run, and its rig; None where there is none, or it is damaged."""
        rig_file, file = refinement_files(root)
        try:
            return as_record(cls, load_object(file)), native.read(rig_file)
        except (OSError, ValueError, CalibrationError):
            return None


def forget_refinement(root: Path) -> None:
    """Delete the record of an earlier run."""
    for file in refinement_files(root):
        file.unlink(missing_ok=True)
