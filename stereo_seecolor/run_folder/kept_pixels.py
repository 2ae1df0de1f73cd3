"""Pixels that a later pass over the dive needs, so that no input is decoded and rectified twice."""

import contextlib
import platform
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.files.atomic import TEMPORARY_PREFIX, remove_leftovers
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.raw_arrays import read_arrays, write_arrays
from stereo_seecolor.records import Image, Map, Mask
from stereo_seecolor.run_folder.layout import SCRATCH, state


@dataclass(frozen=True)
class KeptPixelsLimits:
    """Limits of memory and disk."""

    memory_bytes: int = (
        160 << 20
        # 16 frames of 1.3 megapixels; reading one back from a file takes 4 ms where decoding takes
        # 30
    )
    free_disk_bytes: int = 4 << 30  # no files where less is free: OUT itself needs it


LIMITS = KeptPixelsLimits()


@dataclass(frozen=True, eq=False)
class FramePixels:
    """A rectified left image; its ranges and which were measured, None: to read from OUT."""

    image: Image
    range_m: Map | None = None
    measured: Mask | None = None

    @property
    def size(self) -> int:
        """The bytes that it takes in memory."""
        return sum(
            array.nbytes for array in (self.image, self.range_m, self.measured) if array is not None
        )


class KeptPixels:
    """Pixels of frames, each under the hash of what they were made from.

    All processes of the run on this machine share the files: a process that does not hold OUT keeps
    pixels in files only, as a later pass may run in any process. A process of another machine keeps
    nothing: its file would cross the network twice.
    """

    def __init__(self, root: Path | None, in_memory: bool = True) -> None:
        self._root, self._in_memory = root, in_memory
        self._lock = Lock()
        self._memory: dict[tuple[str, str], FramePixels] = {}
        self._bytes = 0

    def __reduce__(
        self,
    ) -> tuple[Callable[[Path | None, str], "KeptPixels"], tuple[Path | None, str]]:
        return KeptPixels.on_worker, (self._root, platform.node())

    @classmethod
    def on_worker(cls, root: Path | None, host: str) -> "KeptPixels":
        """Open the pixels in another process. host: the machine of the process that holds OUT."""
        return cls(root if host == platform.node() else None, in_memory=False)

    def keep(self, name: str, key: str, pixels: FramePixels) -> None:
        """Keep a frame's pixels if there is room; frames that came first stay."""
        if self._root is None:
            return
        with self._lock:
            if (name, key) in self._memory:
                return
            fits = self._in_memory and self._bytes + pixels.size <= LIMITS.memory_bytes
            if fits:
                # out of the larger block of memory that a match allocates, which is freed then
                range_m = None if pixels.range_m is None else pixels.range_m.copy()
                self._memory[name, key] = replace(pixels, range_m=range_m)
                self._bytes += pixels.size
        if not fits:
            self._write(self._file(self._root, name, key), pixels.image)

    def find(self, name: str, key: str) -> FramePixels | None:
        """Look up a frame's pixels; None where they are not kept."""
        found = self._memory.get((name, key))
        if found is not None or self._root is None:
            return found
        images = read_arrays(self._file(self._root, name, key), 1)
        return FramePixels(images[0]) if images else None

    def drop(self, name: str, key: str) -> None:
        """Delete the pixels of a frame that no later pass needs."""
        with self._lock:
            dropped = self._memory.pop((name, key), None)
            self._bytes -= dropped.size if dropped else 0
        if dropped is None and self._root is not None:
            with contextlib.suppress(OSError):
                self._file(self._root, name, key).unlink()

    def clear(self) -> None:
        """Delete all pixels, of all processes."""
        self._memory.clear()
        self._bytes = 0
        if self._root is not None:
            remove_leftovers(state(self._root, SCRATCH))
            with contextlib.suppress(OSError):
                state(self._root, SCRATCH).rmdir()

    @staticmethod
    def _file(root: Path, name: str, key: str) -> Path:
        """Named as a temporary file, which the next run removes where this one is killed."""
        return state(root, SCRATCH) / f"{TEMPORARY_PREFIX}{content_key(name, key)}.npy"

    @staticmethod
    def _write(file: Path, image: Image) -> None:
        with contextlib.suppress(OSError):  # a full disk: it is decoded again
            if file.exists():
                return
            file.parent.mkdir(exist_ok=True)
            if shutil.disk_usage(file.parent).free >= LIMITS.free_disk_bytes:
                write_arrays(file, [image])
