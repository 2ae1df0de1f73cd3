"""Taking a known water out of an image: J = exposure (I - B(z)) / (A(z) white), by look-up for 8 bits, computed for 16."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.encoding import decoded_values, encoding_curve
from stereo_seecolor.color.gains import gains
from stereo_seecolor.color.tables import MomentTable, range_bits
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.data import Correction, Image, Map, Water


def correct(
    image: Image, range_m: Map, water: Water, table: MomentTable, config: ColorConfig, exposure: float | None = None
) -> Correction:
    """The image without its water, at its own size and bit depth; black where the range is unknown, unless the config says else."""
    from stereo_seecolor.color import kernels

    bits, flat = range_bits(image, range_m), np.ascontiguousarray(image).reshape(-1)
    by_level = gains(table, water, config, exposure)
    depth, encoding = table.bit_depth, config.input_encoding
    out, unknown, beyond, clipped = kernels.apply(
        flat, bits, by_level, decoded_values(depth, encoding), encoding_curve(depth, encoding)
    )
    shape = image.shape[:2]
    corrected, unknown = out.reshape(image.shape), unknown.reshape(shape)
    if config.unknown_pixels == "raw":
        corrected[unknown] = image[unknown]
    return Correction(
        image=corrected,
        unknown=unknown,
        unrecoverable=beyond.reshape(shape),
        clipped_share=clipped / max(unknown.size - int(np.count_nonzero(unknown)), 1),
        water=water,
        exposure=by_level.exposure,
        warnings=water.warnings,
    )


def correct_linear(
    image: Image, range_m: Map, water: Water, table: MomentTable, config: ColorConfig, exposure: float = 1.0
) -> NDArray[np.float32]:
    """(H, W, 3) float32 linear J, unclipped, 1 = full scale; 0 where the range is unknown."""
    from stereo_seecolor.color import kernels

    by_level = gains(table, water, config, exposure)
    flat: NDArray[Any] = np.ascontiguousarray(image).reshape(-1)
    decoded = decoded_values(table.bit_depth, config.input_encoding)
    return kernels.linear(flat, range_bits(image, range_m), by_level, decoded).reshape(image.shape)
