"""Synchronization of two videos without a wire between the cameras: offset and drift by sound, a
flash, time codes, moving images.
"""

from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np

from calibration import StereoRig
from calibration.robust_statistics import deviation
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.videos.agreement import moved_since_repeated, unlike
from stereo_seecolor.extras.streams.videos.lags import LIMITS as LAG
from stereo_seecolor.extras.streams.videos.lags import Lag, coarse_lag, fine_lag, lags_at_step
from stereo_seecolor.extras.streams.videos.motion import NoEvidence, VideoSignals, video_signals
from stereo_seecolor.extras.streams.videos.row_lag import Pairs, row_lag
from stereo_seecolor.extras.streams.videos.sound import sound_lag
from stereo_seecolor.extras.streams.videos.time_code import time_code_lag
from stereo_seecolor.inputs.video_streams import sound
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class SyncLimits:
    """Decides what is believed."""

    # a rise of brightness from one frame to the next, against the usual ones
    flash_sigmas: float = 12.0
    flash_gray: float = 8.0  # and in gray values: less is a fish
    # image widths a second: the image stands still, and what moves is noise (0.0005 on a static
    # scene)
    still: float = 0.004
    disagree_s: float = 0.02  # cameras record sound up to half a frame early or late
    sigmas: float = 3.0
    # parts of the overlap whose lags are compared, as frames may be lost anywhere: so long, but at
    # least and at most so many
    part_s: float = 3.0
    parts: tuple[int, int] = (4, 32)
    # at either end, where a part is too long: frames lost within it, if the lags on both sides are
    # known to that fraction of a frame
    ends_s: float = 30.0
    known: float = 0.25
    reach_frames: float = 0.6  # a left frame is paired with a right one at most so many frames away
    # image widths that the image moves between both frames of a pair: 2 px of 1920, 2% of a range
    false_disparity: float = 1e-3
    least_pairs: float = 0.1  # of the pairs must be within that


LIMITS = SyncLimits()


@dataclass(frozen=True)
class Evidence:
    """The lag by one kind of evidence (``sound``, ``flash``, ``motion``, ``rows``, ...)."""

    kind: str
    lag: Lag


@dataclass(frozen=True, eq=False)
class VideoSync:
    """The synchronization of two videos, by the most precise evidence; the others agree with it.

    pairs: (n, 2) numbers of the frames that are nearest, left and right. rest_s: (n,) how far apart
    they are after all, right less left. false_disparity: (n,) what the image moves in that time,
    image widths. left_out: pairs for which that is too much.
    signals: of both videos. unlike: seconds of those left out since the two pictures do not move
    alike. time_code: what time codes say that were not set alike, None where they
    are used or there are none.
    """

    lag: Lag
    evidence: tuple[Evidence, ...]
    pairs: Pairs
    rest_s: Array
    false_disparity: Array
    left_out: int
    signals: tuple[VideoSignals, VideoSignals]
    time_code: Lag | None = None
    unlike: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """One line for the user."""
        kinds = " and ".join(item.kind for item in self.evidence) or "what was given"
        return (
            f"the right clock is {self.lag.offset_s:+.4f} s (standard error "
            f"{1000 * self.lag.std_s:.1f} ms) and runs {1e6 * self.lag.drift:+.0f} ppm "
            f"relative to the left one, from {kinds}; paired frames are "
            f"{1000 * float(np.sqrt(np.mean(self.rest_s**2))):.1f} ms apart; in this time the "
            f"image moves by {100 * float(np.median(self.false_disparity)):.2f}% of its "
            f"width{self._left_out_text}"
        )

    @property
    def _left_out_text(self) -> str:
        text = ""
        if fast := self.left_out - len(self.unlike):
            text = (
                f"; {fast} pairs with a motion of more than {LIMITS.false_disparity:.1%} are left "
                "out"
            )
        if self.unlike:
            text += (
                f"; {len(self.unlike)} pairs from {self.unlike[0]:.1f} to {self.unlike[-1]:.1f} s "
                "are left out, since the two images do not move alike: does one file lack frames?"
            )
        if self.time_code:
            text += (
                f"; their time codes say {self.time_code.offset_s:+.3f} s, so they were not "
                "synchronized, and are not used"
            )
        return text


