"""Pairs of images of a target, and the corners found in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.aprilgrid import MIN_CORNERS, Corners
from calibration.boards.bundle import CornerObservation
from calibration.boards.report import ViewReport
from calibration.boards.targets import Target
from calibration.errors import CalibrationError
from calibration.gray import to_gray

Size = tuple[int, int]
MIN_VIEWS = 3  # fewer do not determine a camera (Zhang 2000)
SIDES = ("left", "right")


@dataclass(frozen=True, eq=False)
class TargetView:
    """A pair's corners. image_size: (width, height); left, right: None if not found."""

    name: str
    image_size: Size
    left: Corners | None
    right: Corners | None


def detect_view(
    name: str, left: NDArray[np.generic], right: NDArray[np.generic], target: Target
) -> TargetView:
    """Find the target in a pair of images, (H, W) or (H, W, 3), 8 or 16 bit. Raises
    CalibrationError if they differ in size.
    """
    if left.shape[:2] != right.shape[:2]:
        raise CalibrationError(
            f"{name}: left is {left.shape[1]}x{left.shape[0]} px and right is "
            f"{right.shape[1]}x{right.shape[0]}"
        )
    corners = [target.detect(to_gray(image)) for image in (left, right)]
    if corners[0] is not None and corners[1] is not None:
        corners[1] = target.same_labels(corners[0], corners[1])
    return TargetView(name, (left.shape[1], left.shape[0]), corners[0], corners[1])


def usable_views(views: Sequence[TargetView]) -> tuple[list[TargetView], list[ViewReport]]:
    """Views with enough corners in both images, all of one size; and the others, with the reason.

    Raises CalibrationError if fewer than three are usable.
    """
    usable: list[TargetView] = []
    dropped: list[ViewReport] = []
    sizes = [view.image_size for view in views]
    common = max(set(sizes), key=sizes.count) if sizes else (0, 0)
    for view in views:
        missing = [
            side
            for side, corners in zip(SIDES, (view.left, view.right), strict=True)
            if corners is None
        ]
        if view.image_size != common:
            reason = f"image of {view.image_size}, the others are {common}"
        elif missing:
            reason = f"target not found in the {' and the '.join(missing)} image"
        elif (count := common_ids(view).size) < MIN_CORNERS:
            reason = f"only {count} corners in common, {MIN_CORNERS} needed"
        else:
            usable.append(view)
            continue
        dropped.append(ViewReport(view.name, reason=reason))
    if len(usable) < MIN_VIEWS:
        first = f": {dropped[0].name}: {dropped[0].reason}" if dropped else ""
        raise CalibrationError(
            f"the target was found in both images of {len(usable)} of {len(views)} pairs, at "
            f"least {MIN_VIEWS} are needed "
            f"(15 make a good calibration); check the target's numbers{first}"
        )
    return usable, dropped


def common_ids(view: TargetView) -> NDArray[np.int64]:
    """List the numbers of the corners seen in both images, sorted."""
    assert view.left is not None and view.right is not None
    return np.intersect1d(view.left.ids, view.right.ids)


def observations_of(views: Sequence[TargetView], target: Target) -> list[CornerObservation]:
    """Collect all corners of usable views, numbered by view."""
    observations = []
    for number, view in enumerate(views):
        for side, corners in enumerate((view.left, view.right)):
            assert corners is not None
            observations.append(
                CornerObservation(number, side, target.points_m[corners.ids], corners.pixels)
            )
    return observations
