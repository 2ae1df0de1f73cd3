"""Frames too badly exposed for their colors: almost black, or clipped by the camera; and recorded
exposures that cannot be.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from stereo_seecolor.color.render.display import FULL_AT
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values
from stereo_seecolor.records import Capture, Image, Map

DARK = 0.005
"""Linear light of the brightest channel (16 of 255 in sRGB): noise is a tenth of it."""
DARK_FRACTION = 0.9
"""Fraction of pixels of known range that are darker: open water around a lit object is less."""
CLIPPED_FRACTION = 0.1
"""Fraction of these pixels that are clipped: highlights and white cards fill less."""
STEP_PX = 4
"""Only every fourth row and column is examined."""


def exposure_warnings(image: Image, range_m: Map, encoding: InputEncoding) -> tuple[str, ...]:
    """A warning for each fault of a frame's exposure, judged where its range is known; empty for a
    good exposure.

    image: (H, W, 3) uint8 or uint16. range_m: (H, W), NaN where unknown.
    """
    small = image[::STEP_PX, ::STEP_PX]
    brightest = reduce(np.maximum, np.moveaxis(small, 2, 0))[
        np.isfinite(range_m[::STEP_PX, ::STEP_PX])
    ]
    if not brightest.size:
        return ()
    light = decoded_values(8 * image.dtype.itemsize, encoding)
    if np.quantile(light[brightest], DARK_FRACTION) < DARK:
        return ("the frame is almost black: its colors are mostly noise",)
    clipped = float((brightest >= FULL_AT * np.iinfo(image.dtype).max).mean())
    if clipped > CLIPPED_FRACTION:
        return (
            (
                f"overexposed: {clipped:.0%} of the frame is clipped by the camera, and its color "
                "is beyond recovery"
            ),
        )
    return ()


def recorded_exposure_notes(
    captures: Sequence[Capture], timestamps_s: Sequence[float | None], has_table: bool
) -> tuple[str, ...]:
    """Lines for exposure times longer than the time between frames, and for a table of exposures
    that names few of the images.

    captures: of each pair, with its time. has_table: whether the user gave a table.
    """
    notes = []
    known = [one for one in captures if one.exposure_s is not None or one.gain is not None]
    if has_table and len(known) < len(captures):
        notes.append(
            f"input.exposures names the files of {len(known)} of {len(captures)} pairs: compare "
            "its names with those of the left images"
        )
    times_s = sorted(time_s for time_s in timestamps_s if time_s is not None)
    exposures_s = [one.exposure_s for one in captures if one.exposure_s is not None]
    if len(times_s) > 1 and exposures_s:
        interval_s, exposure_s = float(np.median(np.diff(times_s))), float(np.median(exposures_s))
        if exposure_s > interval_s > 0:
            notes.append(
                f"the recorded exposures, {exposure_s:.3g} s (median), are longer than the "
                f"{interval_s:.3g} s between frames: their unit is wrong (name the column "
                "exposure_ms or exposure_us), or they are reciprocals"
            )
    return tuple(notes)
