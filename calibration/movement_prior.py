"""What is known of the parameters of a rig before rows are seen, and what is known with them."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from calibration.geometry import Array


@dataclass(frozen=True)
class MovementPrior:
    """Each parameter is as calibrated, or has moved since: normal with these standard deviations,
    pixels at the image's corner.
    """

    # of pitch, roll, scale and yaw: boards of ten views left 0.1 of pitch, which yaw is taken to
    # equal, and 0.2 of roll and of scale of a real rig. Pitch changes no range, and is what rows
    # show best: they alone decide on it
    calibrated_px: tuple[float, float, float, float] = (5.0, 0.3, 0.3, 0.1)
    moved_px: float = 5.0  # less than the 8 px of yaw that the motion of a dive shows by itself
    moved_fraction: float = 0.03  # of parameters: of nine rigs one has a parameter that moved


PRIOR = MovementPrior()


@dataclass(frozen=True, eq=False)
class Weighed:
    """Estimates weighed against the prior. gain: (4, 4), times the estimates (4,) gives the values;
    std: their standard errors (4,).
    """

    gain: Array
    std: Array

    @classmethod
    def of(cls, estimates: Array, errors: Array, unit: Array) -> "Weighed":
        """A mean over all sets of parameters that may have moved, each with the weight that the
        estimates (4,) give it.

        Where estimates are too uncertain to tell a set from another, the standard error holds the
        difference, so that no choice of one of them decides. errors: (4, 4), covariance of the
        estimates. unit: (4,), of a pixel.
        """
        weights, gains, covariances = [], [], []
        for moved in product((False, True), repeat=len(estimates)):
            std_px = np.where(moved, PRIOR.moved_px, PRIOR.calibrated_px)
            fraction = np.where(moved, PRIOR.moved_fraction, 1 - PRIOR.moved_fraction)
            prior = np.diag((std_px * unit) ** 2)
            total = prior + errors
            misfit = estimates @ np.linalg.solve(total, estimates)
            weights.append(np.log(fraction).sum() - (np.linalg.slogdet(total)[1] + misfit) / 2)
            gains.append(np.linalg.solve(total, prior).T)
            covariances.append(prior - gains[-1] @ prior)
        weight = np.exp(np.array(weights) - max(weights))
        weight /= weight.sum()
        gain = np.tensordot(weight, gains, 1)
        between = (np.array(gains) - gain) @ estimates
        variance = np.diagonal(covariances, axis1=1, axis2=2) + between**2
        return cls(gain, np.sqrt(weight @ variance))
