"""The lever arm between the camera and the point whose positions are given: it shows where the
camera turns.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.navigation.motions import (
    Motions,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeverSettings:
    """When a lever arm is used."""

    least_m: float = 0.1  # less is no more than navigation's noise
    sigmas: float = 6.0  # of its own standard error, in the direction that the turns show best
    # of the shifts' residuals, rms and median, it must leave at most this fraction: noise of
    # positions stays
    left: float = 0.5
    rounds: int = 5  # of weighting by the residuals
    floor_m: float = 0.002  # least standard error of a shift: what the pictures can tell
    # standard error before anything is measured: decides what the motion leaves open
    prior_m: float = 1.0


LEVER_SETTINGS = LeverSettings()


def lever_arm(motions: Motions) -> Array | None:
    """Estimate the vector from the camera to the point whose positions are given, (3,) in the
    camera's axes, meters; None where it is not significant.

    A point at l moves by t + (R - I) l where the camera moves by R, t.
    """
    off_m = motions.given[:, :3, 3] - motions.measured[:, :3, 3]
    turns = motions.measured[:, :3, :3] - np.eye(3)
    arm_m, covariance = np.zeros(3), np.eye(3)
    for _ in range(LEVER_SETTINGS.rounds):
        left_m = np.linalg.norm(off_m - turns @ arm_m, axis=1)
        # median of the length of a 3-D Gaussian
        sigma_m = max(LEVER_SETTINGS.floor_m, float(np.median(left_m)) / 1.54)
        weight = 1 / (sigma_m**2 * (1 + (left_m / (3 * sigma_m)) ** 2))
        covariance = np.linalg.inv(
            np.einsum("n,nki,nkj->ij", weight, turns, turns) + np.eye(3) / LEVER_SETTINGS.prior_m**2
        )
        arm_m = covariance @ np.einsum("n,nki,nk->i", weight, turns, off_m)
    before_m, after_m = np.linalg.norm(off_m, axis=1), np.linalg.norm(off_m - turns @ arm_m, axis=1)
    explains = np.median(after_m) < LEVER_SETTINGS.left * np.median(before_m)
    sure = (np.abs(arm_m) / np.sqrt(np.diag(covariance))).max() > LEVER_SETTINGS.sigmas
    return arm_m if explains and sure and np.linalg.norm(arm_m) > LEVER_SETTINGS.least_m else None
