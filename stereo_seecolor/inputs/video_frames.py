"""The frames of a video as image files inside it: ``dive.mp4/000012.tif``; halves of a picture
that shows both sides, ``dive.mp4/left/000012.tif``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import Container
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.halves import SIDES, half_of
from stereo_seecolor.inputs.video_file import video_file
from stereo_seecolor.inputs.video_streams import gray

EXTENSIONS = frozenset(
    {
        *(".mp4", ".mov", ".avi", ".mkv", ".m4v", ".mpg", ".mpeg", ".webm"),
        *(".mts", ".m2ts", ".ts", ".wmv", ".3gp"),
    }
)

FULL_16 = 257 / 256
"""FFmpeg makes white of 8 bits 255 * 256 of 16; the rest of the program has it at 65535."""


def is_video(path: Path) -> bool:
    """Tell whether a file has a video's extension."""
    return path.suffix.lower() in EXTENSIONS and not path.is_dir()


@dataclass(frozen=True)
class VideoFacts:
    """What a video holds. size: (width, height), pixels. rate_hz: None for one frame."""

    size: tuple[int, int]
    frames: int
    rate_hz: float | None
    seconds: float


def video_facts(path: Path) -> VideoFacts:
    """Look at a video's index and first frame. Raises InputError, DeviceError."""
    video = video_file(path)
    height, width = video.read(0, gray).shape
    number, frame_s = len(video.index.pts), video.index.frame_s
    rate_hz = 1 / frame_s if np.isfinite(frame_s) else None
    return VideoFacts((width, height), number, rate_hz, number / rate_hz if rate_hz else 0.0)


def size_of_side(left: Path, right: Path) -> tuple[int, int]:
    """(width, height) of the left camera's frames, pixels, of two videos, or one of both.

    Raises InputError, DeviceError.
    """
    image = video_file(left).read(0, gray)
    height, width = (half_of(image, SIDES[0], left) if left == right else image).shape
    return width, height


def frame_path(video: Path, number: int, side: str = "") -> Path:
    """The path of a frame, or of one half of it."""
    return video / side / f"{number:06d}.tif"


@dataclass(frozen=True)
class VideoImages(Container):
    """All frames of a video as contained files, by their names."""

    path: Path

    def read(self, name: str) -> bytes:
        """An uncompressed TIFF of 8 bits, or of 16 where the video has more than 8. Raises
        InputError, DeviceError.
        """
        side, _, file = name.rpartition("/")
        if not file.endswith(".tif") or not file[:-4].isdecimal() or (side and side not in SIDES):
            raise InputError(f"{self.path}: holds no image {name}")
        rgb = video_file(self.path).read(int(file[:-4]), pixels)
        return encode_tiff(half_of(rgb, side, self.path) if side else rgb)


def pixels(frame: Any) -> NDArray[Any]:
    """Convert a decoded frame (av.VideoFrame), upright, to (H, W, 3) RGB: uint8, or uint16 of full
    scale where it has more than 8 bits.
    """
    from av.video.reformatter import Interpolation

    exact = Interpolation.BILINEAR | Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INT
    deep = max(component.bits for component in frame.format.components) > 8
    rgb = frame.reformat(
        format="gbrp16le" if deep else "rgb24", interpolation=exact, threads=1
    ).to_ndarray()
    if deep:
        rgb = np.minimum(np.rint(rgb * np.float32(FULL_16)), 65535).astype(np.uint16)
    # as the file says that players are to turn it
    return np.ascontiguousarray(np.rot90(rgb, round(frame.rotation / 90)))
