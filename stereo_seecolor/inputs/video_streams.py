"""What a video file holds beside its pictures: exact times of its frames, and its sound. By PyAV (FFmpeg)."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.files.reading import special_kind

EARLY_S = 1e-4
"""A frame is of a time where it is no more than this before it: times are fractions of a second in files."""

SOUND_RATE_HZ = 8000
"""Enough for voices, clicks and motors; a sample is 0.1 ms."""


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The container of a video. Raises InputError if it cannot be opened or read, DeviceError if PyAV is missing."""
    try:
        import av
    except ImportError as error:
        raise DeviceError("two videos need a library that is missing (av): pip install -c constraints.txt '.[video]'") from error
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a video")
        with av.open(str(path), metadata_errors="ignore") as container:
            yield container
    except (av.FFmpegError, OSError) as error:
        raise InputError(f"{path}: is no video that FFmpeg can read: {error.strerror or error}") from error


def gray_frames(path: Path) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Each frame's time in seconds on the file's own clock, and the frame in gray; not turned.

    A damaged frame ends it. Raises InputError if there is none, DeviceError.
    """
    count = 0
    with opened(path) as container:
        if not container.streams.video:
            raise InputError(f"{path}: holds no pictures")
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        for frame in _decoded(container, stream):
            if frame.pts is None:
                continue
            yield float(frame.pts * frame.time_base), frame.to_ndarray(format="gray")
            count += 1
    if not count:
        raise InputError(f"{path}: holds no frame that can be decoded")


def frames_at(path: Path, times_s: Sequence[float]) -> Iterator[NDArray[np.uint8]]:
    """The frames of these times, rising, in gray at their own size, found by the file's index; not turned.

    Ends where the file does, or a frame is damaged. Raises InputError, DeviceError.
    """
    with opened(path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        for time_s in times_s:
            container.seek(max(0, int((time_s - EARLY_S) / stream.time_base)), stream=stream)
            frame = next((frame for frame in _decoded(container, stream) if _is_at(frame, time_s)), None)
            if frame is None:
                return
            yield frame.to_ndarray(format="gray")


def _is_at(frame: Any, time_s: float) -> bool:
    return frame.pts is not None and float(frame.pts * frame.time_base) > time_s - EARLY_S


def sound(path: Path) -> tuple[float, NDArray[np.float32]]:
    """When the sound begins on the file's own clock, seconds, and its samples at SOUND_RATE_HZ; none where it is silent or absent.

    Raises InputError, DeviceError.
    """
    with opened(path) as container:
        if not container.streams.audio:
            return 0.0, np.zeros(0, np.float32)
        import av

        resampler = av.AudioResampler(format="flt", layout="mono", rate=SOUND_RATE_HZ)
        start_s, parts = None, []
        for frame in _decoded(container, container.streams.audio[0]):
            if start_s is None and frame.pts is not None:
                start_s = float(frame.pts * frame.time_base)
            parts += [np.asarray(piece.to_ndarray()).ravel() for piece in resampler.resample(frame)]
        return start_s or 0.0, np.concatenate(parts).astype(np.float32) if parts else np.zeros(0, np.float32)


def _decoded(container: Any, stream: Any) -> Iterator[Any]:
    """Frames up to the first that is damaged: what follows it would have times, but no pictures."""
    import av

    try:
        yield from container.decode(stream)
    except av.FFmpegError:
        return
