"""Which frames of two videos are unpacked, side by side."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.inputs.video_lags import LIMITS, Lag
from stereo_seecolor.inputs.video_motion import NoEvidence, video_signals
from stereo_seecolor.inputs.video_sync import VideoSync, paired, synchronize


@dataclass(frozen=True)
class FrameChoice:
    """Numbers of the frames, in rising order; where left is None, every nth of either video. notes: how that was decided."""

    left: tuple[int, ...] | None = None
    right: tuple[int, ...] | None = None
    notes: tuple[str, ...] = ()


def choose_frames(left: Path, right: Path, config: InputConfig) -> FrameChoice:
    """Of two videos the frames that were taken at nearly the same time; of one that shows both sides, every nth.

    Where nothing tells how the two clocks run, frames of the same number are paired, as of cameras that are wired together.
    Raises InputError where sound and picture disagree, or an offset was given by which the videos do not overlap.
    """
    if left == right:
        return FrameChoice()
    try:
        found = _synchronized(left, right, config.video_offset_s)
    except (NoEvidence, DeviceError) as error:
        return FrameChoice(notes=(f"frames of the same number are taken for pairs: {error}",))
    numbers = found.pairs[found.pairs[:, 0] % config.video_every == 0]
    chosen = numbers[np.unique(numbers[:, 1], return_index=True)[1]]  # a right frame once
    return FrameChoice(tuple(chosen[:, 0].tolist()), tuple(chosen[:, 1].tolist()), (f"{left.name} and {right.name}: {found.text}",))


def _synchronized(left: Path, right: Path, offset_s: float | None) -> VideoSync:
    if offset_s is None:
        return synchronize(left, right)
    lag = Lag(offset_s, 0.0, 0.0, LIMITS.drift)
    return paired((video_signals(left), video_signals(right)), lag)


def numbered(choice: tuple[int, ...] | None, every: int) -> Iterator[int]:
    """The numbers of the frames to be kept, rising; without end where every nth is."""
    if choice is not None:
        yield from choice
        return
    number = 0
    while True:
        yield number
        number += every
