"""Corrected images as any other program reads them: 8 bits a channel."""

import shutil
from pathlib import Path

import numpy as np

from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.run_folder.finished_run import FinishedFrame

READABLE = (".png", ".jpg")


def write_image(frame: FinishedFrame, folder: Path) -> str:
    """Put a frame's corrected image into ``folder``; its file name. 8-bit files are copied, others become 8-bit PNG.

    Raises InputError if the image is gone or damaged.
    """
    pixels = frame.read("corrected")
    source = frame.products["corrected"]
    if pixels.dtype == np.uint8 and source.suffix in READABLE:
        shutil.copyfile(source, folder / source.name)
        return source.name
    name = f"{frame.name}.png"
    (folder / name).write_bytes(encode_image(eight_bit(pixels), "png"))
    return name
