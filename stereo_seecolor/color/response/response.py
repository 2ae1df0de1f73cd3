"""The relation of file values to light: encoding and pedestal of a camera, and their removal."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.response.noise import dark_value
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.files.color_spaces import SPACES, SpaceName, to_srgb
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Image

Encoding = Literal["srgb", "linear", "as-is"]
Rgb = tuple[float, float, float]

NONE: Rgb = (0.0, 0.0, 0.0)


def as_rgb(values: Sequence[float]) -> Rgb:
    """Convert three numbers to R, G, B."""
    red, green, blue = values
    return float(red), float(green), float(blue)


@dataclass(frozen=True)
class Response:
    """The response of a camera: ``value = encode(light + pedestal)``.

    The rest of the program reads light from values of one color space and encoding, sRGB, without a
    pedestal.

    Attributes:
        encoding: linear: values are proportional to light. srgb: they are encoded for a screen.
            as-is: values are used unchanged, as in the paper.
        pedestal: R, G, B without light, in linear light, fraction of full scale, 0 to 0.5.
        space: the color space of the values.
    """

    encoding: Encoding = "srgb"
    pedestal: Rgb = NONE
    space: SpaceName = "srgb"

    @classmethod
    def of(cls, config: ColorConfig) -> "Response":
        """Return the response of the settings; sRGB if it is to be measured."""
        space = "srgb" if config.encoding == "as-is" else config.space
        return cls(config.encoding, config.pedestal, space)

    @property
    def settings(self) -> dict[str, Any]:
        """Return the settings of ``ColorConfig`` for this response."""
        return {"input_encoding": self.encoding, "pedestal": self.pedestal}

    @property
    def is_identity(self) -> bool:
        """Whether images do not change."""
        return self.encoding != "linear" and not any(self.pedestal) and self.space == "srgb"

    def of_frame(self, image: Image) -> "Response":
        """The response of one frame, whose pedestal is at most its darkest light. image: (H, W, 3)
        RGB, uint8 or uint16, raw, since rectification adds black borders.
        """
        if not any(self.pedestal):
            return self
        full = np.iinfo(image.dtype).max
        darkest = np.array([dark_value(image[..., channel]) for channel in range(3)]) / full
        pedestal = np.minimum(self.pedestal, self.decode(darkest)).round(4)
        return replace(self, pedestal=as_rgb(pedestal.tolist()))

    def decode(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert values, fractions of full scale, to light; as-is: they are light."""
        return SPACES[self.space].decode(values) if self.encoding == "srgb" else values

    def standard(self, image: Image) -> Image:
        """An image (H, W, 3) RGB, uint8 or uint16, encoded by sRGB at the same bit depth, without
        its pedestal. Values at full scale stay there: clipped pixels are still recognized.
        """
        if self.is_identity:
            return image
        if self.space != "srgb":
            strips = range(0, len(image), STRIP_ROWS)
            return np.concatenate([self._converted(image[row:][:STRIP_ROWS]) for row in strips])
        return _looked_up(_table(self, 8 * image.dtype.itemsize), image)

    def _converted(self, image: Image) -> Image:
        """``standard`` of another color space; light that sRGB cannot hold is 0 or full scale."""
        full = np.iinfo(image.dtype).max
        table = _light(self, 8 * image.dtype.itemsize).astype(np.float32)
        mixed = cv2.transform(_looked_up(table, image), to_srgb(self.space))
        roots = cv2.sqrt(np.clip(mixed, 0, 1, out=mixed))
        shown = np.take(_of_roots(full), (roots * ROOTS + 0.5).astype(np.uint16))
        return np.where(image == full, image, shown)


STRIP_ROWS = 256
"""Rows that are converted at once: they take 40 bytes a pixel."""
ROOTS = 65535
"""Steps of the root of light, whose sRGB value changes by at most 1.5 of 65535 in one."""


@cache
def _of_roots(full: int) -> NDArray[Any]:
    """(ROOTS + 1,) sRGB value, 0 to full, of each root of light."""
    values = np.rint(encode_srgb((np.arange(ROOTS + 1) / ROOTS) ** 2) * full)
    return values.astype(np.uint8 if full == 255 else np.uint16)


def _looked_up(table: NDArray[Any], image: Image) -> NDArray[Any]:
    """(H, W, 3) what a table (V, 3) holds for each value of each channel."""
    if image.dtype == np.uint8:
        return np.asarray(cv2.LUT(image, table[None]), table.dtype)
    return np.stack([np.take(table[:, c], image[..., c]) for c in range(3)], axis=2)


def _light(response: Response, bit_depth: int) -> NDArray[np.float64]:
    """(V, 3) light of each value of R, G, B, without the pedestal."""
    full = 2**bit_depth - 1
    pedestal = np.array(response.pedestal)
    light = response.decode(np.arange(full + 1) / full)
    return np.asarray(np.clip((light[:, None] - pedestal) / (1 - pedestal), 0, 1))


@lru_cache(maxsize=8)
def _table(response: Response, bit_depth: int) -> NDArray[Any]:
    """(V, 3) sRGB value of each value of R, G, B."""
    full = 2**bit_depth - 1
    rest = _light(response, bit_depth)
    shown = rest if response.encoding == "as-is" else encode_srgb(rest)
    values_shown: NDArray[Any] = np.round(shown * full)
    return values_shown.astype(np.uint8 if bit_depth == 8 else np.uint16)


def standard_config(config: ColorConfig) -> ColorConfig:
    """Return the settings of the color stage for images that ``Response.standard`` has encoded."""
    encoding = config.input_encoding if config.input_encoding in ("as-is", "unknown") else "srgb"
    return config.model_copy(
        update={"input_encoding": encoding, "input_space": "srgb", "pedestal": NONE}
    )
