"""The camera's sensor: from light to electrons to digital values."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Image


def expose(
    light: NDArray[np.float32],
    full_well_e: float,
    read_noise_e: float,
    bits: int,
    rng: np.random.Generator,
) -> Image:
    """Linear light (H, W, 3), 1 = full scale, to an image: shot and read noise, clipping, then
    8-bit sRGB or 16-bit linear.
    """
    seen = light.astype(np.float32, copy=True)
    spread = np.sqrt(
        np.maximum(seen, 0) / np.float32(full_well_e)
        + np.float32((read_noise_e / full_well_e) ** 2)
    )
    seen += spread * rng.standard_normal(seen.shape, dtype=np.float32)
    seen = np.clip(seen, 0.0, 1.0)
    if bits == 16:
        return np.round(seen * 65535.0).astype(np.uint16)
    return np.round(encode_srgb(seen) * 255.0).astype(np.uint8)
