"""Corrected images as 8 bits a channel, which any program reads."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.run_folder.finished_run import FinishedFrame

READABLE = (".png", ".jpg")


def write_images(frames: Sequence[FinishedFrame], folder: Path) -> list[Path]:
    """Make ``folder/images``, and put the corrected image of each frame into it; the files, of 8
    bits as they are, else as PNG.

    Raises InputError if an image is gone or damaged.
    """
    (folder / "images").mkdir()
    return [_write_image(frame, folder / "images") for frame in frames]


def _write_image(frame: FinishedFrame, folder: Path) -> Path:
    pixels = frame.read("corrected")
    source = frame.products["corrected"]
    if pixels.dtype == np.uint8 and source.suffix in READABLE:
        return Path(shutil.copyfile(source, folder / source.name))
    path = folder / f"{frame.name}.png"
    path.write_bytes(encode_image(eight_bit(pixels), "png"))
    return path
