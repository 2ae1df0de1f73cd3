"""The lag of one camera behind another by the rows of their images.

The vertical disparity of a rectified pair is that of the rig, plus what the image moves up or
down between the two moments.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration import Rectification, StereoRig
from calibration.robust_statistics import deviation_about_zero
from calibration.verification.matches import QUICK, find_matches
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.videos.lags import Lag
from stereo_seecolor.extras.streams.videos.motion import VideoSignals
from stereo_seecolor.inputs.video_file import video_file
from stereo_seecolor.inputs.video_streams import gray
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class RowLagLimits:
    """Decides which pairs are examined, and what they must show."""

    pairs: int = 24  # each takes 0.1 s; the standard error falls with their root
    least_pairs: int = 8
    least_matches: int = 20  # of a pair: its median is then good to some tenths of a pixel
    # image widths a second, spread of the vertical speeds: an image that only moves sideways tells
    # nothing
    speed: float = 0.004
    outlier_sigmas: float = 4.0
    least_error: float = 0.1  # of the nearer pairs over that of the farther ones: rows are read so
    # of the speeds that the images' motion gives, which are good to a fifth; less is something
    # else
    least_factor: float = 0.5


LIMITS = RowLagLimits()

Pairs = np.ndarray[tuple[int, int], np.dtype[np.int64]]


def row_lag(
    videos: tuple[Path, Path],
    rig: StereoRig,
    signals: tuple[VideoSignals, VideoSignals],
    lag: Lag,
    pairs: Pairs,
) -> Lag | None:
    """``lag`` corrected by the rows of some pairs; None where they tell nothing.

    lag: known to about a frame. pairs: (n, 2) numbers of frames that are nearest by it. Raises
    InputError, DeviceError.
    """
    from scipy.interpolate import CubicSpline

    rectification = Rectification.from_rig(rig)
    if rectification.pair.quarter_turns:
        return None
    left, right = signals
    speeds = np.interp(left.times_s[pairs[:, 0]], left.motion_times_s, left.motion[:, 1])
    chosen = _fastest(speeds)
    if speeds[chosen].std() < LIMITS.speed:
        return None
    rows = _with_both_neighbors(pairs[chosen], lag, signals)
    times = left.times_s[rows[:, 0]], right.times_s[rows[:, 1]]
    widths_px = rectification.pair.focal_px / rig.left.K[0, 0] * rig.left.image_size[0]
    misfits = _misfits(videos, rectification, times) / widths_px
    at, rest_s = times[0][: len(misfits)], (times[1] - lag.at(times[0]))[: len(misfits)]
    height = CubicSpline(
        left.times_s, np.append(0.0, np.cumsum(left.motion[:, 1] * np.diff(left.times_s)))
    )
    moved = height(at + rest_s) - height(at)
    found = solve_shift(moved, height(at + rest_s, 1), misfits, np.abs(rest_s))
    if found is None:
        return None
    early_s, std_s = found
    return replace(lag, offset_s=lag.offset_s + early_s, std_s=std_s)


def _fastest(speeds: Array) -> Array:
    """In each of ``LIMITS.pairs`` parts of the video, the pair that moves up or down most."""
    parts = np.array_split(np.arange(len(speeds)), min(LIMITS.pairs, len(speeds)))
    return np.array([part[np.argmax(np.abs(speeds[part]))] for part in parts])


def _with_both_neighbors(
    pairs: Pairs, lag: Lag, signals: tuple[VideoSignals, VideoSignals]
) -> Pairs:
    """Each left frame with the right ones before and after it: what a time between frames does to
    rows is then measured too.
    """
    left, right = signals
    rest_s = right.times_s[pairs[:, 1]] - lag.at(left.times_s[pairs[:, 0]])
    others = np.clip(
        pairs[:, 1] - np.sign(rest_s + 1e-12).astype(np.int64), 0, len(right.times_s) - 1
    )
    both = np.stack([pairs, np.column_stack([pairs[:, 0], others])], axis=1)
    return np.asarray(np.sort(both, axis=1).reshape(-1, 2))


def _misfits(
    videos: tuple[Path, Path], rectification: Rectification, times: tuple[Array, Array]
) -> Array:
    """Right less left row of each pair, rectified pixels; NaN where too little matches."""
    found = []
    sides = (_grays(path, at) for path, at in zip(videos, times, strict=True))
    for left, right in zip(*sides, strict=False):
        if (left.shape[1], left.shape[0]) != rectification.raw_size or right.shape != left.shape:
            break
        matches = find_matches(rectification, left, right, QUICK)
        rows = matches.right[:, 1] - matches.left[:, 1]
        found.append(float(np.median(rows)) if len(rows) >= LIMITS.least_matches else np.nan)
    return np.array(found)


def _grays(path: Path, times_s: Array) -> Iterator[NDArray[np.uint8]]:
    """The frames of these times in gray, up to the first that is damaged."""
    video = video_file(path)
    with suppress(InputError):
        for number in video.index.numbers_at(times_s):
            yield video.read(number, gray)


def solve_shift(
    moved: Array, speeds: Array, misfits: Array, apart_s: Array
) -> tuple[float, float] | None:
    """By how much the right clock is ahead of what was assumed, seconds, and its standard error;
    None where that is not determined.

    moved: what the image moves down between the two moments of a pair by the assumed lag; speeds:
    how fast it does then. Both may be wrong by one factor, which is solved for, as is the rig's own
    misfit. apart_s: the time between the two; what ``moved`` misses grows with it, so that the
    nearer and the farther half of the pairs count by their own errors.
    """
    A = np.column_stack([moved, -speeds, np.ones(len(speeds))])[: len(misfits)]
    known, error = np.isfinite(misfits), np.ones(len(misfits))
    for _ in range(5):
        if known.sum() < 2 * LIMITS.least_pairs or A[known, 1].std() < LIMITS.speed:
            return None
        near = apart_s <= np.median(apart_s)
        weighted = A[known] / error[known, None]
        solution, *_ = np.linalg.lstsq(weighted, misfits[known] / error[known], rcond=None)
        rest = misfits - A @ solution
        halves = (known & near, known & ~near)
        spreads = [deviation_about_zero(rest[half]) + 1e-9 if half.any() else 0 for half in halves]
        nearer, farther = np.maximum(spreads, LIMITS.least_error * max(spreads))
        error = np.where(near, nearer, farther)
        known = np.isfinite(misfits) & (np.abs(rest) < LIMITS.outlier_sigmas * error)
    factor, shift, _ = solution
    if not LIMITS.least_factor < factor < 1 / LIMITS.least_factor:
        return None
    weighted, left = A[known] / error[known, None], rest[known] / error[known]
    covariance = np.linalg.inv(weighted.T @ weighted) * float(left @ left) / (known.sum() - 3)
    gradient = np.array([-shift / factor**2, 1 / factor, 0.0])
    return float(shift / factor), float(np.sqrt(gradient @ covariance @ gradient))
