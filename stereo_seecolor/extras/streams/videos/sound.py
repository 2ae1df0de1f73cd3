"""The lag of one video's sound behind another's."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.streams.videos.lags import Lag, coarse_lag, straight_lag
from stereo_seecolor.inputs.video_streams import SOUND_RATE_HZ
from stereo_seecolor.records import Array

# of the loudness that gives the first estimate: half a period is far below REACH_S
ENVELOPE_HZ = 100
WINDOW_S, REACH_S = 2.0, 0.1
"""Pieces of sound that are compared, and how far about the first estimate."""

MOST_WINDOWS = 120  # pieces over the video: a bound on time
PEAK = 6.0
"""A piece counts where its best lag stands out from the others by so many standard deviations;
noise reaches 4 to 5.
"""

FLOOR_S = 1e-3
"""Of one piece: echoes, and 1.5 ms a meter of air or water between source and camera that is not
the same for both.
"""

Sound = tuple[float, NDArray[np.float32]]
"""When it begins on its file's clock, seconds; samples at SOUND_RATE_HZ."""


def sound_lag(left: Sound, right: Sound) -> Lag | None:
    """First by loudness, then by the waves themselves, piece by piece; None where there is no
    sound, or none in common.
    """
    if min(len(left[1]), len(right[1])) < WINDOW_S * SOUND_RATE_HZ or not (
        left[1].any() and right[1].any()
    ):
        return None
    envelopes = [_envelope(samples) for _, samples in (left, right)]
    times = [
        start_s + (np.arange(len(e)) + 0.5) / ENVELOPE_HZ
        for (start_s, _), e in zip((left, right), envelopes, strict=True)
    ]
    coarse_s = coarse_lag((times[0], times[1]), (envelopes[0], envelopes[1]))
    if coarse_s is None:
        return None
    starts = np.arange(left[0], left[0] + len(left[1]) / SOUND_RATE_HZ - WINDOW_S, WINDOW_S)
    found = [
        (start_s + WINDOW_S / 2, offset_s)
        for start_s in starts[:: -(-len(starts) // MOST_WINDOWS) or 1]
        if (offset_s := _window_lag(left, right, start_s, coarse_s)) is not None
    ]
    if not found:
        return None
    at, offsets_s = np.array(found).T
    return straight_lag(at, offsets_s, FLOOR_S)


def _envelope(samples: NDArray[np.float32]) -> Array:
    """(n, 1) change of the logarithm of loudness, ENVELOPE_HZ times a second."""
    size = SOUND_RATE_HZ // ENVELOPE_HZ
    power = (samples[: len(samples) // size * size].astype(np.float64).reshape(-1, size) ** 2).mean(
        axis=1
    )
    loud = np.log(power + 1e-3 * power.mean() + 1e-12)
    return np.asarray(np.gradient(np.convolve(loud, np.ones(3) / 3, "same"))[:, None])


def _window_lag(left: Sound, right: Sound, start_s: float, coarse_s: float) -> float | None:
    """Where a piece of the left sound is found in the right one, by the phases of its frequencies
    (GCC-PHAT); None if nowhere.
    """
    size, reach = round(WINDOW_S * SOUND_RATE_HZ), round(REACH_S * SOUND_RATE_HZ)
    first = round((start_s - left[0]) * SOUND_RATE_HZ)
    second = round((start_s + coarse_s - right[0]) * SOUND_RATE_HZ) - reach
    piece, wide = (
        left[1][first : first + size],
        right[1][second : second + size + 2 * reach] if second >= 0 else left[1][:0],
    )
    if len(piece) < size or len(wide) < size + 2 * reach:
        return None
    total = 1 << (len(wide) + size).bit_length()
    cross = np.fft.rfft(wide, total) * np.conj(np.fft.rfft(piece, total))
    correlation = np.fft.irfft(
        cross / (np.abs(cross) + 1e-3 * np.abs(cross).mean() + 1e-12), total
    )[: 2 * reach + 1]
    best = int(np.argmax(correlation))
    if not 0 < best < 2 * reach or correlation[best] < PEAK * correlation.std():
        return None
    before, at, after = correlation[best - 1 : best + 2]
    part = 0.5 * (before - after) / (before - 2 * at + after)
    exact = (second + best + part) / SOUND_RATE_HZ + right[0]
    return float(exact - (first / SOUND_RATE_HZ + left[0]))
