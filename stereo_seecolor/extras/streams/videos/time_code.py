"""The time code track of videos (SMPTE ST 12-1): the first frame's time of day, in frames."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from stereo_seecolor.extras.streams.videos.lags import LIMITS, Lag
from stereo_seecolor.inputs.video_streams import opened, video_stream

DAY_S = 86_400.0
_TEXT = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.,])(\d\d)")


def time_code_lag(left: Path, right: Path) -> Lag | None:
    """The lag of cameras with equal time codes; None without. Raises InputError, DeviceError."""
    first, second = _start(left), _start(right)
    if first is None or second is None:
        return None
    (left_s, left_frame_s), (right_s, right_frame_s) = first, second
    offset_s = (left_s - right_s + DAY_S / 2) % DAY_S - DAY_S / 2
    std_s = float(np.hypot(left_frame_s, right_frame_s) / np.sqrt(12))  # whole frames
    return Lag(offset_s, std_s, 0.0, LIMITS.drift)


def _start(path: Path) -> tuple[float, float] | None:
    """Time of day at time 0 of the file's clock, and the time from frame to frame, seconds."""
    with opened(path) as container:
        stream = video_stream(container, path)
        found = _TEXT.fullmatch(_said(container))
        if not found or not stream.average_rate:
            return None
        frame_s = float(1 / stream.average_rate)
        return _frames(found, round(1 / frame_s)) * frame_s - float(
            (stream.start_time or 0) * stream.time_base
        ), frame_s


def _said(container: Any) -> str:
    """What the file, or one of its streams, says of its time code."""
    for about in (container.metadata, *(stream.metadata for stream in container.streams)):
        for name, value in about.items():
            if name.lower() == "timecode":
                return str(value)
    return ""


def _frames(code: re.Match[str], rate: int) -> int:
    """Frames since midnight. After a semicolon two numbers of 30 (four of 60) are dropped each
    minute but each tenth.
    """
    hours, minutes, seconds, frames = (int(code[i]) for i in (1, 2, 3, 5))
    minutes += 60 * hours
    dropped = round(rate / 15) * (minutes - minutes // 10) if code[4] in ";," else 0
    return (60 * minutes + seconds) * rate + frames - dropped
