"""How much room a run takes on the disk: said before it begins, and refused where it cannot end."""

import logging
import shutil
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.config import OutputConfig
from stereo_seecolor.errors import OutputError

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class BytesAPixel:
    """Of each product, on drawn pairs of 1280x1024 with 8 bits (docs/performance.md, *Disk*): real ones take as much or less."""

    cloud: float = 13.8
    picture: float = 1.6
    map: float = 4.0
    deflated_range: float = 2.1
    deflated_std: float = 1.2
    others: float = 0.25
    least: float = 0.4
    """Fraction of the need that a run takes at least: clouds hold known pixels only, pictures of haze are small."""


BYTES = BytesAPixel()


def need_bytes(output: OutputConfig, pixels: int, corrected: bool) -> float:
    """What a pair of so many pixels takes. corrected: with its picture and cloud, not with its range alone."""
    deflated = output.map_compression is not None
    total = BYTES.others + (BYTES.deflated_range if deflated else BYTES.map)
    total += output.range_std * (BYTES.deflated_std if deflated else BYTES.map)
    total += corrected * (BYTES.picture + BYTES.cloud * output.with_clouds)
    return pixels * total


def check_room(root: Path, pairs: int, pair_bytes: float) -> str:
    """A warning where the disk of OUT may be too small for so many more pairs, else "". Raises OutputError where it is."""
    need, free = pairs * pair_bytes, shutil.disk_usage(root).free
    line = f"{pairs} pairs need about {need / 1e9:.2g} GB, and {free / 1e9:.2g} GB are free"
    log.info("disk: %s", line)
    if need * BYTES.least > free:
        raise OutputError(f"{root}: {line}: set output.preset=lean, or choose an --out on another disk")
    return f"disk: {line}" if need > free else ""
