"""The input files of a frame as the manifest records them: path, stamp, hash."""

import hashlib
from dataclasses import replace
from pathlib import Path

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import find_contained
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.run_folder.manifest import InputRecord
from stereo_seecolor.run_folder.stamp import DIGEST_BYTES, Stamp


def input_record(path: Path, known: InputRecord | None) -> InputRecord:
    """Record a file with its hash; that of ``known`` is taken where size and time are the same.
    Raises InputError if it cannot be read.
    """
    try:
        inner = find_contained(path)
        status = (inner.outer if inner else path).stat()
        same_name = inner is None or (known is not None and known.path.endswith(inner.name))
        if (
            known
            and same_name
            and (status.st_size, status.st_mtime_ns) == (known.stamp.size, known.stamp.mtime_ns)
        ):
            return replace(known, path=str(path))
        sha256 = hashlib.sha256(read_bytes(path)).hexdigest()
        return InputRecord(
            str(path), Stamp(status.st_size, status.st_mtime_ns, sha256[: 2 * DIGEST_BYTES]), sha256
        )
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
