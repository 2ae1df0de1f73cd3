"""Removes a known water from an image: J = exposure (I - B(z)) / (A(z) white)."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.lookup import Shown
from stereo_seecolor.color.render.tone import FULL_AT, FULL_FROM, Tone, display, gains
from stereo_seecolor.color.table.moment_table import check_pair, range_bits
from stereo_seecolor.color.white_point import white_doubt
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Correction, Image, Map, Water

NOTHING_KNOWN = "no pixel with a known range: the picture is empty"
"""Warning of a frame without known ranges."""


def correct(
    image: Image, range_m: Map, water: Water, tone: Tone, config: ColorConfig
) -> Correction:
    """Correct an image. Unknown range is black, or raw by ``config.unknown_pixels``."""
    from stereo_seecolor.color.render import torch_apply  # loads torch, which --help does without

    check_pair(image, range_m)
    bits, shape = range_bits(range_m), image.shape[:2]
    flat: NDArray[Any] = np.ascontiguousarray(image).reshape(-1, 3)
    by_range = gains(water, config, tone.exposure)
    tables = display(8 * image.dtype.itemsize, config.encoding, tone.highlights)
    shown, clipped = torch_apply.on_processor(flat, bits, by_range, tables)
    whole = Shown(
        shown.image.reshape(image.shape),
        shown.unknown.reshape(shape),
        shown.unrecoverable.reshape(shape),
    )
    return corrected(image, whole, clipped, water, tone, config)


def corrected(
    image: Image, shown: Shown, clipped: float, water: Water, tone: Tone, config: ColorConfig
) -> Correction:
    """The correction of an image from its corrected pixels. clipped: fraction of them."""
    unknown = shown.unknown
    pixels = carry_hue(shown, image)
    if config.unknown_pixels == "raw":
        pixels[unknown] = image[unknown]
    return Correction(
        image=pixels,
        unknown=unknown,
        unrecoverable=shown.unrecoverable,
        clipped_fraction=clipped,
        water=water,
        exposure=tone.exposure,
        highlights=tone.highlights,
        warnings=tuple(
            filter(
                None, (*water.warnings, white_doubt(water), NOTHING_KNOWN if unknown.all() else "")
            )
        ),
    )


def correct_linear(
    image: Image, range_m: Map, water: Water, exposure: float, config: ColorConfig
) -> NDArray[np.float32]:
    """(H, W, 3) float32 linear J, unclipped, 1 = full scale; 0 where the range is unknown."""
    from stereo_seecolor.color.render import torch_apply

    check_pair(image, range_m)
    by_range, bits = gains(water, config, exposure), range_bits(range_m)
    flat: NDArray[Any] = np.ascontiguousarray(image).reshape(-1, 3)
    shown = display(8 * image.dtype.itemsize, config.encoding, 1.0)
    return torch_apply.linear(flat, bits, by_range, shown).reshape(image.shape)


# Colors of pixels whose hue the camera clipped: those of their clipped neighbors.
#
# Where one channel of a bright rock is clipped, the others still say that it is yellow; where all
# are, or two and the third says no less than gray, the correction shows gray. On bright texture
# both alternate from pixel to pixel. So the second kind takes the mean hue of the first kind around
# it; gray where there is none. A channel that was not clipped stays.

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
