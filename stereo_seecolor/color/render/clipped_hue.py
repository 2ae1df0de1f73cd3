"""The hue of pixels that lost it by clipping: the mean of their bright neighbors with a hue.

If one channel of a bright rock is clipped, the others still show its hue, for example yellow. If
all are clipped, or two and the third is not below gray, the correction shows gray. On bright
texture both cases alternate from pixel to pixel, beside pixels that are nearly clipped. So pixels
of the second kind get the mean hue of the others around them, or gray if there are none. Channels
that were not clipped do not change.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.display import FULL_AT, FULL_FROM, brightest_channel
from stereo_seecolor.color.render.lookup import Shown
from stereo_seecolor.records import Image

WIDTH, LEAST_PX = 0.012, 9
"""Width of the neighborhood: fraction of the image width, and least pixels."""
NEARLY_FULL = 0.9
"""Least encoded value of the brightest channel of a pixel that was not clipped but has the hue of
its clipped neighbors, fraction of full scale.
"""
GRAY = 0.05
"""Least fraction of a neighborhood with a hue; below it, the pixel becomes gray."""

NEARLY_GRAY = 0.04
"""Relative difference of channels below which the correction made them equal."""


def carry_hue(shown: Shown, bright: Image) -> NDArray[Any]:
    """Give pixels without a hue that of their bright neighbors; return the corrected image. bright:
    (H, W, 3), values by which clipped pixels are known.
    """
    at, top = np.flatnonzero(shown.unrecoverable), np.iinfo(bright.dtype).max
    camera, colors = bright.reshape(-1, 3)[at], shown.image.reshape(-1, 3)
    lost = (camera > FULL_FROM * top).sum(axis=1)
    clipped = camera.max(axis=1) >= FULL_AT * top
    most, least = colors[at].max(axis=1), colors[at].min(axis=1)
    no_hue = clipped & ((lost == 3) | ((lost == 2) & (least > (1 - NEARLY_GRAY) * most)))
    if not no_hue.any():
        return shown.image
    brightest = brightest_channel(bright)
    nearly = (brightest >= NEARLY_FULL * top) & (brightest < FULL_FROM * top) & ~shown.unknown
    with_hue = np.append(at[clipped & ~no_hue], np.flatnonzero(nearly))
    hue = np.zeros((bright.shape[0] * bright.shape[1], 4), np.float32)
    hue[with_hue, :3] = colors[with_hue] / np.maximum(
        colors[with_hue].max(axis=1, keepdims=True), 1
    )
    hue[with_hue, 3] = 1
    across = max(LEAST_PX, round(WIDTH * bright.shape[1]))
    mean = cv2.blur(hue.reshape(*bright.shape[:2], 4), (across, across)).reshape(-1, 4)[at[no_hue]]
    mixed = (mean[:, :3] + GRAY) / (mean[:, 3:] + GRAY)
    mixed /= mixed.max(axis=1, keepdims=True)
    one = np.arange(len(mixed)), camera[no_hue].argmin(axis=1)
    known = lost[no_hue] == 2  # its one channel stays
    level = np.where(known, colors[at[no_hue]][one] / mixed[one], most[no_hue])
    out = shown.image.copy()
    out.reshape(-1, 3)[at[no_hue]] = np.round(np.minimum(level[:, None] * mixed, top))
    return out
