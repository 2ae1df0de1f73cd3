"""How well a calibration knows its rig, where its own file says so."""

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
        """Of a length: range is focal length x baseline / disparity, and what lies across it is baseline x pixels / disparity."""
        return float(np.hypot(self.focal, self.baseline))
