"""What an image file states about its encoding: linear light, or encoded for a screen."""

import struct
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Literal

from PIL import Image as Pillow

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.video_frames import is_video

Stated = Literal["linear", "encoded"]

LINEAR_GAMMA = 1.0
"""gAMA of a PNG that says that its values are linear light. Another value says nothing: ImageMagick
writes that of a screen into every file.
"""
EXIF_IFD, COLOR_SPACE, SRGB = 0x8769, 0xA001, 1
"""Tags of EXIF 2.3 by which a camera says that its picture is encoded by sRGB."""
ICC_TAGS, ICC_CURVES = 128, (b"rTRC", b"kTRC")
"""Place of the table of tags of an ICC profile (ICC.1:2022, 7.3); curves of red and of gray."""


def stated_encoding(path: Path) -> Stated | None:
    """Read what a file states: a profile (ICC), gAMA of 1 or sRGB in a PNG, or EXIF.

    Frames of a video are encoded. Returns None without a statement, and for files that are damaged.
    """
    if any(map(is_video, path.parents)):
        return "encoded"
    # and the errors of Pillow for what it does not read
    with (
        suppress(InputError, OSError, ValueError, SyntaxError),
        Pillow.open(BytesIO(read_image_bytes(path))) as image,
    ):
        if image.info.get("gamma") == LINEAR_GAMMA:
            return "linear"
        if profile := image.info.get("icc_profile"):
            return profile_encoding(profile)
        if "srgb" in image.info or image.getexif().get_ifd(EXIF_IFD).get(COLOR_SPACE) == SRGB:
            return "encoded"
    return None


def profile_encoding(profile: bytes) -> Stated | None:
    """Read the tone curve of an ICC profile; None if it has none (tables, or damaged).

    A curve of no points is linear (ICC.1:2022, 10.6), and so is a power of 1 (10.18).
    """
    with suppress(struct.error):
        (tags,) = struct.unpack_from(">I", profile, ICC_TAGS)
        for number in range(min(tags, 100)):
            name, start = struct.unpack_from(">4sI", profile, ICC_TAGS + 4 + 12 * number)
            if name in ICC_CURVES:
                return _curve_encoding(profile, start)
    return None


def _curve_encoding(profile: bytes, start: int) -> Stated:
    kind, points, first = struct.unpack_from(">4s4xIH", profile, start)
    if kind == b"curv":
        return "linear" if points == 0 or (points == 1 and first == 0x0100) else "encoded"
    function, power = struct.unpack_from(">H2xi", profile, start + 8)
    return "linear" if function == 0 and power == 0x10000 else "encoded"
