"""Local contrast of an image, which falling-off or moving light hardly changes."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ContrastSettings:
    """The neighborhood of local contrast. Nothing depends on the position in the image: a grid of
    tiles would move with the camera.
    """

    # standard deviation of the window whose mean is taken off: light varies less than the bottom
    # there
    mean_px: float = 8.0
    spread_px: float = 16.0  # and of the window that contrast is measured in
    # contrast, natural logarithm, below which there is only noise: sensor noise of a dark 8-bit
    # image
    noise: float = 0.02
    gain: float = 40.0  # gray levels for a standard deviation: three fit into 8 bits
    # added before the logarithm, gray levels: rounding to 8 bits makes dark pixels noisy
    offset: float = 4.0
    # widths of the means that fill in what was painted black
    fill_px: tuple[int, ...] = (9, 33, 129, 513)
    fill_known: float = 0.02  # of such a window: fewer known pixels make no mean


SETTINGS = ContrastSettings()


def local_contrast(gray: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    """Compute the local contrast of a gray image (H, W), reduced by ``scale``: (h, w), the
    logarithm less its local mean, over its local spread, around 128.
    """
    filled = _filled(gray)
    if scale < 1:
        filled = cv2.resize(filled, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    logarithm = np.log(filled + np.float32(SETTINGS.offset))
    detail = logarithm - cv2.GaussianBlur(logarithm, (0, 0), SETTINGS.mean_px)
    spread = np.sqrt(cv2.GaussianBlur(detail * detail, (0, 0), SETTINGS.spread_px))
    return np.asarray(
        np.clip(128 + SETTINGS.gain * detail / (spread + SETTINGS.noise), 0, 255), np.uint8
    )


def _filled(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """What was black for want of a range filled in smoothly: its rim is not an edge."""
    known = (gray > 0).astype(np.float32)
    filled = gray.astype(np.float32)
    for width in SETTINGS.fill_px:
        if known.all():
            break
        share = cv2.blur(known, (width, width))
        mean = cv2.blur(filled * known, (width, width)) / np.maximum(share, 1e-6)
        filled = np.where((known == 0) & (share > SETTINGS.fill_known), mean, filled)
        known = np.where(share > SETTINGS.fill_known, np.float32(1), known)
    return filled
