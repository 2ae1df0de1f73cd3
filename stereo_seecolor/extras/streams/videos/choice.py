"""Choice of the frames that make a dive, of two videos or of one that shows both sides."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration import StereoRig
from calibration.errors import counted
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.videos.agreement import unlike
from stereo_seecolor.extras.streams.videos.frame_moments import frames_of_equal_moments
from stereo_seecolor.extras.streams.videos.lags import LIMITS, Lag
from stereo_seecolor.extras.streams.videos.motion import NoEvidence, VideoSignals, video_signals
from stereo_seecolor.extras.streams.videos.row_lag import Pairs
from stereo_seecolor.extras.streams.videos.synchronization import LIMITS as SYNC
from stereo_seecolor.extras.streams.videos.synchronization import VideoSync, paired, synchronize
from stereo_seecolor.inputs.video_file import VideoFile, video_file
from stereo_seecolor.records import Mask, Numbers

BLURRED = 0.7
"""Of the usual sharpness around a frame: motion blur of 2 px takes a third of the steps from pixel
to pixel.
"""

AROUND_S = 1.0
"""The frames that are around: the scene changes little in that time."""

SAME_RATE = 0.005
"""Rates that differ by more, as 29.97 and 30.5, are of two kinds; 29.97 and 30 by 0.1 %."""


@dataclass(frozen=True)
class FrameChoice:
    """Numbers of the frames that are pairs, left ones rising. notes: how it was decided. wrong: the
    numbers of a run that are wrong, since it is not known which frames are pairs.
    """

    left: tuple[int, ...]
    right: tuple[int, ...]
    notes: tuple[str, ...] = ()
    wrong: tuple[Numbers, ...] = ()


def choose_frames(
    left: Path, right: Path, config: InputConfig, rig: StereoRig | None = None
) -> FrameChoice:
    """Choose frames of two videos that were taken at nearly the same time; of these every nth, or
    by their overlap.

    Without any evidence for the offset of the two clocks, frames of the same number are paired, as
    from hardware-triggered cameras, unless the frame rates differ.
    rig: if known, the vertical disparity of rectified pairs gives the offset most precisely.
    Raises InputError where the evidence disagrees, or an offset was given by which the videos do
    not overlap; DeviceError.
    """
    files = video_file(left), video_file(right)
    notes: tuple[str, ...] = ()
    if left != right:
        try:
            synchronized = _synchronized(left, right, config.video_offset_s, rig)
        except NoEvidence as error:
            if abs(files[0].index.frame_s / files[1].index.frame_s - 1) > SAME_RATE:
                raise
            notes = (f"frames of the same number are paired: {error}",)
            if error.signals:
                found = frames_of_equal_moments((left.name, right.name), error.signals)
                differ = unlike(error.signals, found.pairs)
                if differ.mean() > 1 - SYNC.least_pairs:
                    raise InputError(
                        f"{left} and {right}: frames of the same number do not move alike, and no "
                        "other offset fits: one file lacks frames, or both show different scenes: "
                        "run parts of the videos, or set input.video_offset_s (0 if one trigger "
                        "took both sides)"
                    ) from error
                notes = (*notes, *found.notes, *_unlike_note(differ))
                chosen = _chosen(found.pairs[~differ], error.signals, files, config, notes)
                return replace(chosen, wrong=("ranges",) if found.is_wrong or differ.any() else ())
        else:
            return _chosen(
                synchronized.pairs,
                synchronized.signals,
                files,
                config,
                (f"{left.name} and {right.name}: {synchronized.text}",),
            )
    if config.video_overlap is None and not config.video_skip_blurred:
        numbers = tuple(range(0, min(len(file.index.pts) for file in files), config.video_every))
        return FrameChoice(numbers, numbers, notes)
    first = video_signals(left)
    signals = first, first if left == right else video_signals(right)
    return _chosen(_equal(*signals), signals, files, config, notes)


def _unlike_note(differ: Mask) -> tuple[str, ...]:
    if not differ.any():
        return ()
    return (
        f"{int(differ.sum())} of {len(differ)} pairs were left out, since the two images do not "
        "move alike: one file may lack frames, so that the ranges of the others are wrong: if one "
        "trigger took both sides, set input.video_offset_s=0",
    )


def _synchronized(
    left: Path, right: Path, offset_s: float | None, rig: StereoRig | None
) -> VideoSync:
    if offset_s is None:
        return synchronize(left, right, rig)
    lag = Lag(offset_s, 0.0, 0.0, LIMITS.drift)
    return paired((video_signals(left), video_signals(right)), lag)


def _equal(left: VideoSignals, right: VideoSignals) -> Pairs:
    numbers = np.arange(min(len(left.times_s), len(right.times_s)))
    return np.column_stack([numbers, numbers])


def _chosen(
    pairs: Pairs,
    signals: tuple[VideoSignals, VideoSignals],
    files: tuple[VideoFile, VideoFile],
    config: InputConfig,
    notes: tuple[str, ...],
) -> FrameChoice:
    """Without blurred frames, if asked for; the rest by overlap, or the first of every n."""
    if config.video_skip_blurred:
        sharp = ~(_blurred(signals[0])[pairs[:, 0]] | _blurred(signals[1])[pairs[:, 1]])
        notes = (
            *notes,
            (f"{int((~sharp).sum())} of {len(pairs)} pairs are blurred and were left out"),
        )
        pairs = pairs[sharp]
    pairs = pairs[np.unique(pairs[:, 1], return_index=True)[1]]  # a right frame once
    if config.video_overlap is not None:
        pairs = pairs[
            _by_overlap(signals[0].place[pairs[:, 0]], signals[0].height, config.video_overlap)
        ]
        notes = (
            *notes,
            f"{counted(len(pairs), 'pair')}, overlap {config.video_overlap:.0%} from one to the "
            "next",
        )
    else:
        pairs = pairs[np.unique(pairs[:, 0] // config.video_every, return_index=True)[1]]
    # a frame that cannot be decoded has a number, but no signals
    numbers = [
        file.index.numbers_at(side.times_s[column])
        for file, side, column in zip(files, signals, pairs.T, strict=True)
    ]
    return FrameChoice(tuple(numbers[0].tolist()), tuple(numbers[1].tolist()), notes)


def _blurred(signals: VideoSignals) -> NDArray[np.bool_]:
    """(n,) True for frames much less sharp, along x or y, than those around them usually are."""
    from scipy.ndimage import median_filter

    around = max(3, round(AROUND_S / signals.frame_s))
    usual = median_filter(signals.sharpness, size=(around, 1), mode="nearest")
    return np.asarray((signals.sharpness < BLURRED * usual).any(axis=1))


def _by_overlap(places: NDArray[np.float64], height: float, overlap: float) -> list[int]:
    """The first, and each that shows no more than ``overlap`` of what the last one showed. places,
    height: image widths.
    """
    chosen: list[int] = []
    for number, place in enumerate(places):
        if chosen:
            x, y = np.abs(place - places[chosen[-1]])
            if max(0.0, 1 - x) * max(0.0, 1 - y / height) > overlap:
                continue
        chosen.append(number)
    return chosen
