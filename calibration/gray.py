"""One gray image of eight bits, whatever the camera gave: for finding corners and features."""

import numpy as np
from numpy.typing import NDArray


def to_gray(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """(H, W) 8-bit of (H, W) or (H, W, C): the mean of the channels (underwater red may be empty), stretched to the full range."""
    gray = image.astype(np.float32)
    if gray.ndim == 3:
        gray = gray.mean(axis=2)
    low, high = np.percentile(gray[::4, ::4], (0.5, 99.5))
    return np.asarray(np.clip((gray - low) * (255 / max(high - low, 1.0)), 0, 255), dtype=np.uint8)
