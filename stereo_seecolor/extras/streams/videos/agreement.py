"""Whether the two frames of a pair are of one moment: both pictures must move alike around them.

A recorder may lose frames where the lag of the whole video does not show it, or repeat the last
frame instead of lost ones.
"""

import numpy as np

from stereo_seecolor.extras.streams.videos.lags import Lag
from stereo_seecolor.extras.streams.videos.motion import VideoSignals
from stereo_seecolor.extras.streams.videos.row_lag import Pairs
from stereo_seecolor.records import Array, Mask

AROUND_S = 1.0
"""Before and after a pair: motions of so long are compared."""
SMOOTH_S = 0.15
"""Rigs move at up to some 2 Hz: what is faster is noise of the measured motion."""
STILL = 0.004
"""Image widths a second about the mean motion: less is noise, as is less than twice what noise of
the measured motion leaves.
"""
UNLIKE = 0.5
"""Of the variances of both motions, that of their difference: 1 for unrelated ones. Cameras on one
rig had 0.03 at most on synthetic videos.
"""
REPEATED = 0.2
"""Of the motion of the other picture: one that moves less repeats the frame before."""


def unlike(signals: tuple[VideoSignals, VideoSignals], pairs: Pairs) -> Mask:
    """(n,) True for pairs within a second of which both pictures move, but not alike."""
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    times_s = [side.times_s[column] for side, column in zip(signals, pairs.T, strict=True)]
    size = max(3, round(2 * AROUND_S / float(np.median(np.diff(times_s[0])))))

    def spread(motion: Array) -> Array:
        """(n,) variance around each pair."""
        mean = uniform_filter1d(motion, size, axis=0, mode="reflect")
        square = uniform_filter1d(motion**2, size, axis=0, mode="reflect")
        return np.asarray((square - mean**2).sum(axis=1))

    smooth, moves = list[Array](), np.ones(len(pairs), bool)
    for side, at_s in zip(signals, times_s, strict=True):
        few = max(1, round(SMOOTH_S / side.frame_s))
        motion = uniform_filter1d(side.motion, few, axis=0, mode="nearest")
        noise = _at(at_s, side.motion_times_s, side.motion - motion)
        smooth.append(_at(at_s, side.motion_times_s, motion))
        moves &= spread(smooth[-1]) > np.maximum(STILL**2, 4 * spread(noise) / few)
    first, second = smooth
    across = second[:, ::-1] * [1, -1]
    turned = (second, across, -second, -across)  # a camera may be mounted sideways, or upside down
    second = min(turned, key=lambda other: float(spread(first - other).sum()))
    differ = spread(first - second) > UNLIKE * (spread(first) + spread(second))
    return np.asarray(maximum_filter1d(moves & differ, size))


def moved_since_repeated(
    signals: tuple[VideoSignals, VideoSignals], lag: Lag, pairs: Pairs
) -> Array:
    """(n,) image widths that one picture moved while the other repeated one frame, up to this
    pair; 0 for most.
    """
    left, right = signals
    wanted_s = lag.at(left.times_s)
    of_right_s = np.interp(right.times_s, wanted_s, left.times_s)
    moved = np.zeros(len(pairs))
    for own, other, at_s, numbers in (
        (left, right, wanted_s, pairs[:, 0]),
        (right, left, of_right_s, pairs[:, 1]),
    ):
        place = _at(at_s, other.times_s, other.place)
        own_steps, steps = (np.hypot(*np.diff(path, axis=0).T) for path in (own.place, place))
        repeats = np.concatenate([[False], own_steps < REPEATED * steps])
        shown = np.maximum.accumulate(np.where(repeats, 0, np.arange(len(repeats))))
        moved = np.maximum(moved, np.hypot(*(place - place[shown]).T)[numbers])
    return moved


def _at(times_s: Array, known_s: Array, values: Array) -> Array:
    """(n, 2) values (m, 2) of known times, interpolated."""
    return np.column_stack([np.interp(times_s, known_s, column) for column in values.T])
