"""Images that show both sides: left half and right half, or the left camera above the right one,
each as a file inside the image (``DIVE/0001.png/left/0001.tiff``).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.camera_images import decode_raw
from stereo_seecolor.files.contained import Container
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.inputs.capture import read_capture
from stereo_seecolor.inputs.listing import EXTENSIONS, Listing
from stereo_seecolor.inputs.pairing import (
    DivePairs,
    Pairing,
    in_dive_order,
    pair_of,
    with_unique_names,
)

SIDES = ("left", "right")
"""Of the halves: the left or upper one first, whichever camera it shows."""


def is_image_with_halves(path: Path) -> bool:
    """Tell whether a file may be an image of both sides."""
    return path.suffix.lower() in EXTENSIONS and path.is_file()


def is_half(path: Path) -> bool:
    """Tell whether ``half_path`` made a path."""
    return path.parent.name in SIDES and is_image_with_halves(path.parent.parent)


def half_path(image: Path, side: str) -> Path:
    """The path of one half of an image."""
    return image / side / f"{image.stem}.tiff"


def pair_halves(listing: Listing, right_half_first: bool) -> Pairing:
    """Each image's halves as a pair. right_half_first: left or upper is the right camera's."""
    first, second = SIDES[::-1] if right_half_first else SIDES
    pairs = [
        pair_of(image.stem, half_path(image, first), half_path(image, second))
        for image in listing.files
    ]
    cut = f"a wide one into {first} | {second}, a tall one into {first} above {second}"
    note = f"--left and --right are the same: each image is split in two, {cut}"
    return Pairing(
        DivePairs.of(in_dive_order(with_unique_names(pairs))), listing.unreadable, (note,)
    )


@dataclass(frozen=True)
class Halves(Container):
    """The two halves of one image."""

    image: Path

    def read(self, name: str) -> bytes:
        """A half as an uncompressed TIFF with the EXIF of the image; ``name`` begins with its side.
        Raises InputError.
        """
        content = read_bytes(self.image)
        if not content:
            raise InputError(
                f"{self.image}: is empty: copy it again from the vehicle, or leave it out"
            )
        pixels = decode_raw(content, self.image, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
        half = half_of(pixels, name.partition("/")[0], self.image)
        return encode_tiff(half if half.ndim == 2 else half[..., ::-1], read_capture(content).exif)


def half_of(pixels: NDArray[Any], side: str, path: Path) -> NDArray[Any]:
    """The left half of a wide image, (H, W) or (H, W, C), or the upper half of a high one, for
    "left"; else the other half.

    Raises InputError where the image, of the file ``path``, cannot be cut in two.
    """
    height, width = pixels.shape[:2]
    across = width >= height
    size = width if across else height
    if size % 2 or side not in SIDES:
        how = f"{size} px {'wide' if across else 'high'}, an odd number"
        raise InputError(
            f"{path}: is {how}: it does not show left and right in halves of equal size"
        )
    half = slice(None, size // 2) if side == SIDES[0] else slice(size // 2, None)
    return pixels[:, half] if across else pixels[half]
