"""How a video's picture moves, and how bright it is, from frame to frame: signals that two cameras on one rig share."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.video_streams import gray_frames

WIDTH_PX = 192
"""Frames are compared at this width: 1 ms each, and shifts to some hundredths of a pixel."""

Array = NDArray[np.float64]


class NoEvidence(InputError):
    """Nothing tells how the clocks of two videos run."""


@dataclass(frozen=True, eq=False)
class VideoSignals:
    """times_s: (n,) of the frames. brightness: (n,) mean gray, 0..255.

    motion_times_s: (n-1,) midway between frames. motion: (n-1, 2) x and y, image widths a second.
    """

    times_s: Array
    brightness: Array
    motion_times_s: Array
    motion: Array

    @property
    def frame_s(self) -> float:
        """Median time from frame to frame."""
        return float(np.median(np.diff(self.times_s)))

    @property
    def speed(self) -> float:
        """Median speed of the picture, image widths a second."""
        return float(np.median(np.hypot(*self.motion.T)))


def video_signals(path: Path) -> VideoSignals:
    """Decode a video once. Raises NoEvidence if it holds fewer than three frames with times, InputError, DeviceError."""
    times: list[float] = []
    brightness: list[float] = []
    shifts: list[tuple[float, float]] = []
    before, window = None, None
    for time_s, gray in gray_frames(path, WIDTH_PX):
        if times and time_s <= times[-1]:
            continue
        if window is None:
            window = cv2.createHanningWindow(gray.shape[::-1], cv2.CV_32F)
        if before is not None:
            (x_px, y_px), _ = cv2.phaseCorrelate(before, gray, window)
            shifts.append((x_px / WIDTH_PX, y_px / WIDTH_PX))
        times.append(time_s)
        brightness.append(float(gray.mean()))
        before = gray
    if len(times) < 3:
        raise NoEvidence(f"{path}: holds {len(times)} frames with times: too few to compare with another video")
    at = np.array(times)
    intervals = np.diff(at)
    return VideoSignals(at, np.array(brightness), (at[:-1] + at[1:]) / 2, np.array(shifts) / intervals[:, None])
