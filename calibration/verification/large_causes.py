"""Causes that may be large, tried over a grid of factors.

Both of them (``table``) lengthen the focal length and bend rays less toward the corners. The former
alone looks like a camera that has moved, so each factor is judged after the offset, scale and roll
that suit it best: the lens's distortion is the evidence, and without any there is none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.rectification import plan_rectification, raw_points
from calibration.rig import StereoRig
from calibration.verification.row_fits import explain
from calibration.verification.table import LargeCause

Array = NDArray[np.float64]
MOST_MATCHES = 2000  # spread evenly: more cost time, and tell the same


@dataclass(frozen=True)
class BestFactor:
    """The factor, 1 = none, that explains rows best beside a movement of a camera; and what both
    leave, pixels, median.
    """

    factor: float = 1.0
    unexplained_px: float = np.inf


NOT_TRIED = BestFactor()


def best_factor(cause: LargeCause, rig: StereoRig, left: Array, right: Array) -> BestFactor:
    """Find the factor that explains matches (n, 2) in the images that are matched."""
    step = -(-len(left) // MOST_MATCHES)
    plan = plan_rectification(rig)
    turns = plan.R_left_matching, plan.R_right_matching
    raw = raw_points(rig, left[::step], right[::step])

    def unexplained_px(factor: float) -> float:
        at_left, at_right = (
            plan.matching_pair.focal_px * factor * turned[:, :2] / turned[:, 2:]
            for turned in (
                cause.rays(camera, pixels, factor) @ R.T
                for camera, R, pixels in zip((rig.left, rig.right), turns, raw, strict=True)
            )
        )
        seen = np.isfinite(at_left).all(axis=1) & np.isfinite(at_right).all(axis=1)
        if not seen.any():
            return float(np.inf)
        _, rest = explain(at_right[seen, 1] - at_left[seen, 1], at_left[seen])
        return float(np.median(np.abs(rest)))

    left_px, factor = min((unexplained_px(factor), factor) for factor in map(float, cause.factors))
    return BestFactor(factor, left_px)
