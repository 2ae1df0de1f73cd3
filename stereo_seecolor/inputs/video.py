"""Video as input: its frames are unpacked once into folders of PNG files, and from then on it is like any other dive."""

import hashlib
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import StereoRig
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import TEMPORARY_PREFIX, flush_folder, output_errors, remove_leftovers, write_atomic
from stereo_seecolor.files.names import product_name
from stereo_seecolor.files.reading import special_kind
from stereo_seecolor.inputs.video_choice import FrameChoice, choose_frames, numbered

EXTENSIONS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".m4v", ".mpg", ".mpeg", ".webm"})

SAMPLE_BYTES = 1 << 20
"""A video is told from others by its size, its time of change, and so much of its beginning, middle and end."""

_STEM_LETTERS = 40  # of a video's name in the name of its folder: frames add to it
_PNG_FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1)


def is_video(path: Path) -> bool:
    """True for a file with a video's extension."""
    return path.suffix.lower() in EXTENSIONS and not path.is_dir()


@dataclass(frozen=True)
class Unpacked:
    """left, right: the folders of frames. notes: how frames of two videos were paired, where they were unpacked just now."""

    left: Path
    right: Path
    notes: tuple[str, ...] = ()


def unpack(left: Path, right: Path, folder: Path, config: InputConfig, rig: StereoRig | None = None) -> Unpacked:
    """Unpack the frames of two videos, or of one that shows left and right side by side.

    left, right: one file a side; the same file twice means side by side. Frames are chosen by ``choose_frames``.
    folder: each unpacking gets a folder of its own in it, named after the videos' content; a finished one is kept, an unfinished
    one is replaced, and others are left alone. Call it only while ``folder`` is locked.
    Raises InputError if a video cannot be opened or read; OutputError if the disk is full.
    """
    unpacked = folder / unpacked_name(left, right, config)
    notes: tuple[str, ...] = ()
    if not unpacked.exists():
        choice = choose_frames(left, right, config, rig)
        notes = choice.notes
        remove_leftovers(folder)
        temporary = folder / f"{TEMPORARY_PREFIX}{unpacked.name}"
        try:
            _write_sides(left, right, config.video_every, choice, temporary)
            with output_errors(unpacked):
                temporary.rename(unpacked)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        flush_folder(folder)
    return Unpacked(unpacked / "left", unpacked / "right", notes)


def unpacked_name(left: Path, right: Path, config: InputConfig) -> str:
    """The name of the folder that the frames are unpacked into: equal for equal videos, whatever folder they lie in."""
    digest = hashlib.sha256()
    for path in dict.fromkeys((left, right)):
        digest.update(_identity(path))
    if left != right:
        digest.update(f"by time {config.video_offset_s}".encode())
    if config.video_overlap or config.video_skip_blurred:
        digest.update(f"overlap {config.video_overlap}, without blurred {config.video_skip_blurred}".encode())
    return f"{product_name(left.stem)[:_STEM_LETTERS]}-every-{config.video_every}-{digest.hexdigest()[:16]}"


def _identity(path: Path) -> bytes:
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a video")
        facts = path.stat()
        with path.open("rb") as file:
            parts = [f"{facts.st_size} {facts.st_mtime_ns}".encode()]
            for start in (0, facts.st_size // 2, max(0, facts.st_size - SAMPLE_BYTES)):
                file.seek(start)
                parts.append(hashlib.sha256(file.read(SAMPLE_BYTES)).digest())
    except OSError as error:
        raise InputError(f"{path}: the video cannot be read: {error.strerror}") from error
    return b" ".join(parts)


def _write_sides(left: Path, right: Path, every: int, choice: FrameChoice, folder: Path) -> None:
    if left == right:
        _write(folder, ("left", "right"), _halves(_frames(left, numbered(choice.left, every)), left))
        return
    _write(folder, ("left",), ((frame,) for frame in _frames(left, numbered(choice.left, every))))
    _write(folder, ("right",), ((frame,) for frame in _frames(right, numbered(choice.right, every))))


def _frames(path: Path, numbers: Iterator[int]) -> Iterator[NDArray[np.uint8]]:
    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise InputError(f"{path}: is no video that OpenCV can open: unpack its frames into a folder and give that")
        index, wanted = 0, next(numbers, None)
        while wanted is not None and video.grab():
            if index == wanted:
                yield video.retrieve()[1]
                wanted = next(numbers, None)
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
    for number, images in enumerate(frames):
        for side, image in zip(sides, images, strict=True):
            content: NDArray[np.uint8] = cv2.imencode(".png", image, _PNG_FAST)[1]
            write_atomic(folder / side / f"{number:06d}.png", content.data)
