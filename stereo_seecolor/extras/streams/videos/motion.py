"""Motion and brightness from frame to frame: signals that two cameras on a rig share."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.video_streams import gray_frames

WIDTH_PX = 192
"""Frames are compared at this width: 1 ms each, and shifts to some hundredths of a pixel."""

MotionArray = NDArray[np.float64]


class NoEvidence(InputError):
    """There is no evidence for the offset between the clocks of two videos. signals: of both, if
    they have some.
    """

    def __init__(
        self, message: str, signals: "tuple[VideoSignals, VideoSignals] | None" = None
    ) -> None:
        super().__init__(message)
        self.signals = signals


@dataclass(frozen=True, eq=False)
class VideoSignals:
    """The signals of a video. times_s: (n,) of the frames. brightness: (n,) mean gray, 0..255.

    motion_times_s: (n-1,) midway between frames. motion: (n-1, 2) x and y, image widths a second.
    sharpness: (n, 2) mean step from pixel to pixel along x and y, gray values. height: of the
    image, in widths.
    """

    times_s: MotionArray
    brightness: MotionArray
    motion_times_s: MotionArray
    motion: MotionArray
    sharpness: MotionArray
    height: float

    @property
    def frame_s(self) -> float:
        """Median time from frame to frame."""
        return float(np.median(np.diff(self.times_s)))

    @property
    def speed(self) -> float:
        """Median speed of the image, image widths a second."""
        return float(np.median(np.hypot(*self.motion.T)))

    def speed_at(self, times_s: MotionArray) -> MotionArray:
        """Speed of the image at these times, image widths a second."""
        x, y = (np.interp(times_s, self.motion_times_s, component) for component in self.motion.T)
        return np.asarray(np.hypot(x, y))

    @property
    def place(self) -> MotionArray:
        """The position to which the image has moved at each frame: (n, 2) image widths."""
        return np.vstack(
            [np.zeros(2), np.cumsum(self.motion * np.diff(self.times_s)[:, None], axis=0)]
        )


def video_signals(path: Path) -> VideoSignals:
    """Decode a video once. Raises NoEvidence for under three frames, InputError, DeviceError."""
    times: list[float] = []
    brightness: list[float] = []
    shifts: list[tuple[float, float]] = []
    sharpness: list[tuple[float, float]] = []
    before, window = None, None
    for time_s, full in gray_frames(path):
        if times and time_s <= times[-1]:
            continue
        gray = _small(full)
        if window is None:
            window = cv2.createHanningWindow(gray.shape[::-1], cv2.CV_32F)
        if before is not None:
            (x_px, y_px), _ = cv2.phaseCorrelate(before, gray, window)
            shifts.append((x_px / WIDTH_PX, y_px / WIDTH_PX))
        times.append(time_s)
        brightness.append(float(gray.mean()))
        sharpness.append(_sharpness(full))
        before = gray
    if len(times) < 3:
        raise NoEvidence(
            f"{path}: holds {len(times)} frames with times: too few to compare with another video"
        )
    at = np.array(times)
    intervals = np.diff(at)
    motion = np.array(shifts) / intervals[:, None]
    return VideoSignals(
        at,
        np.array(brightness),
        (at[:-1] + at[1:]) / 2,
        motion,
        np.array(sharpness),
        gray.shape[0] / gray.shape[1],
    )


def _small(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    size = (WIDTH_PX, max(1, round(gray.shape[0] * WIDTH_PX / gray.shape[1])))
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float32))


def _sharpness(gray: NDArray[np.uint8]) -> tuple[float, float]:
    """Along x of every fourth row, along y of every fourth column: a blur that goes one way takes
    the steps of that way.
    """
    rows, columns = (
        gray[::4].astype(np.int16),
        np.ascontiguousarray(gray[:, ::4].T).astype(np.int16),
    )
    return float(np.abs(np.diff(rows)).mean()), float(np.abs(np.diff(columns)).mean())
