"""The shape of a target, from views of it: printed longer one way than the other, bent, or with
tags of another size beside their spaces than named.

All move all views alike, so that views left out of a fit do not show them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.aprilgrid import AprilGrid
from calibration.boards.bundle import Array, Bundle, CornerObservation, residuals, solve
from calibration.boards.targets import Target
from calibration.resampling import jackknife

STEP = 0.002  # of a shape's parameter, of the target's half extent: small, and far above rounding
ROUNDS = 3  # of Gauss-Newton: shapes are nearly linear in the corners
# what is named: above chance, and above what printers and glue leave, of the half extent
SURE, NOTICEABLE = 5.0, 0.002


@dataclass(frozen=True, eq=False)
class TargetShape:
    """parameters: (4,) how much longer the target is across than down, and the curvature across,
    diagonal and down, all of half its extent; (5,) of an AprilGrid, whose last is how much larger
    its tags are; std: their standard errors by views. fit: the bundle of this shape, to these
    observations. half_m: half of its extent.
    """

    parameters: Array
    std: Array
    fit: Bundle
    observations: list[CornerObservation]
    half_m: float
    target: Target

    @property
    def scale_error(self) -> float:
        """What lengths are off by, relative, as it is not known which one of those that contradict
        each other is right: across or down; tags, spaces or both together.
        """
        tags = 0.0
        if isinstance(self.target, AprilGrid):
            tags = self.parameters[4] * self.target.tag_m / self.target.space_m
        return float(np.hypot(self.parameters[0], tags)) / 2

    @property
    def text(self) -> str | None:
        """What is wrong with the target; None where nothing is sure."""
        found = []
        sure = (np.abs(self.parameters) > SURE * self.std) & (np.abs(self.parameters) > NOTICEABLE)
        if sure[1:4].any():
            worst = 1 + int(np.argmax(np.abs(self.parameters[1:4])))
            bent_mm, std_mm = 1000 * self.half_m * abs(self.parameters[worst]), self.std[worst]
            found.append(f"bent by {bent_mm:.1f} +- {1000 * self.half_m * std_mm:.1f} mm")
        if sure[0]:
            longer, other = ("across", "down")[:: 1 if self.parameters[0] > 0 else -1]
            found.append(f"{abs(self.parameters[0]):.1%} longer {longer} than {other}")
        if isinstance(self.target, AprilGrid) and sure[4]:
            tag_m, space_m = self.target.tag_m, self.target.space_m
            fitting_m = (tag_m + space_m) / (1 + self.parameters[4]) - tag_m
            found.append(
                f"of another space between tags: {1000 * fitting_m:.2f} mm beside tags of "
                f"{1000 * tag_m:g} mm, not {1000 * space_m:g} mm"
            )
        return f"the corners fit a target that is {' and '.join(found)}" if found else None


def target_shape(
    bundle: Bundle, observations: Sequence[CornerObservation], target: Target
) -> TargetShape:
    """The shape of least reprojection error, all else fitted anew."""
    low, high = target.points_m.min(axis=0), target.points_m.max(axis=0)
    middle, half_m = (low + high) / 2, float((high - low).max() / 2)

    def shaped(parameters: Array) -> list[CornerObservation]:
        return [
            replace(one, points_m=_deformed(one.points_m, parameters, middle, half_m, target))
            for one in observations
        ]

    count = 5 if isinstance(target, AprilGrid) else 4
    parameters, fit = np.zeros(count), bundle
    for _ in range(ROUNDS):
        fit = solve(fit, shaped(parameters))
        at = residuals(fit, shaped(parameters))
        columns = []
        for step in STEP * np.eye(count):
            moved = shaped(parameters + step)
            columns.append((residuals(solve(fit, moved), moved) - at) / STEP)
        jacobian = np.stack(columns, axis=-1)  # (n, 2, count)
        parameters = (
            parameters - np.linalg.lstsq(jacobian.reshape(-1, count), at.ravel(), rcond=None)[0]
        )
    fitted = shaped(parameters)
    fit = solve(fit, fitted)
    number = np.concatenate(
        [
            np.full(len(one.pixels), one.view)
            for side in (0, 1)
            for one in observations
            if one.side == side
        ]
    )
    without = [
        -np.linalg.lstsq(
            jacobian[number != view].reshape(-1, count), at[number != view].ravel(), rcond=None
        )[0]
        for view in range(len(bundle.T_left_target))
    ]
    return TargetShape(parameters, jackknife(np.array(without)), fit, fitted, half_m, target)


def _deformed(
    points_m: Array, parameters: Array, middle: Array, half_m: float, target: Target
) -> Array:
    stretch, across, diagonal, down = parameters[:4]
    if isinstance(target, AprilGrid):
        pitch_m = target.tag_m + target.space_m
        first = (points_m[:, :2] + target.space_m / 2) // pitch_m * pitch_m
        centers = np.column_stack([first + target.tag_m / 2, points_m[:, 2]])
        points_m = centers + (points_m - centers) * (1 + parameters[4])
    u, v = ((points_m - middle) / half_m)[:, :2].T
    moved = np.column_stack(
        [
            u * (1 + stretch / 2),
            v * (1 - stretch / 2),
            across * u**2 + diagonal * u * v + down * v**2,
        ]
    )
    return moved * half_m + middle
