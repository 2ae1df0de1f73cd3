"""A check for one side that is out of focus or dirty."""

from collections.abc import Mapping, Sequence

import numpy as np

from stereo_seecolor.sharpness import LessSharpSide

CONTRASTS, BLURS_PX = (0.37, 0.53, 0.8, 1.0), (3.0, 2.0, 1.0, 0.0)
"""Contrast that is left of synthetic reefs by a Gaussian blur of so many pixels."""


def blurred_side_notes(facts: Sequence[Mapping[str, float]]) -> tuple[str, ...]:
    """A note where one side of a dive is less sharp than the other. facts: of each pair
    (``dive.frame_facts.range_facts``).
    """
    found = LessSharpSide.of(one.get("right_sharpness", np.nan) for one in facts)
    if not found.is_blurred:
        return ()
    other = "left" if found.side == "right" else "right"
    blur_px = float(np.interp(found.contrast, CONTRASTS, BLURS_PX))
    return (
        f"input: the {found.side} images are less sharp than the {other} ones, as by a blur of "
        f"about {blur_px:.1f} px (details have {found.contrast:.0%} of the contrast): ranges have "
        "less relief, so that a track without positions may come out up to 1 % too long, and "
        "neighboring pairs may seem to contradict the calibration: clean the port of this camera "
        "and set its focus",
    )
