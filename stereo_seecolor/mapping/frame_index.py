"""Index of a survey's frames, made in one pass over them: names, times, and coarse points."""

import os
import tempfile
import weakref
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.sequences import Changed, Lazy
from stereo_seecolor.compute.threads import Lock, Threads
from stereo_seecolor.files.atomic import output_errors
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.records import Map, SurveyFrame
from stereo_seecolor.sharpness import EQUALLY_SHARP, LessSharpSide

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
    where all are. less_sharp: which side of the rig.
    """

    names: tuple[str, ...]
    timestamps_s: NDArray[np.float64]
    points_m: Sequence[NDArray[np.float32]]
    lost: dict[int, str] = field(default_factory=dict)
    checksums: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    certain: tuple[NDArray[np.bool_], ...] = ()
    less_sharp: LessSharpSide = EQUALLY_SHARP

    @classmethod
    def build(
        cls,
        frames: Frames,
        geometry: RectifiedPair,
        sampling: PointSampling = SAMPLING,
        progress: Progress = silent,
        compute: Compute | None = None,
        folder: Path | None = None,
    ) -> "FrameIndex":
        """Read every frame once. compute: None for one thread. folder: on whose disk the points
        lie, 100 KB a frame at the default spacing; None: where temporary files do.

        Raises OutputError if that disk is full.
        """
        points, every = _PointFile(folder), list[_Indexed]()
        work = partial(_indexed, frames, geometry, sampling)
        found = (compute or Threads(1)).each(work, range(len(frames)))
        for done, (points_m, one) in enumerate(found, 1):
            points.append(points_m)
            every.append(one)
            progress("reading the frames", done, len(frames))
        return cls(
            tuple(one.name for one in every),
            np.array([one.timestamp_s for one in every], np.float64),
            points,
            {number: one.lost for number, one in enumerate(every) if one.lost is not None},
            np.array([one.checksum for one in every], np.int64),
            tuple(one.certain for one in every),
            LessSharpSide.of([one.right_sharpness for one in every]),
        )

    def scaled(self, scale: float) -> "FrameIndex":
        """Scale the ranges of all frames by a factor."""
        return replace(
            self,
            points_m=Changed(self.points_m, lambda m: (scale * m).astype(np.float32)),
            checksums=self.checksums ^ crc32(np.float64(scale).tobytes()),
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
        """The position of each frame in ``order``: (N,); neighbors on the track differ by one."""
        rank = np.empty(len(self.names), np.int64)
        rank[self.order] = np.arange(len(self.names))
        return rank


class _PointFile(Lazy[NDArray[np.float32]]):
    """Arrays (n, 3) in a file without a name, which goes with this object: the points of a long
    dive would take more memory than all else.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder or Path(tempfile.gettempdir())
        with output_errors(self._folder):
            self._file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115  # the next line closes it
        weakref.finalize(self, self._file.close)
        self._ends = array("q", [0])
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._ends) - 1

    def append(self, points_m: NDArray[np.float32]) -> None:
        """Add an array. Raises OutputError if the disk is full."""
        with self._lock, output_errors(self._folder):
            self._file.seek(0, os.SEEK_END)
            self._file.write(points_m.tobytes())
            self._ends.append(self._file.tell())

    def item(self, number: int) -> NDArray[np.float32]:
        """Read an array."""
        start, end = self._ends[number : number + 2]
        points_m = np.empty((end - start) // 4, np.float32)
        with self._lock:
            self._file.seek(start)
            self._file.readinto(points_m.data)
        return points_m.reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class _Indexed:
    """What the index knows of a frame beside its n points. certain: (n,) which are certain enough
    to make voxels for. right_sharpness: as in RangeMap. lost: why it cannot be read; None where it
    can.
    """

    name: str
    timestamp_s: float = np.nan
    certain: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    checksum: int = 0
    right_sharpness: float = np.nan
    lost: str | None = None


def _indexed(
    frames: Frames, geometry: RectifiedPair, sampling: PointSampling, number: int
) -> tuple[NDArray[np.float32], _Indexed]:
    """Read the frame of a number: its points (n, 3) in the camera, and the rest."""
    frame = frames[number]
    if isinstance(frame, Unplaced):
        return np.zeros((0, 3), np.float32), _Indexed(frame.name, lost=frame.reason)
    points_m, certain = _coarse_points(frame, geometry, sampling)
    checksum = crc32(frame.color[:: sampling.max_stride_px].tobytes(), crc32(points_m.tobytes()))
    timestamp_s = np.nan if frame.timestamp_s is None else frame.timestamp_s
    return points_m, _Indexed(frame.name, timestamp_s, certain, checksum, frame.right_sharpness)


def _coarse_points(
    frame: SurveyFrame, geometry: RectifiedPair, sampling: PointSampling
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Points (n, 3) in the camera, and (n,) which are certain enough to make voxels for."""
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
    std_m = frame.range_std_m[rows, columns]
    stated_m = std_m[known & np.isfinite(std_m)]
    usual_m = sampling.usual_stds * float(np.median(stated_m)) if stated_m.size else np.inf
    known &= _spaced(
        range_m, geometry.focal_px * sampling.spacing_m / stride, sampling.max_stride_px // stride
    )
    certain = ~(std_m[known] > max(sampling.max_std_m, usual_m))
    depth_m = range_m[known] / geometry.ray_length[rows, columns][known]
    x = (columns[known] - geometry.cx_left_px) / geometry.focal_px * depth_m
    y = (rows[known] - geometry.cy_px) / geometry.focal_px * depth_m
    return np.stack([x, y, depth_m], axis=-1).astype(np.float32), certain


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
