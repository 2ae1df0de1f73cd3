"""Pairs of a target of which one side lost images, so that images of different pairs meet."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.boards.bundle import Array, CornerObservation, Lens
from calibration.boards.lens import fit_camera, target_pose, to_camera
from calibration.boards.target_views import TargetView
from calibration.boards.targets import Target
from calibration.errors import CalibrationError
from calibration.rig import Camera
from calibration.transforms import inverse

MOST_STEPS = 5  # images that one side may have lost
# between two pairs' estimates of the rig; a board moves by more from view to view
SAME_TURN = np.radians(1.5)
SAME_PLACE = 0.1  # of the board's extent
LEAST_FITTING = 5  # pairs, and a third of all, that fit another partner before that is believed
LENS = Lens("pinhole", 5)


def refuse_out_of_step(views: Sequence[TargetView], target: Target) -> None:
    """Raise CalibrationError where most left images fit the right images of other pairs, with
    which, and from where on.

    By the rig between the cameras that each left image and each right image a few pairs before or
    after it would have: that of true partners is always the same.
    """
    cameras = [_camera(views, side, target) for side in (0, 1)]
    if cameras[0] is None or cameras[1] is None:
        return
    tried = [
        (number, step)
        for step in range(-MOST_STEPS, MOST_STEPS + 1)
        for number in range(len(views))
    ]
    rigs = {
        at: T
        for at in tried
        if (T := _rig_of_pair(views, *at, (cameras[0], cameras[1]), target)) is not None
    }
    if not rigs:
        return
    extent_m = float(np.ptp(target.points_m, axis=0).max())
    alike = _alike(np.array(list(rigs.values())), SAME_PLACE * extent_m)
    agreeing = [
        at for at, fits in zip(rigs, alike[alike.sum(axis=1).argmax()], strict=True) if fits
    ]
    fitting = {step: {number for number, of in agreeing if of == step} for _, step in agreeing}
    own = fitting.pop(0, set())
    found = {number: step for step, numbers in fitting.items() for number in numbers - own}
    if len(found) < max(LEAST_FITTING, len(views) / 3) or len(found) <= len(own):
        return
    steps = sorted([*found.items(), *((number, 0) for number in own)])
    changes = [
        (number, step)
        for (_, before), (number, step) in pairwise([(-1, 0), *steps])
        if step != before
    ]
    places = "; ".join(
        f"from {views[number].name} on {_partner(step)} fits" for number, step in changes[:4]
    )
    lost = "left" if changes[0][1] > 0 else "right"
    raise CalibrationError(
        f"left and right images are out of synchronization: {places}: the {lost} side lacks "
        "images: remove the images of the other side that have no partner"
    )


def _partner(step: int) -> str:
    if not step:
        return "its own right image"
    pairs = "pair" if abs(step) == 1 else "pairs"
    return f"the right image {abs(step)} {pairs} {'later' if step > 0 else 'earlier'}"


def _camera(views: Sequence[TargetView], side: int, target: Target) -> Camera | None:
    """One camera, fitted alone; None where too few views show the target."""
    seen = [found for view in views if (found := (view.left, view.right)[side]) is not None]
    if len(seen) < LEAST_FITTING:
        return None
    observations = [
        CornerObservation(number, 0, target.points_m[own.ids], own.pixels)
        for number, own in enumerate(seen)
    ]
    try:
        return to_camera(
            "pinhole",
            fit_camera(LENS, observations, views[0].image_size).intrinsics[0],
            views[0].image_size,
        )
    except CalibrationError:
        return None


def _rig_of_pair(
    views: Sequence[TargetView],
    number: int,
    step: int,
    cameras: tuple[Camera, Camera],
    target: Target,
) -> Array | None:
    """(4, 4) from left to right axes if left images and right ones ``step`` pairs later belong."""
    if not 0 <= number + step < len(views):
        return None
    left, right = views[number].left, views[number + step].right
    if left is None or right is None:
        return None
    sides = (cameras[0], left), (cameras[1], target.same_labels(left, right))
    poses = [
        target_pose(camera, CornerObservation(0, 0, target.points_m[own.ids], own.pixels))
        for camera, own in sides
    ]
    return poses[1] @ inverse(poses[0])


def _alike(rigs: Array, same_place_m: float) -> NDArray[np.bool_]:
    """(n, n) which of the rigs (n, 4, 4) are the same."""
    R, t = rigs[:, :3, :3].reshape(-1, 9), rigs[:, :3, 3]
    same_turn = np.cos(SAME_TURN) < (R @ R.T - 1) / 2
    return np.asarray(same_turn & (np.linalg.norm(t[:, None] - t, axis=2) < same_place_m))
