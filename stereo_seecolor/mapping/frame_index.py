"""Index of a survey's frames, made in one pass over them: names, times, and coarse points."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.records import Map, SurveyFrame

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many are done, how many there are; the text is another for
each pass.
"""


def silent(what: str, done: int, total: int) -> None:
    """Ignore progress."""


@dataclass(frozen=True)
class PointSampling:
    """How the coarse points of a frame are chosen."""

    # on the bottom, meters: half a block of default voxels, so that no block is missed
    spacing_m: float = 0.04
    max_stride_px: int = 16  # pixels: coarser would miss what stands up from the bottom
    # of a range, meters: voxels made for points less certain than they can show would hold air
    max_std_m: float = float("inf")
    # but never fewer than those within so many of the frame's median standard error
    usual_stds: float = 3.0
    # the spacing holds up to this quantile of the ranges: the last few may be mismatches
    far_fraction: float = 0.95


SAMPLING = PointSampling()


@dataclass(frozen=True, eq=False)
class FrameIndex:
    """Names, times (NaN where unknown) and coarse points of N frames.

    points_m: one (n, 3) float32 array a frame: measured points in the camera, every few pixels.
    lost: the frames that could not be read, and why. checksums: (N,) of colors and points, to tell
    whether a frame was made again.
    certain: (n,) for each frame, False for points that are too uncertain to make voxels for; ()
    where all are. colors: (n, 3) of each frame's points, () where they are not known.
    """

    names: tuple[str, ...]
    timestamps_s: NDArray[np.float64]
    points_m: tuple[NDArray[np.float32], ...]
    lost: dict[int, str] = field(default_factory=dict)
    checksums: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    certain: tuple[NDArray[np.bool_], ...] = ()
    colors: tuple[NDArray[np.uint8], ...] = ()

    @classmethod
    def build(
        cls,
        frames: Frames,
        geometry: RectifiedPair,
        sampling: PointSampling = SAMPLING,
        progress: Progress = silent,
        compute: Compute | None = None,
    ) -> "FrameIndex":
        """Read every frame once; memory grows by some 60 KB a frame at the default spacing.
        compute: None for one thread.
        """
        found: list[_Indexed] = []
        for one in (compute or Threads(1)).each(
            _Glance(frames, geometry, sampling), range(len(frames))
        ):
            found.append(one)
            progress("reading the frames", len(found), len(frames))
        return cls(
            names=tuple(one.name for one in found),
            timestamps_s=np.array([one.timestamp_s for one in found], dtype=np.float64),
            points_m=tuple(one.coarse.points_m for one in found),
            lost={i: one.lost for i, one in enumerate(found) if one.lost is not None},
            checksums=np.array([one.checksum for one in found], np.int64),
            certain=tuple(one.coarse.certain for one in found),
            colors=tuple(one.coarse.colors for one in found),
        )

    def scaled(self, scale: float) -> "FrameIndex":
        """Scale the ranges of all frames by a factor."""
        points = tuple((scale * own).astype(np.float32) for own in self.points_m)
        return replace(
            self, points_m=points, checksums=self.checksums ^ crc32(np.float64(scale).tobytes())
        )

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Frames by time where all that could be read have one, else as they come."""
        timeless = set(np.flatnonzero(np.isnan(self.timestamps_s)).tolist())
        if timeless <= self.lost.keys():
            return np.argsort(self.timestamps_s, kind="stable")
        return np.arange(len(self.names))

    @cached_property
    def rank(self) -> NDArray[np.int64]:
        """The position of each frame in ``order``: (N,); neighbors on the track differ by one,
        however the files are named.
        """
        rank = np.empty(len(self.names), np.int64)
        rank[self.order] = np.arange(len(self.names))
        return rank


@dataclass(frozen=True, eq=False)
class _CoarsePoints:
    """points_m: (n, 3) in the camera. certain: (n,) which are certain enough to make voxels for.
    colors: (n, 3) RGB.
    """

    points_m: NDArray[np.float32]
    certain: NDArray[np.bool_]
    colors: NDArray[np.uint8]

    @classmethod
    def none(cls) -> "_CoarsePoints":
        """Make the points of a frame that cannot be read."""
        return cls(np.zeros((0, 3), np.float32), np.zeros(0, np.bool_), np.zeros((0, 3), np.uint8))


@dataclass(frozen=True, eq=False)
class _Indexed:
    """What the index knows of a frame. lost: why it cannot be read; None where it can."""

    name: str
    timestamp_s: float
    coarse: _CoarsePoints
    checksum: int
    lost: str | None = None


@dataclass(frozen=True, eq=False)
class _Glance:
    """Reads the frame of a number."""

    frames: Frames
    geometry: RectifiedPair
    sampling: PointSampling

    def __call__(self, number: int) -> _Indexed:
        frame = self.frames[number]
        if isinstance(frame, Unplaced):
            return _Indexed(frame.name, np.nan, _CoarsePoints.none(), 0, frame.reason)
        coarse = _coarse_points(frame, self.geometry, self.sampling)
        checksum = crc32(
            frame.color[:: self.sampling.max_stride_px].tobytes(), crc32(coarse.points_m.tobytes())
        )
        return _Indexed(
            frame.name, np.nan if frame.timestamp_s is None else frame.timestamp_s, coarse, checksum
        )


def _coarse_points(
    frame: SurveyFrame, geometry: RectifiedPair, sampling: PointSampling
) -> _CoarsePoints:
    sample = frame.range_m[:: sampling.max_stride_px, :: sampling.max_stride_px]
    sample = sample[np.isfinite(sample)]
    far_m = float(np.quantile(sample, sampling.far_fraction)) if sample.size else 1.0
    stride = int(np.clip(geometry.focal_px * sampling.spacing_m / far_m, 1, sampling.max_stride_px))
    start = stride // 2
    rows, columns = np.mgrid[
        start : frame.range_m.shape[0] : stride, start : frame.range_m.shape[1] : stride
    ]
    range_m = frame.range_m[rows, columns]
    known = np.isfinite(range_m) & (frame.confidence[rows, columns] > 0)
    limit_m = _most_std_m(frame.range_std_m[rows, columns][known], sampling)
    known &= _spaced(
        range_m, geometry.focal_px * sampling.spacing_m / stride, sampling.max_stride_px // stride
    )
    certain = ~(frame.range_std_m[rows, columns][known] > limit_m)
    depth_m = range_m[known] / geometry.ray_length[rows, columns][known]
    x = (columns[known] - geometry.cx_left_px) / geometry.focal_px * depth_m
    y = (rows[known] - geometry.cy_px) / geometry.focal_px * depth_m
    points = np.stack([x, y, depth_m], axis=-1).astype(np.float32)
    return _CoarsePoints(points, certain, frame.color[rows[known], columns[known]])


def _most_std_m(std_m: Map, sampling: PointSampling) -> float:
    """Of a point that is certain enough to make voxels for. std_m: (n,) of a frame's measured
    pixels.
    """
    stated = std_m[np.isfinite(std_m)]
    return (
        max(sampling.max_std_m, sampling.usual_stds * float(np.median(stated)))
        if stated.size
        else np.inf
    )


def _spaced(range_m: Map, most_steps: float, limit: int) -> NDArray[np.bool_]:
    """Which points of a lattice to keep so that they lie as far apart near the camera as far away:
    every second, fourth, ... there.

    most_steps: of the lattice that the spacing is at a range of one meter. limit: most steps.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        steps = np.clip(np.nan_to_num(most_steps / range_m), 1, limit)
    apart = 2 ** np.log2(steps).astype(np.int64)
    row, column = np.ogrid[: range_m.shape[0], : range_m.shape[1]]
    return np.asarray((row % apart == 0) & (column % apart == 0))
