"""The recorded exposure of each frame, as the prior of its gain, if it explains their differences.

Records may be wrong, and with a strobe the exposure time has no effect. So records are used only if
they explain differences between frames that show the same spots.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from stereo_seecolor.color.photometry.light_of_frames import Parts, offset_between
from stereo_seecolor.records import Capture

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RecordSettings:
    """Conditions for the use of records."""

    varies: float = 0.03
    """Least standard deviation (logarithm) of records; smaller ones are not used."""
    left: float = 0.8
    """Largest remaining fraction of the offsets between frames, as for gains."""
    misread_left: float = 0.4
    """The same of records in another reading, also of what they leave as read: of several one
    explains half by chance.
    """
    frames: int = 2
    """Frames by which a table may be shifted."""
    alike: float = 1.05
    """Readings are as likely where they leave so many times as much."""


SETTINGS = RecordSettings()
TINY = 1e-9
"""Offsets that are none."""


def log_exposures(captures: Sequence[Capture]) -> Array:
    """(F,) logarithms of recorded exposures, of mean 0; 0 = number missing."""
    values = (value for c in captures for value in (c.exposure_s, c.gain, c.aperture))
    fields = np.fromiter(
        (np.nan if value is None else value for value in values), np.float64
    ).reshape(len(captures), 3)
    recorded = ~np.isnan(fields)
    complete = (recorded | ~recorded.any(axis=0)).all(axis=1)
    logs = np.log(np.where(recorded, fields, 1.0)) @ np.array([1.0, 1.0, -2.0])
    usual = logs[complete].mean() if complete.any() else 0.0
    return np.where(complete, logs - usual, 0.0)


def is_informative(recorded: Array) -> bool:
    """Whether the (F,) records differ enough between frames."""
    return bool(recorded.size) and float(recorded.std()) > SETTINGS.varies


def offsets_about(parts: Parts, recorded: Array) -> tuple[float, float]:
    """The rms of luminance between frames, without and with the (F,) records subtracted."""
    return offset_between(parts, np.zeros_like(recorded)), offset_between(parts, recorded)


def explain(offsets: tuple[float, float]) -> bool:
    """Whether subtracting the records lowers the ``offsets_about`` enough."""
    return offsets[1] < SETTINGS.left * offsets[0]


def explain_better(other: tuple[float, float], offsets: tuple[float, float]) -> bool:
    """Whether the records explain the ``offsets_about`` of images decoded in another way far better
    than those of the images as they were decoded.
    """
    left, other_left = (about[1] / max(about[0], TINY) for about in (offsets, other))
    return other_left < SETTINGS.misread_left * min(left, 1.0)


def misread(parts: Parts, recorded: Array) -> str:
    """How records that explain nothing as read would: as reciprocals, or as those of a frame
    before or after; "" where they would not, or do as read.

    Of several the one that leaves least is named, with those that leave about as much.
    """
    readings = {"as reciprocals (60 for 1/60 s)": -recorded}
    for frames in range(1, SETTINGS.frames + 1):
        for by, of in ((frames, "before"), (-frames, "after")):
            other = np.roll(recorded, by)
            other[: max(by, 0)] = 0
            other[len(other) + min(by, 0) :] = 0
            readings[f"as those of {counted(frames, 'frame')} {of}"] = other
    offsets = {name: offsets_about(parts, other) for name, other in readings.items()}
    best = min(offsets, key=lambda name: offsets[name][1])
    if offsets[best][1] > SETTINGS.misread_left * offsets[best][0]:
        return ""
    alike = [name for name in offsets if offsets[name][1] <= SETTINGS.alike * offsets[best][1]]
    named = ", or ".join(alike)
    return f"read {named} they would explain the differences: correct the table"
