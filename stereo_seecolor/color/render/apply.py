"""Removes a known water from an image: J = exposure (I - B(z)) / (A(z) white)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.clipped_hue import carry_hue
from stereo_seecolor.color.render.display import Tone, display
from stereo_seecolor.color.render.lookup import Shown
from stereo_seecolor.color.render.water_gains import gains
from stereo_seecolor.color.table.counting import check_pair
from stereo_seecolor.color.table.range_bins import range_bits
from stereo_seecolor.color.white_point import white_doubt
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Correction, Image, Map, Water

NOTHING_KNOWN = "no pixel with a known range: the image is empty"
"""Warning of a frame without known ranges."""


def correct(
    image: Image,
    range_m: Map,
    water: Water,
    tone: Tone,
    config: ColorConfig,
    camera: Image | None = None,
) -> Correction:
    """Correct an image at its size and bit depth.

    Args:
        image: (H, W, 3) RGB, uint8 or uint16.
        range_m: (H, W) float32, meters along the ray; unknown where not finite or not above 0.
        water: The water to remove.
        tone: Exposure and roll-off of highlights.
        config: Settings of the color stage; by ``config.unknown_pixels``, pixels of unknown range
            are black or raw.
        camera: (H, W, 3), the image before its light was divided out, which shows what the camera
            clipped; None = ``image``.

    Returns:
        The corrected frame.
    """
    from stereo_seecolor.color.render import torch_apply  # loads torch, which --help does without

    check_pair(image, range_m)
    bits, shape = range_bits(range_m), image.shape[:2]
    flat: NDArray[Any] = np.ascontiguousarray(image).reshape(-1, 3)
    bright = brighter(image, camera)
    by_range = gains(water, config, tone.exposure)
    tables = display(8 * image.dtype.itemsize, config.encoding, tone.highlights)
    shown, clipped = torch_apply.on_processor(flat, bits, by_range, tables, bright.reshape(-1, 3))
    whole = Shown(
        shown.image.reshape(image.shape),
        shown.unknown.reshape(shape),
        shown.unrecoverable.reshape(shape),
    )
    return corrected(image, bright, whole, clipped, water, tone, config)


def brighter(image: Image, camera: Image | None) -> Image:
    """The greater of the values of an image and of the camera, by which clipped ones are known."""
    return np.ascontiguousarray(image if camera is None else np.maximum(image, camera))


def corrected(
    image: Image,
    bright: Image,
    shown: Shown,
    clipped: float,
    water: Water,
    tone: Tone,
    config: ColorConfig,
) -> Correction:
    """The correction from its corrected pixels. bright: see ``brighter``. clipped: a fraction."""
    unknown = shown.unknown
    empty = NOTHING_KNOWN if unknown.all() else ""
    pixels = carry_hue(shown, bright)
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
        warnings=tuple(filter(None, (*water.warnings, white_doubt(water), empty))),
    )


def correct_linear(
    image: Image, range_m: Map, water: Water, exposure: float, config: ColorConfig
) -> NDArray[np.float32]:
    """Compute the corrected image J as linear light.

    Args:
        image: (H, W, 3) RGB, uint8 or uint16.
        range_m: (H, W) float32, meters along the ray; unknown where not finite or not above 0.
        water: The water to remove.
        exposure: Gain of all channels.
        config: Settings of the color stage.

    Returns:
        (H, W, 3) float32, unclipped, 1 = full scale; 0 where the range is unknown.
    """
    from stereo_seecolor.color.render import torch_apply

    check_pair(image, range_m)
    by_range, bits = gains(water, config, exposure), range_bits(range_m)
    flat: NDArray[Any] = np.ascontiguousarray(image).reshape(-1, 3)
    shown = display(8 * image.dtype.itemsize, config.encoding, 1.0)
    return torch_apply.linear(flat, bits, by_range, shown).reshape(image.shape)
