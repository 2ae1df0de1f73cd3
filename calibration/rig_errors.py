"""Standard errors of a rig that its file states, and the error of ranges that images show."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RangeError:
    """What the pairs of a dive show of the error of its ranges. error, std: of ranges at ``at_m``
    meters and its standard error, relative.
    """

    error: float
    std: float
    at_m: float

    @property
    def is_sure(self) -> bool:
        """True if it is larger than chance makes it."""
        return abs(self.error) > 2 * self.std

    @property
    def rms(self) -> float:
        """What ranges may be off by: error and standard error together."""
        return float(np.hypot(self.error, self.std))


@dataclass(frozen=True)
class RigErrors:
    """Standard errors, relative. focal: of the worse camera, and of its lens where that is less
    certain. baseline: of the cameras' distance. stated_by: the source, for messages.
    """

    focal: float
    baseline: float
    stated_by: str

    @property
    def length(self) -> float:
        """The relative standard error of a length, which is baseline x focal length / disparity, or
        baseline x pixels / disparity.
        """
        return float(np.hypot(self.focal, self.baseline))
