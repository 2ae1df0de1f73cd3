"""Video as input: its frames are unpacked once into folders of PNG files, and from then on it is like any other dive."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError, OutputError

EXTENSIONS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".m4v", ".mpg", ".mpeg", ".webm"})


def is_video(path: Path) -> bool:
    """True for a file with a video's extension."""
    return path.suffix.lower() in EXTENSIONS and not path.is_dir()


def unpack(left: Path, right: Path, folder: Path, every: int) -> tuple[Path, Path]:
    """Unpack the frames of two videos, or of one that shows left and right side by side, into ``folder``/left and /right.

    left, right: one file a side; the same file twice means side by side. every: 1 keeps each frame, 2 every second, and so on.
    What the same files, unchanged since, were unpacked to is kept; other frames in ``folder`` are deleted.
    Raises InputError if a video cannot be opened; OutputError if the disk is full.
    """
    changed = "-".join(f"{_changed_ns(path):x}" for path in (left, right))
    unpacked = folder / f"{left.stem}-{right.stem}-every-{every}-{changed}"
    sides = unpacked / "left", unpacked / "right"
    if unpacked.exists():
        return sides
    temporary = folder / f".writing-{unpacked.name}"
    try:
        shutil.rmtree(folder, ignore_errors=True)
        if left == right:
            _write(temporary, ("left", "right"), (frame for frame in _halves(_frames(left, every), left)))
        else:
            _write(temporary, ("left",), ((frame,) for frame in _frames(left, every)))
            _write(temporary, ("right",), ((frame,) for frame in _frames(right, every)))
        temporary.rename(unpacked)
    except OSError as error:
        raise OutputError(f"{temporary}: the video's frames cannot be unpacked: {error.strerror or error}") from error
    return sides


def _changed_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError as error:
        raise InputError(f"{path}: the video cannot be read: {error.strerror}") from error


def _frames(path: Path, every: int) -> Iterator[NDArray[np.uint8]]:
    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise InputError(f"{path}: is no video that OpenCV can open: unpack its frames into a folder and give that")
        index = 0
        while video.grab():
            if index % every == 0:
                yield video.retrieve()[1]
            index += 1
        if index == 0:
            raise InputError(f"{path}: holds no frame that can be decoded")
    finally:
        video.release()


def _halves(frames: Iterator[NDArray[np.uint8]], path: Path) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    for frame in frames:
        width = frame.shape[1]
        if width % 2:
            raise InputError(f"{path}: is {width} px wide, an odd number: left and right do not stand side by side in it")
        yield frame[:, : width // 2], frame[:, width // 2 :]


def _write(folder: Path, sides: tuple[str, ...], frames: Iterator[tuple[NDArray[np.uint8], ...]]) -> None:
    for side in sides:
        (folder / side).mkdir(parents=True, exist_ok=True)
    for number, images in enumerate(frames):
        for side, image in zip(sides, images, strict=True):
            content: NDArray[np.uint8] = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
            (folder / side / f"{number:06d}.png").write_bytes(content.tobytes())
