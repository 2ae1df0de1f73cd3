"""What an image file states about its values: linear light or encoded, and their color space."""

import struct
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image as Pillow
from PIL.ImageCms import ImageCmsProfile, PyCMSError

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.color_spaces import SpaceName, space_of
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.video_frames import is_video

Stated = Literal["linear", "encoded"]

LINEAR_GAMMA = 1.0
"""gAMA of a PNG that says that its values are linear light. Another value says nothing: ImageMagick
writes that of a screen into every file.
"""
EXIF_IFD, COLOR_SPACE, SRGB = 0x8769, 0xA001, 1
"""Tags of EXIF 2.3 by which a camera says that its image is encoded by sRGB,"""
INTEROPERABILITY_IFD, ADOBE_RGB = 0xA005, "R03"
"""or by Adobe RGB (DCF 2.0)."""
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
        exif = image.getexif()
        is_srgb = "srgb" in image.info or exif.get_ifd(EXIF_IFD).get(COLOR_SPACE) == SRGB
        if is_srgb or _is_adobe_rgb(exif):
            return "encoded"
    return None


def _is_adobe_rgb(exif: Pillow.Exif) -> bool:
    return exif.get_ifd(INTEROPERABILITY_IFD).get(1) == ADOBE_RGB


def stated_space(path: Path) -> tuple[SpaceName, str]:
    """Read the color space that a file states: a profile (ICC) or EXIF; srgb without a statement.

    Returns the space, and the name of a profile whose space is unknown, else "".
    """
    # and the errors of Pillow for what it does not read
    with (
        suppress(InputError, OSError, ValueError, SyntaxError, PyCMSError),
        Pillow.open(BytesIO(read_image_bytes(path))) as image,
    ):
        if content := image.info.get("icc_profile"):
            profile = ImageCmsProfile(BytesIO(content)).profile
            if profile.xcolor_space.strip() == "RGB" and len(image.getbands()) > 1:
                return _space_of(profile)
        elif _is_adobe_rgb(image.getexif()):
            return "adobe-rgb", ""
    return "srgb", ""


def _space_of(profile: Any) -> tuple[SpaceName, str]:
    colorants = (profile.red_colorant, profile.green_colorant, profile.blue_colorant)
    known = [colorant[0] for colorant in colorants if colorant]
    space = space_of(np.array(known).T) if len(known) == 3 else None
    return (space, "") if space else ("srgb", str(profile.profile_description).strip())


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
