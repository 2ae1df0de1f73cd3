"""Frames that were decoded once, kept as raw arrays for the later passes of a map: reading those takes a sixth of the time."""

import contextlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.files.atomic import temporary_path
from stereo_seecolor.mapping.recovered_frames import Frames, Unplaced
from stereo_seecolor.records import SurveyFrame


@dataclass(frozen=True)
class KeepingSettings:
    """How much of the disk may be used."""

    most_bytes: float = 16e9  # 750 frames of 1.3 megapixels
    free_fraction: float = 0.25  # of what is free: the map itself is to be written


SETTINGS = KeepingSettings()


class KeptFrames(Lazy[SurveyFrame | Unplaced]):
    """A survey's frames; those first read are written to ``folder`` as they are, until the allowance is used up.

    folder: new for each map, on a disk that all workers see; whoever makes the map deletes it. A frame that cannot be written is
    decoded each time.
    """

    def __init__(self, frames: Frames, folder: Path) -> None:
        self._frames, self._folder = frames, folder
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        self._allowed_bytes = min(SETTINGS.most_bytes, SETTINGS.free_fraction * shutil.disk_usage(folder).free)

    def __len__(self) -> int:
        return len(self._frames)

    def item(self, number: int) -> SurveyFrame | Unplaced:
        """A frame, or that it is lost."""
        path = self._folder / f"{number}.raw"
        if path.is_file():
            with contextlib.suppress(OSError, ValueError, EOFError):  # somebody removed it
                return _read(path)
        frame = self._frames[number]
        if isinstance(frame, SurveyFrame) and (number + 1) * _bytes(frame) <= self._allowed_bytes:
            _write(path, frame)
        return frame


def _bytes(frame: SurveyFrame) -> int:
    return sum(pixels.nbytes for pixels in _pixels(frame))


def _pixels(frame: SurveyFrame) -> Sequence[NDArray[Any]]:
    return [frame.color, frame.range_m, frame.range_std_m, frame.confidence, frame.color_is_doubtful]


def _write(path: Path, frame: SurveyFrame) -> None:
    temporary = temporary_path(path)
    try:
        with temporary.open("wb") as file:
            np.save(file, np.array([frame.name]))
            np.save(file, np.array(np.nan if frame.timestamp_s is None else frame.timestamp_s))
            for pixels in _pixels(frame):
                np.save(file, pixels)
        temporary.replace(path)
    except OSError:  # a full disk: it is decoded again
        with contextlib.suppress(OSError):
            temporary.unlink()


def _read(path: Path) -> SurveyFrame:
    """With all colors that are doubtful as unrecoverable ones: no pass tells them apart."""
    with path.open("rb") as file:
        name, time_s = str(np.load(file)[0]), float(np.load(file))
        color, range_m, range_std_m, confidence, doubtful = (np.load(file) for _ in range(5))
    timestamp_s = None if np.isnan(time_s) else time_s
    return SurveyFrame(name, timestamp_s, color, range_m, range_std_m, confidence, doubtful)
