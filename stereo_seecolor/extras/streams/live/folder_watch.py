"""Pairs from two folders that receive files: the newest pair that was not taken.

Folders are listed repeatedly, since network shares do not notify of changes.
"""

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.listing import EXTENSIONS
from stereo_seecolor.inputs.pairing import Pair, pair_files
from stereo_seecolor.records import StereoFrame

TAIL = 64
"""Newest files of each side that are paired: those of one side may arrive some pairs late."""

RELIST_S = 1.0
"""Most seconds between listings: a folder's modification time is too coarse for 4 ms."""


@dataclass
class _Side:
    """One folder. names: at the last listing. new: files that have arrived and were not taken.
    absent_s: when each file was not there yet, or the program not: since 1970.
    """

    folder: Path
    names: set[str] = field(default_factory=set)
    absent_s: dict[str, float] = field(default_factory=dict)
    looked_s: float = 0.0
    new: list[Path] = field(default_factory=list)
    modified_ns: int = -1
    listed_s: float = 0.0

    def look(self) -> bool:
        """List the folder if it may have changed; False where it cannot be listed."""
        try:
            began_s = time.time()
            modified_ns, now_s = self.folder.stat().st_mtime_ns, time.monotonic()
            if modified_ns != self.modified_ns or now_s - self.listed_s > RELIST_S:
                names = set(_image_names(self.folder))
                added = sorted(names - self.names, key=natural_key)
                self.absent_s = {name: self.absent_s[name] for name in self.names & names} | (
                    dict.fromkeys(added, self.looked_s or began_s)
                )
                self.names, self.modified_ns, self.listed_s = names, modified_ns, now_s
                self.new = [path for path in self.new if path.name in names] + [
                    self.folder / name for name in added
                ]
            self.looked_s = began_s
        except OSError:
            self.modified_ns = -1
            return False
        return True

    def arrived_s(self, path: Path) -> float:
        """When a file was written; not before the program looked for it, as what was copied with
        its old time, or was there before, did not arrive then. Raises OSError.
        """
        return max(path.stat().st_mtime, self.absent_s.get(path.name, 0.0))


class FolderWatch:
    """A live source of two folders. dropped: left images skipped. waiting: see ``newest``."""

    def __init__(self, left: Path, right: Path, config: InputConfig) -> None:
        self.dropped = 0
        self.waiting = ""
        self._left, self._right = _Side(left), _Side(right)
        self._config = config

    def newest(self) -> Pair | None:
        """The newest pair that was not taken, or None.

        ``waiting`` names folders that are missing or cannot be read.
        """
        lost = [str(side.folder) for side in (self._left, self._right) if not side.look()]
        self.waiting = " and ".join(lost)
        if lost or not self._left.new or not self._right.new:
            return None
        try:
            return pair_files(
                self._left.new[-TAIL:], self._right.new[-TAIL:], self._config, "live"
            ).pairs[-1]
        except InputError:
            return None  # partners have not come yet

    def read(self, pair: Pair) -> StereoFrame:
        """Both images. Raises InputError."""
        return read_sides(pair, self._config)

    def take(self, pair: Pair) -> None:
        """Mark this pair and all before it as done."""
        passed = self._left.new.index(pair.left)
        self.dropped += passed
        self._left.new = self._left.new[passed + 1 :]
        self._right.new = self._right.new[self._right.new.index(pair.right) + 1 :]

    @property
    def ended(self) -> bool:
        """False: more files may always arrive."""
        return False

    def latency_s(self, pair: Pair) -> float:
        """Seconds since the later of a pair's files came; 0 if the disk's clock is ahead."""
        try:
            arrived_s = max(self._left.arrived_s(pair.left), self._right.arrived_s(pair.right))
        except OSError:
            return 0.0
        return max(0.0, time.time() - arrived_s)


def read_sides(pair: Pair, config: InputConfig) -> StereoFrame:
    """Read the images of a pair's two files at the same time, unrectified. Raises InputError."""
    left, right = core_pool().map(lambda path: read_image(path, config), (pair.left, pair.right))
    return StereoFrame(pair.name, left, right, pair.timestamp_s)


def _image_names(folder: Path) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if (
                not entry.name.startswith(".")
                and os.path.splitext(entry.name)[1].lower() in EXTENSIONS  # noqa: PTH122
            ):
                yield entry.name