def synchronize(left: Path, right: Path, rig: StereoRig | None) -> VideoSync:
    """Find offset and drift. rig: if known, rows of some pairs tell them most precisely.

    Raises NoEvidence where nothing tells them; InputError where the evidence disagrees, or the
    image moves too fast for the time that frames are apart; DeviceError.
    """
    signals = video_signals(left), video_signals(right)
    motion = motion_lag(*signals)
    _refuse_lost_frames(left, right, signals, motion)
    evidence = tuple(
        Evidence(kind, lag)
        for kind, lag in (
            ("motion", motion),
            ("sound", sound_lag(sound(left), sound(right))),
            ("flash", flash_lag(*signals)),
        )
        if lag is not None
    )
    code = time_code_lag(left, right)
    if code and all(_agree(item.lag, code) for item in evidence):
        evidence, code = (*evidence, Evidence("time code", code)), None
    if not evidence:
        raise NoEvidence(
            f"{left} and {right}: no evidence of their clock offset: no common sound, flash or "
            "time code, and too little or periodic image motion; clap or rotate the rig next "
            "time, or set input.video_offset_s",
            signals,
        )
    best = min(evidence, key=lambda item: item.lag.std_s).lag
    if rig is not None and (
        rows := row_lag((left, right), rig, signals, best, _nearest(signals, best)[0])
    ):
        evidence = (*evidence, Evidence("rows", rows))
        best = rows if rows.std_s < best.std_s else best
    _refuse_disagreement(left, right, evidence)
    if best.std_s > min(item.frame_s for item in signals) / 2:
        raise InputError(
            f"{left} and {right}: the standard error of their offset is "
            f"{1000 * best.std_s:.0f} ms, more than half a frame: do they show the same minutes "
            "of one dive? If so, set input.video_offset_s"
        )
    return replace(paired(signals, best, evidence), time_code=code)


def paired(
    signals: tuple[VideoSignals, VideoSignals], lag: Lag, evidence: tuple[Evidence, ...] = ()
) -> VideoSync:
    """The frames that are nearest by a lag; nothing is interpolated. Pairs that the image's
    motion spoils are left out.

    evidence: that the lag was found from; where it was given, all pairs are taken.
    Raises InputError if the videos do not overlap, or motion spoils nearly all pairs.
    """
    pairs, rest_s = _nearest(signals, lag)
    moved = signals[0].speed_at(signals[0].times_s[pairs[:, 0]]) * np.hypot(rest_s, lag.std_s)
    differ = np.zeros(len(pairs), bool)
    if evidence:
        moved = np.maximum(moved, moved_since_repeated(signals, lag, pairs))
    if any(item.kind == "motion" for item in evidence):
        differ = unlike(signals, pairs)
    slow = (moved <= LIMITS.false_disparity) | (not evidence)
    good = slow & ~differ
    if slow.mean() < LIMITS.least_pairs:
        usual, rest_ms = float(np.median(moved)), 1000 * float(np.sqrt(np.mean(rest_s**2)))
        raise InputError(
            f"the two frames of a pair are {rest_ms:.1f} ms apart; in this time the image moves "
            f"by {usual:.2%} of its width: {1920 * usual:.1f} px of false disparity at 1920 "
            "px; film at a higher rate or move more slowly, or set "
            f"input.video_offset_s={lag.offset_s:.4f} to use them anyway"
        )
    if not good.any():
        raise InputError(
            f"with the right clock {lag.offset_s:+.3f} s against the left one, the two images move "
            "alike only where they move too fast: do they show one dive?"
        )
    return VideoSync(
        lag,
        evidence,
        pairs[good],
        rest_s[good],
        moved[good],
        int((~good).sum()),
        signals,
        unlike=tuple(signals[0].times_s[pairs[differ, 0]].tolist()),
    )


def _nearest(signals: tuple[VideoSignals, VideoSignals], lag: Lag) -> tuple[Pairs, Array]:
    """(n, 2) numbers of frames that are nearest by a lag; (n,) seconds, right less left."""
    left, right = signals
    wanted_s = lag.at(left.times_s)
    after = np.clip(np.searchsorted(right.times_s, wanted_s), 1, len(right.times_s) - 1)
    nearest = np.where(
        wanted_s - right.times_s[after - 1] < right.times_s[after] - wanted_s, after - 1, after
    )
    rest_s = right.times_s[nearest] - wanted_s
    good = np.abs(rest_s) <= LIMITS.reach_frames * right.frame_s
    if not good.any():
        raise InputError(
            f"the videos do not overlap: the right clock is {lag.offset_s:+.1f} s against the "
            "left one"
        )
    return np.column_stack([np.flatnonzero(good), nearest[good]]), rest_s[good]


def motion_lag(left: VideoSignals, right: VideoSignals) -> Lag | None:
    """The lag by which both images move alike; None for an image that stands still, or moves so
    that several lags fit.
    """
    if min(_usual(left), _usual(right)) < LIMITS.still:
        return None
    times, motions = (left.motion_times_s, right.motion_times_s), (left.motion, right.motion)
    return _lag(times, motions)


def _lag(times: tuple[Array, Array], motions: tuple[Array, Array]) -> Lag | None:
    coarse_s = coarse_lag(times, motions)
    return None if coarse_s is None else fine_lag(times, motions, coarse_s)


