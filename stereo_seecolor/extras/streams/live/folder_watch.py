"""Pairs from two folders that receive files: the newest pair that was not taken.

Folders are listed repeatedly, since network shares do not notify of changes.
"""

import os
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.listing import EXTENSIONS
from stereo_seecolor.inputs.pairing import Pair, pair_files
from stereo_seecolor.records import StereoFrame

TAIL = 64
"""Newest files of each side that are paired: those of one side may arrive some pairs late. As many
that were taken show what is common to all names of a side.
"""

RELIST_S = 1.0
"""Most seconds between listings: a folder's modification time is too coarse for 4 ms."""


@dataclass
class _Side:
    """One folder. names: at the last listing. new: files that have arrived and were not taken.
    taken: the last others. absent_s: when each file was not there yet, or the program not: since
    1970.
    """

    folder: Path
    names: set[str] = field(default_factory=set)
    absent_s: dict[str, float] = field(default_factory=dict)
    looked_s: float = 0.0
    new: list[Path] = field(default_factory=list)
    taken: deque[Path] = field(default_factory=lambda: deque(maxlen=TAIL))
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

    def take(self, path: Path) -> int:
        """Mark this file and all that arrived before it as done; returns how many came before."""
        passed = self.new.index(path)
        self.taken.extend(self.new[: passed + 1])
        self.new = self.new[passed + 1 :]
        return passed

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
        self._alone: tuple[list[Path], list[Path], str] = ([], [], "")
        self._first: Path | None = None
        self._last: Path | None = None

    def newest(self) -> Pair | None:
        """The newest pair that was not taken, or None.

        ``waiting`` names folders that are missing or cannot be read, else those without a new
        image, else says why no new image has a partner.
        """
        sides = self._left, self._right
        lost = [str(side.folder) for side in sides if not side.look()]
        self.waiting = " and ".join(lost or [str(side.folder) for side in sides if not side.new])
        if self.waiting:
            return None
        lefts, rights = (side.new[-TAIL:] for side in sides)
        if self._alone[:2] != (lefts, rights):
            try:
                return self._newest_of(lefts, rights)
            except InputError as error:
                self._alone = lefts, rights, f"partners: {error}"
        self.waiting = self._alone[2]
        return None

    def _newest_of(self, lefts: list[Path], rights: list[Path]) -> Pair:
        """The newest pair of these files. Raises InputError where there is none."""
        try:
            return self._pairs(lefts, rights)[-1]
        except InputError:
            # names may differ in more than a word for the side, which one new file does not show
            with suppress(InputError):
                for pair in reversed(
                    self._pairs([*self._left.taken, *lefts], [*self._right.taken, *rights])
                ):
                    if pair.left in lefts and pair.right in rights:
                        return pair
            raise

    def _pairs(self, lefts: list[Path], rights: list[Path]) -> Sequence[Pair]:
        """Raises InputError where there are none: partners may not have come yet, so that neither
        another clock nor another counter is concluded from it.
        """
        where = f"{self._left.folder} and {self._right.folder}"
        lefts, rights = list(dict.fromkeys(lefts)), list(dict.fromkeys(rights))
        return pair_files(lefts, rights, self._config, where, complete=False).pairs

    def read(self, pair: Pair) -> StereoFrame:
        """Both images. Raises InputError."""
        return read_sides(pair, self._config)

    def take(self, pair: Pair) -> None:
        """Mark this pair and all before it as done."""
        # files may arrive in any order
        self._first = min(self._first or pair.left, pair.left, key=_order)
        self._last = max(self._last or pair.left, pair.left, key=_order)
        self.dropped += self._left.take(pair.left)
        self._right.take(pair.right)

    def still_there(self) -> Sequence[Pair]:
        """The pairs from the first that was taken to the last, without files that were removed."""
        try:
            pairs = pair_sides(self._left.folder, self._right.folder, self._config).pairs
        except InputError:
            return ()
        lefts = [pair.left for pair in pairs]
        first = lefts.index(self._first) if self._first in lefts else 0
        return pairs[first : lefts.index(self._last) + 1] if self._last in lefts else ()

    @property
    def has_unpaired(self) -> bool:
        """True where files of a side were not taken."""
        return bool(self._left.new or self._right.new)

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


def _order(path: Path) -> str:
    return natural_key(path.name)


def _image_names(folder: Path) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if (
                not entry.name.startswith(".")
                and os.path.splitext(entry.name)[1].lower() in EXTENSIONS  # noqa: PTH122
            ):
                yield entry.name
