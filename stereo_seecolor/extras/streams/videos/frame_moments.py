"""Frames of the same moment, of two videos without evidence of the offset of their clocks: those of
the same number, but recorders lose frames, repeat the last one instead, or begin with black.

Gaps in the times of frames show what was lost. So does, while the cameras move steadily, an image
that moves once several times as far as from frame to frame around, or not at all, where the other
one moves as usual. How many frames it were, the lengths of both videos must confirm.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from stereo_seecolor.extras.streams.videos.motion import VideoSignals
from stereo_seecolor.records import Array

Places = NDArray[np.int64]


@dataclass(frozen=True)
class MomentLimits:
    """Decides what is a lost, repeated or black frame."""

    # of the intervals, in frames: farther from whole numbers than that, the rate itself varies
    uneven: float = 0.25
    around_s: float = 1.0  # the usual motion is a median over so long
    # image widths from frame to frame: 0.4 px of those compared, which are good to 0.05 px
    least_motion: float = 0.002
    still: float = 0.2  # of the usual motion: a repeated frame moves less
    lost: float = 1.7  # and the one after a lost frame more
    across: float = 0.25  # of that motion: a flash or a fish moves an image any way
    usual: float = 0.4  # so near to the usual motion, of the neighbors and of the other image
    near: int = 2  # frames on either side in which the other image moves as usual
    black: float = 4.0  # gray values about the darkest frame; others are four times as far from it


LIMITS = MomentLimits()


@dataclass(frozen=True, eq=False)
class Moments:
    """pairs: (n, 2) numbers of frames of one moment. notes: on frames that were lost or repeated.
    is_wrong: it is not known which frames are of one moment.
    """

    pairs: Places
    notes: tuple[str, ...] = ()
    is_wrong: bool = False


@dataclass(frozen=True, eq=False)
class _RecordedFrames:
    """One video. moment: (n,) of each frame, by its times. repeated: numbers of frames that repeat
    the one before; replaced: in place of a frame, so that the next one moves twice as far. lost:
    numbers of frames before which some were lost, by the motion. black: how many it begins with.
    """

    name: str
    times_s: Array
    moment: Places
    repeated: Places
    replaced: bool
    lost: Places
    black: int

    @property
    def shifted(self) -> int:
        """By how many places frames have another number than their moment, as far as it shows."""
        inserted = 0 if self.replaced else len(self.repeated)
        return inserted + len(self.lost) + self.black

    @property
    def notes(self) -> tuple[str, ...]:
        """What the recorder did to the frames of this side."""
        gaps = np.flatnonzero(np.diff(self.moment) > 1) + 1
        found = (
            ("lacks frames by the times of the others", gaps),
            ("lacks frames by its motion", self.lost),
            ("repeats frames", self.repeated),
        )
        return tuple(
            f"{self.name} {what}, in {counted(len(at), 'place')}, the first at "
            f"{self.times_s[at[0]]:.2f} s"
            for what, at in found
            if len(at)
        ) + (
            (f"{self.name} begins with {counted(self.black, 'frame')} of black",) * bool(self.black)
        )


def frames_of_equal_moments(
    names: tuple[str, str], signals: tuple[VideoSignals, VideoSignals]
) -> Moments:
    """Pair frames of two videos that began at one moment. names: for the notes."""
    sides = [
        _side(name, own, other)
        for name, own, other in zip(names, signals, signals[::-1], strict=True)
    ]
    more = int(sides[0].moment[-1] - sides[1].moment[-1])
    counts = [side.moment.copy() for side in sides]
    confirmed = not more and not any(side.shifted for side in sides)
    for side, count, extra in zip(sides, counts, (more, -more), strict=True):
        if extra > 0 and extra == side.shifted - len(side.lost):
            inserted = side.repeated[: 0 if side.replaced else None]
            count[:] -= side.black + np.searchsorted(inserted, np.arange(len(count)), "right")
            confirmed = True
        elif extra < 0 and side.shifted == len(side.lost) == 1:
            count[side.lost[0] :] -= extra
            confirmed = True
    good = [np.ones(len(count), bool) for count in counts]
    for side, kept in zip(sides, good, strict=True):
        kept[side.repeated] = False
    notes = tuple(note for side in sides for note in side.notes)
    if not confirmed and not notes:
        lengths = " and ".join(f"{len(side.moment)}" for side in sides)
        notes = (f"{' and '.join(names)} hold {lengths} frames: did both begin at one moment?",)
    is_wrong = not confirmed and any(side.shifted for side in sides)
    if is_wrong:
        notes = (
            *notes,
            f"their lengths, {len(counts[0])} and {len(counts[1])} frames, do not fit that: which "
            "frames are of one moment is not known, and ranges may be wrong: convert the videos "
            "with the times of their frames, or run the parts between these places separately",
        )
    numbers = [np.flatnonzero(kept) for kept in good]
    _, left, right = np.intersect1d(counts[0][good[0]], counts[1][good[1]], return_indices=True)
    return Moments(np.column_stack([numbers[0][left], numbers[1][right]]), notes, is_wrong)


def _side(name: str, own: VideoSignals, other: VideoSignals) -> _RecordedFrames:
    steps = _steps_of_times(own)
    along, across = _relative_motion(own)
    usual = np.abs(along - 1) < LIMITS.usual
    other_usual = np.abs(_relative_motion(other)[0] - 1) < LIMITS.usual
    repeated, lost = list[int](), list[int]()
    for i in range(1, len(along) - 1):
        there = round(i * len(other_usual) / len(along))
        around = other_usual[max(0, there - LIMITS.near) : there + LIMITS.near + 1]
        if not (usual[i - 1] and around.all()) or across[i] > LIMITS.across * max(1.0, along[i]):
            continue
        if abs(along[i]) < LIMITS.still and along[i + 1] > 1 - LIMITS.usual:
            repeated.append(i + 1)
        elif along[i] > LIMITS.lost and usual[i + 1]:
            lost.append(i + 1)
    return _RecordedFrames(
        name,
        own.times_s,
        np.concatenate([[0], np.cumsum(steps)]),
        np.array(repeated, np.int64),
        bool(len(repeated) and np.median(along[repeated]) > LIMITS.lost),
        np.array(lost, np.int64),
        _leading_black(own, other),
    )


def _steps_of_times(signals: VideoSignals) -> Places:
    """(n-1,) frames from one to the next by their times; 1 where the rate itself varies."""
    frames = np.diff(signals.times_s) / signals.frame_s
    whole = np.maximum(np.rint(frames), 1)
    is_even = np.quantile(np.abs(frames - whole), 0.99) < LIMITS.uneven
    return (whole if is_even else np.ones(len(frames))).astype(np.int64)


def _relative_motion(signals: VideoSignals) -> tuple[Array, Array]:
    """(n-1,) motion along and across the usual motion around it, in units of that; NaN where the
    image hardly moves.
    """
    from scipy.ndimage import median_filter

    size = max(5, round(LIMITS.around_s / signals.frame_s))
    usual = median_filter(signals.motion, size=(size, 1), mode="nearest")
    square = (usual**2).sum(axis=1)
    moves = np.sqrt(square) * signals.frame_s >= LIMITS.least_motion
    square = np.where(moves, square, np.nan)
    along = (signals.motion * usual).sum(axis=1) / square
    rest = signals.motion - along[:, None] * usual
    return along, np.sqrt((rest**2).sum(axis=1) / square)


def _leading_black(own: VideoSignals, other: VideoSignals) -> int:
    """How many black frames a side begins with, where the other does not."""
    dark = own.brightness < own.brightness.min() + LIMITS.black
    clear = own.brightness.min() + 4 * LIMITS.black
    if dark.all() or not dark[0] or min(own.brightness.max(), other.brightness[0]) < clear:
        return 0
    return int(np.argmin(dark))
