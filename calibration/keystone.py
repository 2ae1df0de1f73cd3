"""The keystone in the vertical disparity, and the error of ranges if a yaw of the right camera since the calibration made it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.resampling import jackknife
from calibration.row_fit import robust_fit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KeystoneLimits:
    """Decides when a keystone is said.

    least_pairs: fewer give no standard error. most_groups: of pairs, left out in turn. most_matches: spread evenly; more cost time.
    lens_rad: yaw that errors of a usual lens model look like. A decentering p2 wrong by d bends rows as a yaw of 2 d does, and
    moves ranges hardly, since the calibration's own yaw makes up for it: 24 calibrations from 12 real views each (640x360 px, air)
    had keystones of 0.003 to 0.004 rad (by the model) on the other views, and ranges right to 0.2 %; a real rig of 1360x1024 px
    calibrated in water has 0.0018. deviations, range_error: a keystone is said where it is beyond both.
    most_yaw_rad: mounts give by tenths of a degree; more must leave less than ``clearly`` of what another lens distortion leaves.
    """

    least_pairs: int = 3
    most_groups: int = 10
    most_matches: int = 4000
    lens_rad: float = 0.0015
    deviations: float = 2.0
    range_error: float = 0.05
    most_yaw_rad: float = 0.008
    clearly: float = 0.7


LIMITS = KeystoneLimits()


@dataclass(frozen=True)
class Keystone:
    """yaw_rad: of the right camera, that looks like the rows do. std_rad: its standard error, with that of the lens model.

    range_error: of the ranges at the median disparity if the keystone is a yaw, relative; range_std: its standard error.
    unexplained_px: median vertical disparity that pitch, scale, roll and this yaw leave; bent_px: that they leave with another
    radial distortion of both lenses in the place of the yaw.
    """

    yaw_rad: float = 0.0
    std_rad: float = np.inf
    range_error: float = 0.0
    range_std: float = np.inf
    unexplained_px: float = np.inf
    bent_px: float = np.inf

    @property
    def is_possible(self) -> bool:
        """True if ranges would be wrong by more than matters, be it known well or not: it is then worth looking at more pairs."""
        return abs(self.range_error) > LIMITS.range_error

    @property
    def is_found(self) -> bool:
        """True if ranges may be wrong by more than the matches and a usual lens model leave open."""
        return self.is_possible and abs(self.range_error) > LIMITS.deviations * self.range_std

    @property
    def is_lens(self) -> bool:
        """True if the rows may as well come from another distortion of the lenses, which changes ranges by amounts not known."""
        unlikely = abs(self.yaw_rad) > LIMITS.most_yaw_rad and self.unexplained_px > LIMITS.clearly * self.bent_px
        return self.is_found and unlikely

    @property
    def line(self) -> str:
        """What it is and what to do."""
        yaw_deg, std_deg = np.degrees([self.yaw_rad, self.std_rad])
        if self.is_lens:
            return (
                f"another lens distortion explains the rows ({self.bent_px:.2f} px left) as well as a yaw of {yaw_deg:+.2f} "
                f"degrees ({self.unexplained_px:.2f} px): the calibration's may be missing, of the wrong sign or of another lens, "
                "and how wrong ranges are cannot be told: calibrate again"
            )
        return (
            f"a keystone in the rows, as after a yaw of {yaw_deg:+.2f} +- {std_deg:.2f} degrees of the right camera since: ranges "
            f"may be off by {100 * self.range_error:+.0f} +- {100 * self.range_std:.0f} %, by more if the principal point of a "
            "lens is wrong instead: calibrate again"
        )


NO_KEYSTONE = Keystone()


def find_keystone(left: Array, right: Array, pair: NDArray[np.int64], focal_px: float) -> Keystone:
    """From pixels (n, 2) of matches in the images that are matched, from their principal points; pair: (n,) the number of each's.

    A yaw moves rows by yaw x y / focal length (x, y from the principal point): by nothing on the axes, and by opposite amounts in
    neighboring corners, which offset, scale, roll and pitch do not.
    """
    step = -(-len(left) // LIMITS.most_matches)
    left, right, pair = left[::step], right[::step], pair[::step]
    x, y = right.T / focal_px
    moved, rows = np.column_stack([np.ones_like(x), y, x, y**2]), right[:, 1] - left[:, 1]
    terms = np.column_stack([moved, focal_px * x * y])
    coefficients, rest = robust_fit(terms, rows)
    _, rest_bent = robust_fit(np.column_stack([moved, _radial(right / focal_px) - _radial(left / focal_px)]), rows)
    yaw_rad, disparity = float(coefficients[4]), float(np.median(left[:, 0] - right[:, 0])) / focal_px
    if disparity <= 0:  # points behind infinity: swapped
        return NO_KEYSTONE
    std_rad = math.hypot(_std(terms, rows, pair), LIMITS.lens_rad)
    left_px = [float(np.median(np.abs(left_over))) for left_over in (rest, rest_bent)]
    return Keystone(yaw_rad, std_rad, yaw_rad / disparity, std_rad / disparity, *left_px)


def _radial(slopes: Array) -> Array:
    """(n,) how radial distortion moves the rows of rays with slopes (n, 2), but for its size."""
    return np.asarray(slopes[:, 1] * (slopes**2).sum(axis=1))


def _std(terms: Array, rows: Array, pair: NDArray[np.int64]) -> float:
    """Standard error of the yaw from fits without a part of the pairs each (grouped jackknife); infinite for too few pairs."""
    numbers, group = np.unique(pair, return_inverse=True)
    if numbers.size < LIMITS.least_pairs:
        return np.inf
    count = min(numbers.size, LIMITS.most_groups)
    fits = [robust_fit(terms[group % count != left_out], rows[group % count != left_out])[0] for left_out in range(count)]
    return float(jackknife(np.array(fits))[4])
