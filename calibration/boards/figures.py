"""The figures of a fit that have standard errors: focal lengths, baseline, and ranges over the
image, where lenses are the less certain the fewer corners lay near.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.boards.bundle import (
    Array,
    Bundle,
    CornerObservation,
    equations_by_view,
    moved,
    rms,
)
from calibration.boards.lens import Size, to_camera
from calibration.errors import CalibrationError
from calibration.rectification import (
    plan_rectification,
    raw_points,
    rectified_slopes,
    rectifying_rotations,
)
from calibration.resampling import TINY
from calibration.rig import StereoRig

GRID = (8, 6)  # places of the rectified image


@dataclass(frozen=True, eq=False)
class RangePlaces:
    """Places of the image at which fits are compared. left, right: (n, 2) raw pixels that show one
    point each at the target's median distance; none of a rig that cannot be rectified.
    """

    image_size: Size
    left: Array
    right: Array

    @classmethod
    def of(cls, bundle: Bundle, image_size: Size) -> "RangePlaces":
        """All over the rectified image of a fit."""
        try:
            cameras = [to_camera(bundle.lens.model, one, image_size) for one in bundle.intrinsics]
            rig = StereoRig(cameras[0], cameras[1], bundle.T_right_left)
            pair = plan_rectification(rig).matching_pair
        except CalibrationError:
            return cls(image_size, np.zeros((0, 2)), np.zeros((0, 2)))
        across, down = (
            (np.arange(cells) + 0.5) / cells * pixels
            for cells, pixels in zip(GRID, pair.image_size, strict=True)
        )
        left = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
        depth_m = float(np.median(bundle.T_left_target[:, 2, 3]))
        right = left - [pair.focal_px * pair.baseline_m / depth_m, 0.0]
        sides = raw_points(rig, left, right)
        seen = np.all([(side >= 0) & (side < image_size) for side in sides], axis=(0, 2))
        return cls(image_size, sides[0][seen], sides[1][seen])

    def figures(self, bundle: Bundle) -> Array:
        """(3 + n,) focal length left and right (the mean of fx and fy), pixels, baseline, meters,
        and the reciprocal ranges that a fit gives these places, 1 / m; NaN of one that is no rig.
        """
        baseline_m = float(np.linalg.norm(bundle.T_right_left[:3, 3]))
        sides = zip(
            bundle.intrinsics,
            rectifying_rotations(bundle.T_right_left),
            (self.left, self.right),
            strict=True,
        )
        try:
            left, right = (
                rectified_slopes(to_camera(bundle.lens.model, one, self.image_size), R, pixels)
                for one, R, pixels in sides
            )
        except CalibrationError:
            left = right = np.full((len(self.left), 2), np.nan)
        along_ray = baseline_m * np.sqrt(1 + (left**2).sum(axis=1))
        focal_px = [intrinsics[:2].mean() for intrinsics in bundle.intrinsics]
        return np.array([*focal_px, baseline_m, *(left[:, 0] - right[:, 0]) / along_ray])

    def least_squares_std(self, bundle: Bundle, observations: Sequence[CornerObservation]) -> Array:
        """(3 + n,) standard errors of the figures if all corners err alone and alike: too small
        where they do not, but large where all views leave a parameter open, as each fit without
        some of them then stays where it began.
        """
        matrix = equations_by_view(bundle, observations)[0].sum(axis=0)
        used = np.diag(matrix) > 0
        scale = 1 / np.sqrt(np.diag(matrix)[used])
        values, vectors = np.linalg.eigh(matrix[np.ix_(used, used)] * scale[:, None] * scale)
        steps = np.zeros((len(values), len(matrix)))
        steps[:, used] = (scale[:, None] * vectors).T
        still = np.zeros((len(bundle.T_left_target), 6))
        at = self.figures(bundle)
        slopes = np.array([self.figures(moved(bundle, step, still)) - at for step in steps])
        noise_px = rms(bundle, observations) / np.sqrt(2)
        variances = (slopes**2 / np.maximum(values, TINY)[:, None]).sum(axis=0)
        return np.asarray(noise_px * np.sqrt(variances))
