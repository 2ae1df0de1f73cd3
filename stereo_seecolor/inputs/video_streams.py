"""What a video file holds beside its pictures: exact times of its frames, and its sound. By PyAV (FFmpeg)."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.files.reading import special_kind

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


def gray_frames(path: Path, width_px: int) -> Iterator[tuple[float, NDArray[np.float32]]]:
    """Each frame's time in seconds on the file's own clock, and the frame in gray, made smaller; not turned.

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
            gray = frame.to_ndarray(format="gray")
            size = (width_px, max(1, round(gray.shape[0] * width_px / gray.shape[1])))
            yield float(frame.pts * frame.time_base), cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float32)
            count += 1
    if not count:
        raise InputError(f"{path}: holds no frame that can be decoded")


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
