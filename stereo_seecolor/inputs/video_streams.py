"""The streams of a video file, by PyAV (FFmpeg): pictures in gray, sound, time of recording."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError, library_for
from stereo_seecolor.files.image_headers import refuse_large
from stereo_seecolor.files.whole_files import special_kind

SOUND_RATE_HZ = 8000
"""Enough for voices, clicks and motors; a sample is 0.1 ms."""

MOST_BOXES = 1000
"""An MP4 has a few boxes at its top; one that streams, two for each piece."""


def video_library() -> Any:
    """PyAV. Raises DeviceError if it is missing."""
    with library_for("a video", "video"):
        import av
    return av


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The container of a video. Raises InputError if it cannot be read, DeviceError."""
    av = video_library()
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a video")
        with av.open(str(path), metadata_errors="ignore") as container:
            yield container
    except (av.FFmpegError, OSError) as error:
        raise InputError(
            f"{path}: "
            + (
                _unfinished(path)
                or f"is not a video that FFmpeg can read: {error.strerror or error}"
            )
        ) from error


def _unfinished(path: Path) -> str:
    """What is wrong with a file that is empty, or an MP4 or MOV without its index, which cameras
    write last; empty where it is something else.
    """
    boxes, place = set[bytes](), 0
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            for _ in range(MOST_BOXES):
                if place >= size:
                    break
                file.seek(place)
                length, name, long = struct.unpack(">I4sQ", file.read(16).ljust(16, b"\0"))
                boxes.add(name)
                place += max((long if length == 1 else length) or size, 8)
    except OSError:
        return ""
    if not size:
        return "is empty: copy it again from the camera"
    if b"ftyp" in boxes and b"moov" not in boxes:
        return (
            "has no index (moov): the recording was not finished, or the copy is not complete: "
            "copy it again, or repair it with the camera or untrunc"
        )
    return ""


def video_stream(container: Any, path: Path) -> Any:
    """The stream of pictures. Raises InputError if it is missing, too large or unknown."""
    stream = container.streams.best("video")  # not a cover picture
    if stream is None:
        raise InputError(f"{path}: holds no video frames")
    if stream.codec_context is None:
        raise InputError(f"{path}: FFmpeg does not know the codec of its frames")
    refuse_large(path, stream.width, stream.height)
    stream.thread_type = "AUTO"
    return stream


def gray_frames(path: Path) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Each frame's time in seconds on the file's own clock, and the frame in gray, upright.

    A damaged frame ends it. Raises InputError if there is none, DeviceError.
    """
    count = 0
    with opened(path) as container:
        for frame in decoded(container, video_stream(container, path)):
            if frame.pts is None:
                continue
            yield float(frame.pts * frame.time_base), gray(frame)
            count += 1
    if not count:
        raise InputError(f"{path}: holds no frame that can be decoded")


def gray(frame: Any) -> NDArray[np.uint8]:
    """Convert a decoded frame to gray, (H, W), turned as the file tells players to."""
    return np.rot90(frame.to_ndarray(format="gray"), round(frame.rotation / 90))


def sound(path: Path) -> tuple[float, NDArray[np.float32]]:
    """Read the time at which the sound begins on the file's own clock, seconds, and its samples at
    SOUND_RATE_HZ; none where it is silent or absent.

    Raises InputError, DeviceError.
    """
    with opened(path) as container:
        if not container.streams.audio:
            return 0.0, np.zeros(0, np.float32)
        import av

        resampler = av.AudioResampler(format="flt", layout="mono", rate=SOUND_RATE_HZ)
        start_s, parts = None, []
        for frame in decoded(container, container.streams.audio[0]):
            if start_s is None and frame.pts is not None:
                start_s = float(frame.pts * frame.time_base)
            parts += [np.asarray(piece.to_ndarray()).ravel() for piece in resampler.resample(frame)]
        return start_s or 0.0, np.concatenate(parts).astype(np.float32) if parts else np.zeros(
            0, np.float32
        )


def recorded_at(path: Path) -> float | None:
    """Read when a recording began by its camera's clock, seconds since 1970; None where the file
    does not say.

    Cameras that write their local time are taken to be at UTC. Raises InputError, DeviceError.
    """
    with opened(path) as container:
        try:
            return (
                datetime.fromisoformat(container.metadata.get("creation_time", ""))
                .replace(tzinfo=UTC)
                .timestamp()
            )
        except ValueError:
            return None


def decoded(container: Any, stream: Any) -> Iterator[Any]:
    """Frames up to the first that is damaged: what follows it would have times, but no pictures."""
    import av

    try:
        yield from container.decode(stream)
    except av.FFmpegError:
        return
