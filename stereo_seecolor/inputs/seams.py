"""Damage that decoders accept: pixels in the order of the file from some place on that do not
continue those above.

A changed byte of a JPEG shifts the brightness of all blocks after it, or their places; in
uncompressed files a part may be missing or of another file. OpenCV decodes both, and says nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.image_headers import (
    BMP_SIGNATURE,
    JPEG_SIGNATURE,
    PNG_SIGNATURE,
    jpeg_quantization,
)
from stereo_seecolor.records import Image


@dataclass(frozen=True)
class SeamSettings:
    """What is a seam, by the difference between neighboring rows in each part of the width, over
    that of rows near by.

    step: over the larger of the differences two rows above and below. 290 real images under water:
    at most 1.02; two in air 1.04, of a board 1.33. one_side: over the smaller one, where noise
    follows. Under water at most 1.3; in air 1.8, of a board 2.2; noise 4.3. most: of a difference
    that counts, of 255. floor: added to differences. parts: of the width. every: column compared.
    rounding: a JPEG's mean of a block is off by up to so much of its step of quantization, 8 times
    as large; added to the floor. At quality 20 to 90 real images have at most 1.23 of step.
    """

    step: float = 1.35
    one_side: float = 2.5
    most: int = 40
    floor: float = 1.0
    parts: int = 4
    every: int = 4
    rounding: float = 1 / 16


SETTINGS = SeamSettings()
BLOCKS = (8, 16)
"""Rows of the blocks of a JPEG, without and with color at half resolution."""
ONE_COLOR = 12
"""Of 255: values of a bar of one color, as a JPEG leaves them beside a picture."""
EDGE = 1
"""Demosaicing repeats so many rows at the upper and lower edge: no difference to compare with."""
OFF = 2
"""Rows between compared ones: a seam within a row lies between two pairs of rows."""


def seam_row(image: Image, content: bytes) -> int | None:
    """The row at which ``image``, as decoded from ``content``, begins anew; None where it does not,
    and for PNG with its checksums.

    A seam runs in the order in which the file stores pixels: on the right from one row on, on the
    left from the next one on. The edge of a bar of one color that goes across the image is none.
    """
    if content.startswith(PNG_SIGNATURE):
        return None
    rows_up = content.startswith(BMP_SIGNATURE)
    green = image[:: -1 if rows_up else 1, :: SETTINGS.every, 1]
    values = (green >> 8 if green.dtype == np.uint16 else green).astype(np.int16)
    is_jpeg = content.startswith(JPEG_SIGNATURE)
    quantization = jpeg_quantization(content)
    rounded = SETTINGS.rounding * quantization[0] if quantization else 0.0
    steps = _steps(values, SETTINGS.floor + rounded)
    if steps.shape[1] <= BLOCKS[-1]:
        return None
    found, row = max(
        _seam(steps, later, 8 if is_jpeg else 1) for later in (BLOCKS if is_jpeg else (1,))
    )
    if found < 1 or _is_edge_of_bar(values[row - 1], values[row]):
        return None
    return len(values) - row if rows_up else row


def _is_edge_of_bar(above: NDArray[np.generic], below: NDArray[np.generic]) -> bool:
    """True where one of two rows has one color, and the other, as pictures do, does not end or
    begin with that color.
    """
    few = max(len(above) // 50, 1)
    return any(
        np.ptp(bar) <= ONE_COLOR and (abs(other - bar[0]) > ONE_COLOR).any()
        for bar, other in ((below, above[-few:]), (above, below[:few]))
    )


def seam_text(row: int) -> str:
    """What to say of an image that begins anew at ``row``."""
    return (
        f"is damaged: the image below row {row} does not continue the image above: copy it again "
        "from the vehicle, or leave it out"
    )


def _steps(values: NDArray[np.int16], floor: float) -> NDArray[np.float64]:
    """(parts, H) how much each row differs from the one above, over how much a seam does; 0 at the
    margins. floor: added to differences.
    """
    width = values.shape[1] // SETTINGS.parts * SETTINGS.parts
    differences = np.minimum(np.abs(np.diff(values[:, :width], axis=0)), SETTINGS.most)
    mean = differences.reshape(len(differences), SETTINGS.parts, -1).mean(axis=2).T
    above, below = mean[:, : -2 * OFF] + floor, mean[:, 2 * OFF :] + floor
    least = np.minimum(
        SETTINGS.step * np.maximum(above, below), SETTINGS.one_side * np.minimum(above, below)
    )
    steps = np.pad(mean[:, OFF:-OFF] / least, ((0, 0), (OFF + 1, OFF)))
    steps[:, : OFF + EDGE + 1] = steps[:, -OFF - EDGE :] = 0
    return steps


def _seam(steps: NDArray[np.float64], later: int, every: int) -> tuple[float, int]:
    """The clearest seam and its row: right parts at this row, the left ones ``later`` rows down.
    every: rows where one can be.
    """
    # the least step of each part and those right of it
    here = np.minimum.accumulate(steps[::-1], axis=0)[::-1]
    below = np.minimum.accumulate(steps, axis=0)
    below = np.pad(below[:, later:], ((1, 0), (0, later)), constant_values=0)
    below[0] = np.inf  # no part is left of the first
    seams = np.minimum(here, below[:-1]).max(axis=0)
    seams[np.arange(len(seams)) % every != 0] = 0
    if every == 1:
        seams /= _of_blocks(seams)
    row = int(seams.argmax())
    return float(seams[row]), row


def _of_blocks(seams: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H,) how much more rows differ at one place in blocks of 8 rows than elsewhere, at least 1:
    codecs of videos leave such steps, and so do JPEG files that were stored in another format.
    """
    usual = float(np.median(seams[seams > 0])) if seams.any() else 0.0
    medians = [float(np.median(seams[place :: BLOCKS[0]])) for place in range(BLOCKS[0])]
    return np.resize([max(1.0, median / usual) if usual else 1.0 for median in medians], len(seams))
