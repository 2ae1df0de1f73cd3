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
    """Estimate the bytes of a pair. corrected: with its picture and cloud, not with its range
    alone.
    """
    total = BYTES.others
    total += BYTES.deflated_range + BYTES.deflated_std if output.deflated_maps else 2 * BYTES.map
    total += corrected * (BYTES.picture + BYTES.cloud * output.with_clouds)
    return pixels * total


@dataclass(frozen=True)
class DiskSpace:
    """The bytes that a number of pairs need on the disk of OUT, and the bytes that are free
    there.
    """

    pairs: int
    need: float
    free: float

    @classmethod
    def checked(cls, root: Path, pairs: int, pair_bytes: float) -> "DiskSpace":
        """Compute need and free space for the pairs that are left. Raises OutputError where the
        disk is too small.
        """
        room = cls(pairs, pairs * pair_bytes, shutil.disk_usage(root).free)
        if room.need * BYTES.least > room.free:
            raise OutputError(
                f"{root}: {room.line}: set output.preset=lean, or choose an --out on another disk"
            )
        return room

    @property
    def line(self) -> str:
        """One line for the user, before the work begins."""
        needs = f"{counted(self.pairs, 'pair')} need{'s' if self.pairs == 1 else ''}"
        return (
            f"disk: {needs} about {self.need / 1e9:.2g} GB, and {self.free / 1e9:.2g} GB are free"
        )

    @property
    def is_low(self) -> bool:
        """Tell whether the disk may turn out too small."""
        return self.need > self.free
