"""Colors of pixels whose hue the camera clipped: those of their clipped neighbors.

Where one channel of a bright rock is clipped, the others still say that it is yellow; where all
are, or two and the third says no less than gray, the correction shows gray. On bright texture both
alternate from pixel to pixel. So the second kind takes the mean hue of the first kind around it;
gray where there is none. A channel that was not clipped stays.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.display import FULL_AT, FULL_FROM
from stereo_seecolor.color.render.lookup import Shown
from stereo_seecolor.records import Image

WIDTH, LEAST_PX = 0.012, 9
"""Width of the neighborhood, as a fraction of the image's, and in pixels at least."""
GRAY = 0.05
"""Fraction of a neighborhood with a hue below which gray prevails."""

NEARLY_GRAY = 0.04
"""Channels that differ by less, relatively, were made equal by the correction."""


def carry_hue(shown: Shown, image: Image) -> NDArray[Any]:
    """The corrected image, in which pixels of clipped hue have that of their clipped neighbors.

    shown: the correction. image: (H, W, 3), as the camera gave it.
    """
    at, top = np.flatnonzero(shown.unrecoverable), np.iinfo(image.dtype).max
    camera, colors = image.reshape(-1, 3)[at], shown.image.reshape(-1, 3)
    lost = (camera > FULL_FROM * top).sum(axis=1)
    clipped = camera.max(axis=1) >= FULL_AT * top
    most, least = colors[at].max(axis=1), colors[at].min(axis=1)
    no_hue = clipped & ((lost == 3) | ((lost == 2) & (least > (1 - NEARLY_GRAY) * most)))
    if not no_hue.any():
        return shown.image
    partly = at[clipped & ~no_hue]
    hue = np.zeros((image.shape[0] * image.shape[1], 4), np.float32)
    hue[partly, :3] = colors[partly] / np.maximum(colors[partly].max(axis=1, keepdims=True), 1)
    hue[partly, 3] = 1
    across = max(LEAST_PX, round(WIDTH * image.shape[1]))
    mean = cv2.blur(hue.reshape(*image.shape[:2], 4), (across, across)).reshape(-1, 4)[at[no_hue]]
    mixed = (mean[:, :3] + GRAY) / (mean[:, 3:] + GRAY)
    mixed /= mixed.max(axis=1, keepdims=True)
    one = np.arange(len(mixed)), camera[no_hue].argmin(axis=1)
    known = lost[no_hue] == 2  # its one channel stays
    level = np.where(known, colors[at[no_hue]][one] / mixed[one], most[no_hue])
    out = shown.image.copy()
    out.reshape(-1, 3)[at[no_hue]] = np.round(np.minimum(level[:, None] * mixed, top))
    return out
