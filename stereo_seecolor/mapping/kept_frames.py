"""Decoded frames, kept as raw arrays for later passes: these are read in a sixth of the time."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.files.raw_arrays import read_arrays, write_arrays
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.records import SurveyFrame


@dataclass(frozen=True)
class KeepingSettings:
    """The disk space that kept frames may take."""

    most_bytes: float = 16e9  # 900 frames of 1.3 megapixels
    free_fraction: float = 0.25  # of what is free: the map itself is to be written


SETTINGS = KeepingSettings()


class KeptFrames(Lazy[SurveyFrame | Unplaced]):
    """A survey's frames; each is written to ``folder`` as raw arrays when it is first read, until
    the allowance is used up.

    folder: new for each map, on a disk that all workers see; whoever makes the map deletes it. A
    frame that cannot be written is decoded each time.
    """

    def __init__(self, frames: Frames, folder: Path) -> None:
        self._frames, self._folder = frames, folder
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        self._allowed_bytes = min(
            SETTINGS.most_bytes, SETTINGS.free_fraction * shutil.disk_usage(folder).free
        )

    def __len__(self) -> int:
        return len(self._frames)

    def item(self, number: int) -> SurveyFrame | Unplaced:
        """Read a frame; Unplaced if it is lost."""
        path = self._folder / f"{number}.raw"
        kept = _read(path)
        if kept is not None:
            return kept
        frame = self._frames[number]
        if isinstance(frame, SurveyFrame):
            size = sum(pixels.nbytes for pixels in _pixels(frame))
            if (number + 1) * size <= self._allowed_bytes:
                _write(path, frame)
        return frame


def _pixels(frame: SurveyFrame) -> Sequence[NDArray[Any]]:
    return [
        frame.color,
        frame.range_m,
        frame.range_std_m,
        frame.confidence,
        frame.color_is_doubtful,
    ]


def _write(path: Path, frame: SurveyFrame) -> None:
    time_s = np.nan if frame.timestamp_s is None else frame.timestamp_s
    numbers = np.array([time_s, frame.right_sharpness])
    write_arrays(path, [np.array([frame.name]), numbers, *_pixels(frame)])


def _read(path: Path) -> SurveyFrame | None:
    """The kept frame, None where there is none. Doubtful colors are all marked unrecoverable: no
    pass distinguishes the two.
    """
    found = read_arrays(path, 7)
    if found is None:
        return None
    name, (time_s, right_sharpness), color, range_m, range_std_m, confidence, doubtful = found
    timestamp_s = None if np.isnan(time_s) else float(time_s)
    maps = color, range_m, range_std_m, confidence, doubtful
    frame = SurveyFrame(str(name[0]), timestamp_s, *maps, float(right_sharpness))
    # clipped ones are among them: they need not be looked for again
    vars(frame)["color_is_doubtful"] = doubtful
    return frame


KEY_LENGTH = 16
"""Of the hash that a folder is called by: short names, and no two are alike."""


def kept_folder(folder: Path, key: str) -> Path:
    """The folder in ``folder`` for work of inputs of this hash; those of others are deleted.

    So a worker that was slow to hear of a new run writes into a folder that nobody reads.
    """
    kept = folder / key[:KEY_LENGTH]
    for other in folder.iterdir() if folder.is_dir() else ():
        if other != kept:
            shutil.rmtree(other, ignore_errors=True)
    return kept
