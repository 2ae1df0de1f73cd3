"""Matched points of dives of drawn rigs, with faults that are known: of a rough bottom, without
images.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.rectification import plan_rectification, rectified_points
from calibration.refraction import CameraInWater, cameras_in_water
from calibration.rig import Camera, StereoRig
from calibration.verification.matches import Matches
from calibration.verification.rigid_motion import SeenTwice

Array = NDArray[np.float64]
SIZE = (960, 720)
FOCAL_PX = 800.0
BASELINE_M = 0.12
Fault = Callable[[int, str, Array], Array]
"""Pixels (n, 2) of a pair and a side, as the fault moves them."""


def rig() -> StereoRig:
    """Two cameras with lenses that bend, turned a little to each other."""
    left, right = (
        Camera(
            np.array([[FOCAL_PX, 0, 476.0 + 9 * side], [0, FOCAL_PX, 362.0 - 5 * side], [0, 0, 1]]),
            np.array([-0.12, 0.05, 0.0005, -0.0003, 0.0]),
            SIZE,
        )
        for side in (0, 1)
    )
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.004, -0.02, 0.006]))[0]
    T[:3, 3] = [-BASELINE_M, 0.001, 0.002]
    return StereoRig(left, right, T)


def turned(pitch: float = 0.0, yaw: float = 0.0, roll: float = 0.0) -> StereoRig:
    """The rig after a turn of its right camera, radians."""
    given, turn = rig(), np.eye(4)
    turn[:3, :3] = cv2.Rodrigues(np.array([pitch, yaw, roll]))[0]
    return replace(given, T_right_left=turn @ given.T_right_left)


def affine(
    right: bool = True, x_px: float = 0.0, y_px: float = 0.0, roll: float = 0.0, scale: float = 1.0
) -> Fault:
    """One side's images shifted, turned (radians) and enlarged about their middle."""
    middle = (np.array(SIZE) - 1) / 2

    def move(_: int, side: str, pixels: Array) -> Array:
        if (side == "right") != right:
            return pixels
        R = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
        return np.asarray(scale * (pixels - middle) @ R.T + middle + [x_px, y_px])

    return move


def both(across: float, down: float | None = None) -> Fault:
    """Both sides enlarged about their middle, alike in width and height unless told otherwise."""
    middle, scale = (np.array(SIZE) - 1) / 2, np.array([across, down or across])
    return lambda _, __, pixels: middle + scale * (pixels - middle)


def shutters(edge_px: float) -> Fault:
    """Columns of the right images moved in proportion to their rows, as by opposite shutters."""
    height = SIZE[1]
    return lambda _, side, pixels: (
        pixels + np.outer(2 * pixels[:, 1] / height - 1, [edge_px, 0]) * (side == "right")
    )


def from_pair(first: int, fault: Fault) -> Fault:
    """A fault from a pair on."""
    return lambda number, side, pixels: fault(number, side, pixels) if number >= first else pixels


def stabilized(size_px: float) -> Fault:
    """Right images moved and turned by other amounts in each pair."""

    def move(number: int, side: str, pixels: Array) -> Array:
        x_px, y_px, roll = np.random.default_rng(number).normal(0, size_px, 3)
        return affine(True, x_px, y_px, roll / 400)(number, side, pixels)

    return move


@dataclass(frozen=True, eq=False)
class DrawnDive:
    """matches: of each pair in the rectified images of the rig as calibrated. couples: of
    neighboring pairs. rig: as calibrated. range_error: of depths that the matches give, median,
    relative.
    """

    rig: StereoRig
    matches: list[Matches]
    couples: list[SeenTwice]
    range_error: float


def drawn_dive(
    *faults: Fault,
    pairs: int = 8,
    points: int = 400,
    relief_m: float = 0.35,
    noise_px: float = 0.1,
    true: StereoRig | None = None,
    given: StereoRig | None = None,
    seed: int = 1,
) -> DrawnDive:
    """A dive over a bottom 1.5 m below, by the rig ``true`` with faults, read with ``given``."""
    given = given or rig()
    true = true or given
    rng = np.random.default_rng(seed)
    plan = plan_rectification(given)
    geometry = plan.matching_pair
    seen: list[tuple[Array, Matches, NDArray[np.int64]]] = []
    errors: list[Array] = []
    bottom = np.column_stack(
        [
            rng.uniform([-1.3, -1.0], [1.3 + 0.25 * pairs, 1.0], (points * 5, 2)),
            1.5 + relief_m * rng.normal(0, 0.5, points * 5),
        ]
    )
    for number in range(pairs):
        turn = cv2.Rodrigues(rng.normal(0, 0.06, 3))[0]
        place = np.array([0.25 * number, rng.normal(0, 0.05), rng.normal(0, 0.08)])
        in_left = (bottom - place) @ turn.T
        pixels, visible = {}, np.ones(len(bottom), bool)
        # in water, from the centers of cameras behind a port
        left_camera, right_camera, T_right_left = cameras_in_water(true)
        for side, camera, T in (
            ("left", left_camera, np.eye(4)),
            ("right", right_camera, T_right_left),
        ):
            at = in_left @ T[:3, :3].T + T[:3, 3]
            there, inside = _projected(camera, at)
            for fault in faults:
                there = fault(number, side, there)
            pixels[side] = there + rng.normal(0, noise_px, there.shape)
            visible &= inside & ((there > 0) & (there < np.array(SIZE) - 1)).all(axis=1)
        chosen = np.flatnonzero(visible)[:points]
        left, right = rectified_points(given, pixels["left"][chosen], pixels["right"][chosen])
        depth_m = (in_left[chosen] @ plan.R_left_matching.T)[:, 2]
        disparity = left[:, 0] - right[:, 0] - (geometry.cx_left_px - geometry.cx_right_px)
        errors.append(geometry.focal_px * geometry.baseline_m / disparity / depth_m - 1)
        wrong = rng.random(len(chosen)) < 0.03
        right[wrong] += rng.normal(0, 25, (int(wrong.sum()), 2))
        seen.append((left, Matches(left, right), chosen))
    couples = [
        _couple(seen[i], seen[i + 1], geometry) for i in np.linspace(0, pairs - 2, 5).astype(int)
    ]
    matches = [one for _, one, _ in seen]
    return DrawnDive(given, matches, couples, float(np.median(np.concatenate(errors))))


def _projected(camera: Camera | CameraInWater, points: Array) -> tuple[Array, NDArray[np.bool_]]:
    slopes = np.abs(points[:, :2] / points[:, 2:])
    near = (points[:, 2] > 0.3) & (slopes < 1.0).all(axis=1)
    if isinstance(camera, CameraInWater):
        return camera.project_points(points + camera.center_m), near
    return camera.project(points), near


def _couple(
    first: tuple[Array, Matches, NDArray[np.int64]],
    second: tuple[Array, Matches, NDArray[np.int64]],
    geometry: RectifiedPair,
) -> SeenTwice:
    sides, rows = [], []
    _, here, there = np.intersect1d(first[2], second[2], return_indices=True)
    kept = np.ones(len(here), bool)
    for (_, matches, _), index in ((first, here), (second, there)):
        left, right = matches.left[index], matches.right[index]
        disparity = left[:, 0] - right[:, 0] - (geometry.cx_left_px - geometry.cx_right_px)
        kept &= (np.abs(left[:, 1] - right[:, 1]) < 5) & (disparity > 1)
        sides.append(np.column_stack([left - [geometry.cx_left_px, geometry.cy_px], disparity]))
        rows.append((right - left)[:, 1])
    return SeenTwice(sides[0][kept], sides[1][kept], np.column_stack(rows)[kept])
