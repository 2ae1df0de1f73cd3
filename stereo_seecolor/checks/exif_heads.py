"""What EXIF states at the head of an image file, of the pairs that checks look at; each file is
read once.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from stereo_seecolor.inputs.capture import focal_mm, orientation

LOOKED_AT = 500
"""Pairs, spread over the dive, whose tags are read: 1000 heads of files take about a second."""
HEAD_BYTES = 1 << 16
"""Of a file: EXIF is one of the first segments of a JPEG, which hold at most so much."""


@dataclass(frozen=True)
class ExifHead:
    """orientation: 1 to 8. focal_mm: of the lens; None where it is not stated."""

    orientation: int = 1
    focal_mm: float | None = None


def exif_head(path: Path) -> ExifHead:
    """The tags of a file; none of what lies in a video or a bag, or cannot be read."""
    try:
        if not path.is_file():
            return ExifHead()
        facts = path.stat()
        return _head(path, facts.st_mtime_ns, facts.st_size)
    except OSError:
        return ExifHead()


@lru_cache(maxsize=4 * LOOKED_AT)
def _head(path: Path, _modified_ns: int, _size: int) -> ExifHead:
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    return ExifHead(orientation(head), focal_mm(head))
