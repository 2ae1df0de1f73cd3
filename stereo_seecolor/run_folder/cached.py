"""What a run keeps in OUT so that a rerun does not compute it again."""

import zlib
from pathlib import Path

from stereo_seecolor.files.atomic import write_replaceable
from stereo_seecolor.files.encode import deflated

# The moment table of a frame, kept in OUT under the hash of what it was counted from.


def keep_table(path: Path, key: str, packed: bytes) -> None:
    """Write it. Raises OutputError."""
    write_replaceable(path, key.encode() + deflated(packed))


def kept_table(path: Path, key: str) -> bytes | None:
    """The table of that key, packed; None where there is none, or it is damaged."""
    try:
        content = path.read_bytes()
        return zlib.decompress(content[len(key) :]) if content.startswith(key.encode()) else None
    except (OSError, zlib.error):
        return None
