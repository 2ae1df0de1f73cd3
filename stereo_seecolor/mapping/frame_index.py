"""One pass over a survey's frames: what they are called, when they were taken, and roughly what they see."""

from collections.abc import Callable
from dataclasses import dataclass, field
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.mapping.recovered import Frames, Unplaced
from stereo_seecolor.records import SurveyFrame

MAX_STRIDE_PX = 16
SPACING_M = 0.04
FAR_SHARE = 0.95

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many are done, how many there are."""


def silent(what: str, done: int, total: int) -> None:
    """Progress for those who do not watch."""


@dataclass(frozen=True, eq=False)
class FrameIndex:
    """Names, times (NaN where unknown) and coarse sights of N frames.

    points_m: one (n, 3) float32 array a frame: measured points in the camera, every few pixels. lost: the frames that could not
    be read, and why. checksums: (N,) of colors and points, to tell whether a frame was made anew.
    """

    names: tuple[str, ...]
    timestamps_s: NDArray[np.float64]
    points_m: tuple[NDArray[np.float32], ...]
    lost: dict[int, str] = field(default_factory=dict)
    checksums: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @classmethod
    def build(cls, frames: Frames, pair: RectifiedPair, spacing_m: float = SPACING_M, progress: Progress = silent) -> "FrameIndex":
        """Read every frame once. spacing_m: how far apart the points may lie on the bottom; memory grows by some 50 KB a frame."""
        names, times, points, lost, checksums = [], [], [], {}, []
        for i in range(len(frames)):
            frame = frames[i]
            names.append(frame.name)
            if isinstance(frame, Unplaced):
                lost[i] = frame.reason
                times.append(np.nan)
                points.append(np.zeros((0, 3), np.float32))
                checksums.append(0)
            else:
                times.append(np.nan if frame.timestamp_s is None else frame.timestamp_s)
                points.append(_coarse_points(frame, pair, spacing_m))
                checksums.append(crc32(frame.color[::MAX_STRIDE_PX].tobytes(), crc32(points[-1].tobytes())))
            progress("looking through the frames", i + 1, len(frames))
        return cls(tuple(names), np.array(times, dtype=np.float64), tuple(points), lost, np.array(checksums, np.int64))

    @property
    def order(self) -> NDArray[np.int64]:
        """Frames by time where all that could be read have one, else as they come."""
        timeless = set(np.flatnonzero(np.isnan(self.timestamps_s)).tolist())
        if timeless <= self.lost.keys():
            return np.argsort(self.timestamps_s, kind="stable")
        return np.arange(len(self.names))


def _coarse_points(frame: SurveyFrame, pair: RectifiedPair, spacing_m: float) -> NDArray[np.float32]:
    sample = frame.range_m[::MAX_STRIDE_PX, ::MAX_STRIDE_PX]
    sample = sample[np.isfinite(sample)]
    far_m = float(np.quantile(sample, FAR_SHARE)) if sample.size else 1.0
    stride = int(np.clip(pair.focal_px * spacing_m / far_m, 1, MAX_STRIDE_PX))
    start = stride // 2
    rows, columns = np.mgrid[start : frame.range_m.shape[0] : stride, start : frame.range_m.shape[1] : stride]
    range_m = frame.range_m[rows, columns]
    known = np.isfinite(range_m) & (frame.confidence[rows, columns] > 0)
    depth_m = range_m[known] / pair.ray_length[rows, columns][known]
    x = (columns[known] - pair.cx_left_px) / pair.focal_px * depth_m
    y = (rows[known] - pair.cy_px) / pair.focal_px * depth_m
    return np.stack([x, y, depth_m], axis=-1).astype(np.float32)
