"""Which side of a rig is less sharp, by the contrast of details in its images."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

BLURRED = 0.85
"""Of the sharper side's contrast of details: one with less is blurred, by 0.7 pixels or more. Sides
of a real rig and of synthetic ones, with veil or another tone curve on one, have 0.89 and more."""


class LessSharpSide(NamedTuple):
    """A side and its contrast, as a fraction of the other side's, at most 1."""

    side: Literal["left", "right"]
    contrast: float

    @classmethod
    def of(cls, right_sharpness: Iterable[float]) -> "LessSharpSide":
        """The one of a dive, from each frame's ``RangeMap.right_sharpness``; where none is known,
        both are equally sharp.
        """
        known = [one for one in right_sharpness if np.isfinite(one)]
        right = float(np.median(known)) if known else 1.0
        return cls("right", right) if right < 1 else cls("left", 1 / right)

    @property
    def is_blurred(self) -> bool:
        """True where it is too much for two sides in focus."""
        return self.contrast < BLURRED


EQUALLY_SHARP = LessSharpSide("left", 1.0)