def _refuse_lost_frames(
    left: Path, right: Path, signals: tuple[VideoSignals, VideoSignals], whole: Lag | None
) -> None:
    """Raise InputError where the motion of parts of a video gives lags that no drift of clocks
    explains. whole: the lag by all motion.
    """
    first, second = signals
    if min(_usual(first), _usual(second)) < LIMITS.still:
        return
    own_s, times_s = first.motion_times_s, second.motion_times_s
    begin_s, end_s = own_s[0], own_s[-1]
    if whole:  # what only one of the two has agrees with something by chance
        begin_s = max(begin_s, times_s[0] - whole.offset_s)
        end_s = min(end_s, times_s[-1] - whole.offset_s)

    def lags(parts: int) -> list[Lag | None]:
        """The lag of each part of the overlap: of halves any, of others near that of all."""
        edges_s, found = np.linspace(begin_s, end_s, parts + 1), list[Lag | None]()
        for since_s, until_s in pairwise(edges_s):
            part = (own_s >= since_s) & (own_s <= until_s)
            of_part = (own_s[part], times_s), (first.motion[part], second.motion)
            if part.sum() < 2:
                found.append(None)
            elif whole and parts > 2:
                found.append(fine_lag(*of_part, whole.offset_s))
            else:
                found.append(_lag(*of_part))
        return found

    halves = lags(2)
    parts = int(np.clip((end_s - begin_s) / LIMITS.part_s, *LIMITS.parts))
    at_ends = _lags_at_ends(signals, whole, begin_s, end_s) if whole else []
    near = [*lags(parts), *at_ends] if whole else []
    found = sorted(
        [lag for lag in (halves if all(halves) else []) + near if lag],
        key=lambda lag: lag.center_s,
    )
    for a, b in combinations(found, 2):
        usual_s = 2 * LAG.drift * abs(b.center_s - a.center_s)
        usual_s += LIMITS.sigmas * float(np.hypot(a.std_s, b.std_s))
        if abs(b.offset_s - a.offset_s) > max(first.frame_s, second.frame_s) / 2 + usual_s:
            raise InputError(
                f"{left} and {right}: the right clock is {a.offset_s:+.3f} s relative to the left "
                f"one around {a.center_s:.1f} s and {b.offset_s:+.3f} s around {b.center_s:.1f} "
                "s: one of the files lacks frames (lost while recording, or cut out): convert it "
                "with the times of its frames, or run the parts separately"
            )


def _lags_at_ends(
    signals: tuple[VideoSignals, VideoSignals], whole: Lag, begin_s: float, end_s: float
) -> list[Lag]:
    """The lags before and after a moment of the first and of the last seconds."""
    first, second = signals
    own_s, found = first.motion_times_s, list[Lag]()
    for is_end in (own_s <= begin_s + LIMITS.ends_s, own_s >= end_s - LIMITS.ends_s):
        times, motions = (own_s[is_end], second.motion_times_s), first.motion[is_end]
        both = lags_at_step(times, (motions, second.motion), whole)
        if all(lag.std_s < LIMITS.known * first.frame_s for lag in both):
            found += both
    return found


def flash_lag(left: VideoSignals, right: VideoSignals) -> Lag | None:
    """The lag of the one sudden rise of brightness; None where there is none, or several."""
    times = [_flash(signals) for signals in (left, right)]
    if times[0] is None or times[1] is None:
        return None
    # it came at any time between two frames
    std_s = float(np.hypot(left.frame_s, right.frame_s) / np.sqrt(12))
    return Lag(times[1] - times[0], std_s, 0.0, 50e-6, times[0])


def _flash(signals: VideoSignals) -> float | None:
    rise = np.diff(signals.brightness)
    at = int(np.argmax(rise))
    usual = deviation(rise) + 1e-6
    others = np.abs(signals.motion_times_s - signals.motion_times_s[at]) > 0.3
    alone = rise[others].max(initial=0.0) < rise[at] / 2
    if rise[at] < max(LIMITS.flash_gray, LIMITS.flash_sigmas * usual) or not alone:
        return None
    return float(signals.motion_times_s[at])


def _refuse_disagreement(left: Path, right: Path, evidence: tuple[Evidence, ...]) -> None:
    for a, b in combinations(evidence, 2):
        if not _agree(a.lag, b.lag):
            raise InputError(
                f"{left} and {right}: {a.kind} says that the right clock is {a.lag.offset_s:+.3f} "
                f"s relative to the left one, {b.kind} says {b.lag.offset_s:+.3f} s: do they show "
                "one dive? If so, set input.video_offset_s"
            )


def _agree(a: Lag, b: Lag) -> bool:
    at = np.array([a.center_s])
    apart_s = abs(float((a.at(at) - b.at(at))[0]))
    return apart_s <= LIMITS.disagree_s + LIMITS.sigmas * float(np.hypot(a.std_s, b.std_s))


def _usual(signals: VideoSignals) -> float:
    """How fast the image moves about its mean motion, image widths a second."""
    return float(np.sqrt((signals.motion.std(axis=0) ** 2).sum()))
