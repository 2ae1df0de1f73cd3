"""Divides an image by the light of a survey: values as under uniform light at usual exposure."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_model import SHAPE, FrameLight
from stereo_seecolor.color.render.display import FULL_AT, brightest_channel
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values, encode
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Image, Map

NODES = {8: 4096, 16: 65536}
"""Steps of the logarithm of light, by bit depth: half a step is below a quarter of a value."""
DARKEST = -12.0
"""Logarithm of the darkest light above black: 0.4 of the least linear value of 16 bits."""

MOST = SHAPE.most
"""``SHAPE.most`` as a number for compiled functions."""


def divide_illumination(
    image: Image, range_m: Map, light: FrameLight, encoding: InputEncoding
) -> Image:
    """Divide an image by the pattern of the light and by the gain and shading of the frame.

    Values above full scale are clipped. Values that the camera clipped are divided, too: only the
    image itself still shows which they are (``with_clipped``).

    Args:
        image: (H, W, 3) RGB, uint8 or uint16.
        range_m: (H, W) meters; unknown ranges use the pattern at the reference range.
        light: The light of the frame.
        encoding: Encoding of the values.

    Returns:
        The image under uniform light, at the same bit depth.
    """
    out = np.empty_like(image)
    log_range = light.light.log_range(range_m).astype(np.float32)
    scale = _scale(8 * image.dtype.itemsize, encoding)
    _even(
        np.ascontiguousarray(image),
        log_range,
        light.maps,
        light.log_gain.astype(np.float32),
        light.log_shading,
        scale,
        out,
    )
    return out


def with_clipped(divided: Image, image: Image) -> Image:
    """Give the pixels (H, W, 3) that the camera clipped at least their own values, of ``image``, so
    that statistics take them for lower bounds.
    """
    clipped = brightest_channel(image) >= FULL_AT * np.iinfo(image.dtype).max
    out = divided.copy()
    out[clipped] = np.maximum(divided[clipped], image[clipped])
    return out


@lru_cache
def _scale(
    bit_depth: int, encoding: InputEncoding
) -> tuple[NDArray[np.float32], NDArray[np.unsignedinteger]]:
    """Logarithm of the light of each value, and the value of each step of it, DARKEST to 0."""
    full = 2**bit_depth - 1
    light = decoded_values(bit_depth, encoding).astype(np.float64)
    log_light = np.log(np.maximum(light, np.exp(DARKEST))).astype(np.float32)
    steps = np.exp(np.linspace(DARKEST, 0, NODES[bit_depth]))
    steps[0] = 0
    values = np.round((encode(steps, "srgb") if encoding == "srgb" else steps) * full)
    return log_light, values.astype(np.uint8 if bit_depth == 8 else np.uint16)


@compiled
def _even(
    image: Any,
    log_range: Any,
    maps: Any,
    log_gain: Any,
    log_shading: Any,
    scale: Any,
    out: Any,
) -> None:
    """Divide pattern, gain and shading out, into ``out``."""
    (lights, values), most = scale, np.float32(MOST)
    last = values.size - 1
    step = np.float32(last / -DARKEST)
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            z = log_range[row, column]
            for c in range(3):
                pattern = np.float32(0)
                for k in range(maps.shape[3] - 1, -1, -1):
                    pattern = pattern * z + maps[row, column, c, k]
                pattern = min(max(pattern, -most), most)
                light = (
                    lights[image[row, column, c]]
                    - pattern
                    - log_gain[c]
                    - log_shading[row, column, c]
                )
                at = np.int64((light - np.float32(DARKEST)) * step + np.float32(0.5))
                out[row, column, c] = values[min(max(at, 0), last)]
