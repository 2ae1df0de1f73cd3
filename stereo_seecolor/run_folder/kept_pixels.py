"""Pixels that a later pass over the dive needs again, so that no input is decoded and rectified twice: bounded in memory, the rest
in files of OUT that only this run reads.
"""

import contextlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.files.atomic import temporary_path
from stereo_seecolor.records import Image, Map, Mask
from stereo_seecolor.run_folder.layout import scratch_folder


@dataclass(frozen=True)
class KeptPixelsLimits:
    """How much is kept."""

    memory_bytes: int = 160 << 20  # 16 frames of 1.3 megapixels; reading one back from a file takes 4 ms where decoding takes 30
    free_disk_bytes: int = 4 << 30  # no files where less is free: OUT itself needs it


LIMITS = KeptPixelsLimits()


@dataclass(frozen=True, eq=False)
class FramePixels:
    """A rectified left image; its ranges and which of them were measured, None where they must be read from OUT."""

    image: Image
    range_m: Map | None = None
    measured: Mask | None = None

    def alone(self) -> "FramePixels":
        """The same without the larger block of memory that the ranges are a part of, with all else that a match makes."""
        return replace(self, range_m=None if self.range_m is None else self.range_m.copy())

    @property
    def size(self) -> int:
        """Bytes in memory."""
        return sum(array.nbytes for array in (self.image, self.range_m, self.measured) if array is not None)


class KeptPixels:
    """Each frame's pixels under the hash of what they were made from. A copy for another process keeps nothing."""

    def __init__(self, root: Path | None) -> None:
        self._root = root
        self._lock = Lock()
        self._memory: dict[tuple[str, str], FramePixels] = {}
        self._files: dict[tuple[str, str], Path] = {}
        self._bytes = 0

    def __reduce__(self) -> tuple[Callable[[None], "KeptPixels"], tuple[None]]:
        return KeptPixels, (None,)

    def keep(self, name: str, key: str, pixels: FramePixels) -> None:
        """Keep a frame's pixels if there is room; frames that came first stay."""
        if self._root is None:
            return
        with self._lock:
            if (name, key) in self._memory or (name, key) in self._files:
                return
            fits = self._bytes + pixels.size <= LIMITS.memory_bytes
            if fits:
                self._memory[name, key] = pixels.alone()
                self._bytes += pixels.size
        if not fits:
            self._write(self._root, (name, key), pixels.image)

    def find(self, name: str, key: str) -> FramePixels | None:
        """A frame's pixels; None where they are not kept."""
        found = self._memory.get((name, key))
        path = self._files.get((name, key))
        if found is not None or path is None:
            return found
        try:
            return FramePixels(np.load(path, allow_pickle=False))
        except (OSError, ValueError, EOFError):  # somebody removed it
            return None

    def drop(self, name: str, key: str) -> None:
        """Forget a frame that no later pass needs."""
        with self._lock:
            dropped = self._memory.pop((name, key), None)
            self._bytes -= dropped.size if dropped else 0
            path = self._files.pop((name, key), None)
        if path:
            with contextlib.suppress(OSError):
                path.unlink()

    def clear(self) -> None:
        """Forget everything."""
        for name, key in [*self._memory, *self._files]:
            self.drop(name, key)
        if self._root is not None:
            with contextlib.suppress(OSError):
                scratch_folder(self._root).rmdir()

    def _write(self, root: Path, frame: tuple[str, str], image: Image) -> None:
        """The image as a temporary file, which the next run removes where this one is killed."""
        path = temporary_path(scratch_folder(root) / "pixels.npy")
        with contextlib.suppress(OSError):  # a full disk: it is decoded again
            path.parent.mkdir(exist_ok=True)
            if shutil.disk_usage(path.parent).free < LIMITS.free_disk_bytes:
                return
            np.save(path, image, allow_pickle=False)
            with self._lock:
                self._files[frame] = path
