"""Deep images that are read as encoded for a screen, and look as if they held linear light, as raw converters write it."""

from collections.abc import Sequence

import numpy as np

from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.headers import is_finished_color
from stereo_seecolor.inputs.images import decode_image, read_image_bytes
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Image

DARK_MEDIAN = 0.2
"""Median of the brightest channel over its brightest thousandth. Encoded: 0.29 to 0.59 in frames of a real reef, a Sea-thru scene
and drawn dives by day and night; the same as linear light 0.07 to 0.31.
"""


def encoding_notes(config: RunConfig, pairs: Sequence[Pair]) -> tuple[str, ...]:
    """What the first image says against ``color.input_encoding: srgb``; nothing where it has 8 bits, or cannot be read."""
    if config.color.input_encoding != "srgb" or not pairs:
        return ()
    path = pairs[0].left
    try:
        content = read_image_bytes(path)
        linear = not is_finished_color(content) and looks_linear(decode_image(content, path, config.input))
    except InputError:  # the run names it
        return ()
    doubt = f"color: {path.name} is dark for an image encoded for a screen, as which it is read"
    return (f"{doubt}: if it holds linear light, as from a raw converter: --set color.input_encoding=linear",) if linear else ()


def looks_linear(image: Image) -> bool:
    """True for an image of more than 8 bits whose middle is dark against its brightest."""
    brightest = image[::4, ::4].max(axis=2)
    median, full = np.quantile(brightest, (0.5, 0.999))
    return bool(image.dtype == np.uint16 and median < DARK_MEDIAN * full)
