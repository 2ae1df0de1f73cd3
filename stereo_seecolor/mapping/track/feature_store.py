"""Features of a survey's frames on disk: memory is bounded, and a stopped track continues."""

import shutil
import tempfile
import weakref
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.raw_arrays import load_arrays
from stereo_seecolor.mapping.kept_frames import kept_folder
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.mapping.track.features import FEATURE_SETTINGS, Features
from stereo_seecolor.version import __version__

HELD = 64
"""Frames whose features a process holds, 0.4 MB each: neighbors are asked for repeatedly."""


class FeatureStore(Lazy[Features]):
    """A folder with one file a frame, asked for by the frame's position on the track. names: of the
    files, by position.
    """

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self._folder, self._names = folder, names

    @classmethod
    def of(cls, survey: Survey) -> "FeatureStore":
        """The store of a survey's frames; features of an earlier run in them are kept. Without a
        folder of the survey's, its own goes with it.
        """
        index, scratch = survey.index, survey.scratch
        folder = scratch or Path(tempfile.mkdtemp(prefix="stereo-seecolor-"))
        names = [f"{number}_{index.checksums[number]:08x}.npz" for number in index.order.tolist()]
        key = content_key(__version__, FEATURE_SETTINGS, survey.geometry)
        store = cls(kept_folder(folder / "features", key), names)
        if scratch is None:
            weakref.finalize(store, shutil.rmtree, folder, ignore_errors=True)
        return store

    def __len__(self) -> int:
        return len(self._names)

    def item(self, number: int) -> Features:
        """The features of the frame at a position. Raises FileNotFoundError if not found yet."""
        return _loaded(self._path(number))

    def has(self, number: int) -> bool:
        """Tell whether the features of a frame are stored."""
        return self._path(number).is_file()

    def save(self, number: int, features: Features) -> None:
        """Write the features of a frame. Raises OutputError."""
        with atomic_path(self._path(number)) as path, path.open("wb") as file:
            np.savez(file, **vars(features))

    def _path(self, number: int) -> Path:
        return self._folder / self._names[number]


@lru_cache(maxsize=HELD)
def _loaded(path: Path) -> Features:
    return Features(**load_arrays(path))
