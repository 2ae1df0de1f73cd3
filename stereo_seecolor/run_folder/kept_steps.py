"""Relative poses of neighboring frames, found with the dive's light and kept in OUT for a first picture of its map."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.numpy_files import load_arrays
from stereo_seecolor.run_folder.layout import steps_file


@dataclass(frozen=True, eq=False)
class KeptSteps:
    """Relative poses between frames, some 300 bytes a frame.

    geometry: hash of the rectified images' geometry. frames: (F,) uint64, by ``frame_mark``. steps: (S,) records whose fields i and
    j are numbers in ``frames``.
    """

    geometry: str
    frames: NDArray[np.uint64]
    steps: NDArray[np.void]

    @classmethod
    def of(cls, geometry: RectifiedPair, marks: Sequence[int], steps: NDArray[np.void]) -> "KeptSteps":
        """Record the steps between frames with these marks."""
        return cls(content_key(geometry), np.array(marks, np.uint64), steps)

    def save(self, root: Path) -> None:
        """Write the steps. Raises OutputError."""
        with atomic_path(steps_file(root)) as path, path.open("wb") as file:
            np.savez(file, geometry=np.array(self.geometry), frames=self.frames, steps=self.steps)

    @classmethod
    def load(cls, root: Path) -> "KeptSteps | None":
        """Read the steps of an earlier run; None where there are none, or they are damaged."""
        try:
            content = load_arrays(steps_file(root))
            return cls(str(content["geometry"]), content["frames"], content["steps"])
        except (OSError, ValueError, KeyError, BadZipFile):
            return None

    def among(self, geometry: RectifiedPair, marks: Iterable[int]) -> NDArray[np.void]:
        """The steps between frames of these marks, by their numbers; none for another geometry. Frames that were changed since, or
        that came after, have none.
        """
        if content_key(geometry) != self.geometry:
            return self.steps[:0]
        place = {mark: number for number, mark in enumerate(marks)}
        now = np.array([place.get(mark, -1) for mark in self.frames.tolist()], np.int64)
        found = self.steps.copy()
        found["i"], found["j"] = now[self.steps["i"]], now[self.steps["j"]]
        return found[(found["i"] >= 0) & (found["j"] >= 0)]


def frame_mark(name: str, sha256: str) -> int:
    """64 bits of the hash of a frame's name and its left image."""
    return int.from_bytes(hashlib.sha256(f"{name}/{sha256}".encode()).digest()[:8], "little")
