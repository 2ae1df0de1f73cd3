"""Images of 16 bits that hold the values of a camera of fewer."""

import numpy as np

from stereo_seecolor.records import Image

BITS = (10, 12)


def unshifted_warning(image: Image, brightest: int) -> str:
    """Say that an image of uint16 looks as those of a camera of 10 or 12 bits do; "" where not.

    brightest: value of all images so far, since one may be dark. Of what the last four bits hold,
    shifted values and those that were scaled from fewer bits leave out most.
    """
    bits = next((bits for bits in BITS if brightest < 1 << bits), 16)
    if bits == 16 or len(np.unique(image[::4, ::4] & 15)) < 8:
        return ""
    return (
        f"values of 16 bits up to {brightest} only: if the camera has {bits} bits, multiply them "
        f"by {1 << 16 - bits} (of files: input.significant_bits={bits}); if the scene is so dark, "
        "set input.significant_bits=none"
    )
