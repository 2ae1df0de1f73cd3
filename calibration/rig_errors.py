"""Standard errors of a rig that its calibration file states."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RigErrors:
    """Standard errors, relative. focal: of the worse camera. baseline: of their distance. stated_by: what states them."""

    focal: float
    baseline: float
    stated_by: str

    @property
    def length(self) -> float:
        """The relative standard error of a length, which is baseline x focal length / disparity, or baseline x pixels /
        disparity.
        """
        return float(np.hypot(self.focal, self.baseline))
