"""The stamp by which a file that the program wrote, or an input that it read, is recognized."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.files.contained import contained

ENDS_BYTES = 1 << 14
"""Bytes of a file's begin and end that go into its digest: an edited file differs there or in size; a cloud has 20 MB."""


@dataclass(frozen=True)
class Stamp:
    """A file's size in bytes, time of modification in nanoseconds, and a digest of its begin and end."""

    size: int
    mtime_ns: int
    digest: str

    @classmethod
    def of(cls, path: Path) -> "Stamp":
        """Compute the stamp of a file; of one in a bag: the bag's size and time, with a digest of its name in there. Raises
        OSError.
        """
        if inner := contained(path):
            status = inner.outer.stat()
            return cls(status.st_size, status.st_mtime_ns, hashlib.blake2b(inner.name.encode(), digest_size=8).hexdigest())
        status = path.stat()
        return cls(status.st_size, status.st_mtime_ns, _digest(path, status.st_size))

    def matches(self, path: Path) -> bool:
        """Tell whether ``path`` is a regular file, no link, that is still the one stamped; a copy with another time is."""
        try:
            status = path.lstat()
            if path.is_symlink() or status.st_size != self.size:
                return False
            return status.st_mtime_ns == self.mtime_ns or _digest(path, self.size) == self.digest
        except OSError:
            return False


def _digest(path: Path, size: int) -> str:
    with path.open("rb") as file:
        ends = file.read(ENDS_BYTES)
        file.seek(max(size - ENDS_BYTES, 0))
        ends += file.read(ENDS_BYTES)
    return hashlib.blake2b(ends, digest_size=8).hexdigest()
