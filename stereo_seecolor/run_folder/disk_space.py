"""The disk space that a run needs: stated before it begins; a run that cannot finish is refused."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from calibration.errors import counted
from stereo_seecolor.config import OutputConfig
from stereo_seecolor.errors import OutputError


@dataclass(frozen=True)
class BytesAPixel:
    """Bytes for each pixel of a product, measured on synthetic pairs of 1280x1024 with 8 bits
    (docs/performance.md, *Disk*); real ones take as much or less.
    """

    cloud: float = 13.8
    picture: float = 1.6
    map: float = 4.0
    deflated_range: float = 2.1
    deflated_std: float = 1.2
    others: float = 0.25
    least: float = 0.4
    """Fraction of the need that a run takes at least: clouds hold known pixels only, pictures of
    haze are small.
    """


BYTES = BytesAPixel()


def need_bytes(output: OutputConfig, pixels: int, corrected: bool) -> float:
    """Estimate the bytes of a pair. corrected: with picture and cloud, not with range alone."""
    total = BYTES.others
    total += BYTES.deflated_range + BYTES.deflated_std if output.deflated_maps else 2 * BYTES.map
    total += corrected * (BYTES.picture + BYTES.cloud * output.with_clouds)
    return pixels * total


def check_disk(root: Path, pairs: int, pair_bytes: float, output: OutputConfig) -> tuple[str, bool]:
    """One line on the space that so many pairs need on the disk of OUT, for the user, before the
    work begins; and whether the disk may turn out too small. Raises OutputError where it is.
    """
    need, free = pairs * pair_bytes, shutil.disk_usage(root).free
    needs = f"{counted(pairs, 'pair')} need{'s' if pairs == 1 else ''}"
    line = f"disk: {needs} about {need / 1e9:.2g} GB, and {free / 1e9:.2g} GB are free"
    if need * BYTES.least > free:
        lean = "" if output.preset == "lean" else "set output.preset=lean, or "
        raise OutputError(f"{root}: {line}: {lean}choose an --out on another disk")
    return line, need > free
