"""Images of any output format as JPEG that every browser shows."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.decode import eight_bit


@dataclass(frozen=True)
class PreviewSize:
    """longer_px: longer side in pixels, at the most. quality: of the JPEG."""

    longer_px: int
    quality: int


THUMBNAIL = PreviewSize(192, 72)
"""96 CSS pixels wide on a screen of double density; about 4 kB: 5,000 of them are 20 MB."""
SCREEN = PreviewSize(1600, 85)
"""As wide as the viewer on a large screen, without blocks to be seen: the full image is a click away."""
LIVE = PreviewSize(480, 72)
"""Three beside each other on a laptop; about 30 kB."""


def preview(pixels: NDArray[Any], size: PreviewSize) -> bytes:
    """A JPEG of an image (H, W) or (H, W, 3) RGB; uint8, uint16, or float32 linear light."""
    height, width = pixels.shape[:2]
    scale = size.longer_px / max(height, width)
    if scale < 1:
        smaller = max(1, round(width * scale)), max(1, round(height * scale))
        pixels = np.asarray(cv2.resize(pixels, smaller, interpolation=cv2.INTER_AREA))
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(eight_bit(pixels), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, size.quality])
    return encoded.tobytes()
