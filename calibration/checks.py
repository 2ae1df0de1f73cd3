"""Checks of a calibration against images of a dive: what is wrong, with the evidence in numbers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError, counted
from calibration.field_checks.enlargement import NOT_ENLARGED, best_enlargement
from calibration.field_checks.matches import (
    Matches,
    explain,
    find_keystone,
    find_matches,
    row_inliers,
)
from calibration.field_checks.vertical_disparity import BEHIND_PX, LIMITS, MIN_MATCHES, RowCheck
from calibration.geometry import RectifiedPair
from calibration.port import FLAT_PORT
from calibration.rectification import (
    DIAGONAL_DEG,
    Rectification,
    plan_rectification,
    raw_points,
    rectified_points,
)
from calibration.refraction import CameraInWater, cameras_in_water
from calibration.rig import Camera, StereoRig, quarter_turn, quarter_turns_of

# Warnings about a rig that is usable but looks wrong, found in its numbers alone, without images.


@dataclass(frozen=True)
class SuspicionLimits:
    """Decides what is unusual in a rig, though possible."""

    # of the image: no lens is mounted that far off; K of half the resolution gives 0.25
    center_offset: float = 0.2
    # fx / fy off 1: sensors have square pixels, and ports stretch them by 1 or 2 %
    aspect: float = 0.05
    focal_of_width: tuple[float, float] = (0.2, 10.0)  # 136 degrees across, and 6
    focal_ratio: tuple[float, float] = (0.8, 1.25)  # left to right: pairs are made of equal lenses
    angle_deg: float = 30.0  # between the cameras, quarter turns apart: pairs look the same way
    kept_pinhole: float = 0.4  # of the view after rectification
    kept_fisheye: float = 0.1  # a flat image shows the middle of a fisheye alone
    rms_px: float = 1.0  # a calibration is good to 0.3 px


SUSPICION_LIMITS = SuspicionLimits()


def suspicions(rig: StereoRig) -> tuple[str, ...]:
    """List what looks wrong in a usable rig, one line each; empty where nothing does."""
    found = list(rig.doubts)
    if rig.alternatives:
        found.append(
            f"{rig.reading}: the file can be read in {len(rig.alternatives) + 1} ways, and images "
            "of the dive must decide"
        )
    found += [
        text
        for side, camera in (("left", rig.left), ("right", rig.right))
        for text in _camera_suspicions(side, camera)
    ]
    focal_ratio = rig.left.K[0, 0] / rig.right.K[0, 0]
    if not SUSPICION_LIMITS.focal_ratio[0] < focal_ratio < SUSPICION_LIMITS.focal_ratio[1]:
        found.append(
            f"the focal lengths differ: {rig.left.K[0, 0]:.0f} px left and "
            f"{rig.right.K[0, 0]:.0f} px right"
        )
    # scipy would take 0.3 s to load
    turned = cv2.Rodrigues(quarter_turn(-quarter_turns_of(rig.R)) @ rig.R)[0]
    angle_deg = np.degrees(np.linalg.norm(turned))
    if angle_deg > SUSPICION_LIMITS.angle_deg:
        found.append(
            f"the cameras are turned by {angle_deg:.0f} degrees to each other: is the rotation of "
            "this rig?"
        )
    found += placement_suspicions(rig)
    kept = min(kept_fractions(rig))
    if kept < (
        SUSPICION_LIMITS.kept_fisheye
        if rig.left.model == "fisheye"
        else SUSPICION_LIMITS.kept_pinhole
    ):
        found.append(
            f"rectified images keep {kept:.0%} of what the cameras see: check rotation, focal "
            "lengths and distortion"
        )
    if not (rig.left.distortion.any() or rig.right.distortion.any() or rig.is_rectified):
        found.append(
            "no lens distortion in the calibration, though its cameras are not rectified: was it "
            "left out of the file?"
        )
    if rig.rms_px is not None and rig.rms_px > SUSPICION_LIMITS.rms_px:
        found.append(
            f"the calibration's own error is {rig.rms_px:.2f} px, over "
            f"{SUSPICION_LIMITS.rms_px:g} px: calibrate again"
        )
    if rig.medium == "air" and rig.port is None and not rig.is_rectified:
        found.append(
            "calibrated in air: behind a flat port under water, ranges come out about a quarter "
            f"wrong; calibrate in water, or describe the port: --set input.flat_port={FLAT_PORT} "
            "(lens to window, and its thickness)"
        )
    return tuple(found)


def placement_suspicions(rig: StereoRig) -> list[str]:
    """List what is unusual in the position of the right camera: to the left, or diagonal."""
    found = []
    x_m, y_m, _ = -rig.R.T @ rig.T_right_left[:3, 3]
    if x_m < -abs(y_m):
        found.append(
            f"the right camera stands {-x_m:.3f} m to the LEFT of the left one: so it is where "
            "cameras are mounted upside down, or where left and right are exchanged in the "
            "calibration and the folders alike; otherwise left and right are swapped, or the "
            "transform is inverted: check it on images of the dive"
        )
    plan = plan_rectification(rig)
    if abs(plan.diagonal_deg) > DIAGONAL_DEG:
        (width, height), (kept, _) = plan.pair.image_size, kept_fractions(rig)
        found.append(
            f"the baseline lies {abs(plan.diagonal_deg):.0f} degrees off the axes of the image: "
            "the rectified images are turned, "
            f"and {width}x{height} px in size to keep the whole view ({kept:.0%} of the left image)"
        )
    return found


def _camera_suspicions(side: str, camera: Camera) -> list[str]:
    found = []
    (fx, _, cx), (_, fy, cy), _ = camera.K.tolist()
    width, height = camera.image_size
    if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) > SUSPICION_LIMITS.center_offset:
        found.append(
            f"{side}: the principal point ({cx:.0f}, {cy:.0f}) lies far from the middle of "
            f"{width}x{height} px: is K of another resolution (about {2 * cx:.0f}x{2 * cy:.0f})?"
        )
    if abs(fx / fy - 1) > SUSPICION_LIMITS.aspect:
        found.append(f"{side}: fx = {fx:.0f} and fy = {fy:.0f} px differ, and pixels are square")
    if not SUSPICION_LIMITS.focal_of_width[0] < fx / width < SUSPICION_LIMITS.focal_of_width[1]:
        found.append(
            f"{side}: a focal length of {fx:.0f} px for an image {width} px wide: is K of another "
            "resolution?"
        )
    if lens_folds(camera):
        found.append(
            f"{side}: the distortion turns back before the corners of the image, which are lost: "
            "was it fitted to corners from the middle alone?"
        )
    return found


def lens_folds(camera: Camera) -> bool:
    """Tell whether the lens model turns back within the image, so that two directions share a
    pixel, or none reaches it.

    A fisheye's corners may lie beyond 90 degrees or outside of its circle: no ray is asked to reach
    them.
    """
    width, height = camera.image_size
    if camera.model == "fisheye":
        angle = np.linspace(0, np.pi / 2, 500)
        radius = angle * (1 + np.polynomial.polynomial.polyval(angle**2, [0, *camera.distortion]))
        turns = np.flatnonzero(np.diff(radius) <= 0)
        return bool(turns.size and radius[turns[0]] * camera.K[0, 0] < np.hypot(width, height) / 2)
    edge = np.linspace(0, 1, 9)
    x, y = np.meshgrid(edge * (width - 1), edge * (height - 1))
    if camera.distortion.size >= 8:  # a quotient, whose denominator may vanish in between
        far = np.hypot((x - camera.K[0, 2]) / camera.K[0, 0], (y - camera.K[1, 2]) / camera.K[1, 1])
        squares = np.linspace(0, far.max() ** 2, 500)
        if (np.polynomial.polynomial.polyval(squares, [1, *camera.distortion[5:8]]) <= 0).any():
            return True
    return bool(np.isnan(camera.rays(np.column_stack([x.ravel(), y.ravel()]))).any())


def kept_fractions(rig: StereoRig) -> tuple[float, float]:
    """Fraction of the left and of the right raw image that the rectified images show."""
    width, height = rig.left.image_size
    x, y = np.meshgrid(np.linspace(0, width - 1, 40), np.linspace(0, height - 1, 40))
    grid = np.column_stack([x.ravel(), y.ravel()])
    width, height = plan_rectification(rig).matching_pair.image_size
    fractions = []
    for pixels in rectified_points(rig, grid, grid):
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0) & (pixels <= [width - 1, height - 1])).all(axis=1)
        fractions.append(float(inside.mean()))
    return fractions[0], fractions[1]


Array = NDArray[np.float64]
__all__ = ["RowCheck", "judge_matches", "rows_off_px", "suspicions", "vertical_disparity"]
INDICES = np.arange(1.0, 1.4401, 0.02)  # none to beyond water; found to 0.02 on a real dive


def vertical_disparity(
    rig: StereoRig, pairs: Iterable[tuple[NDArray[np.generic], NDArray[np.generic]]]
) -> RowCheck:
    """Measure on raw image pairs, (H, W) or (H, W, C), whether the calibration fits them.

    Raises CalibrationError if the images are of another size, or too few points are found in both.
    """
    rectification = Rectification.from_rig(rig)
    return judge_matches(rig, [find_matches(rectification, left, right) for left, right in pairs])


def rows_off_px(rig: StereoRig, found: Sequence[Matches]) -> float:
    """Median vertical disparity, pixels, of matches in the rectified images of each pair. Raises
    CalibrationError for too few.
    """
    left, right, _ = _points_near_rows(plan_rectification(rig).matching_pair, found)
    return float(np.median(np.abs(right[:, 1] - left[:, 1])))


def judge_matches(rig: StereoRig, found: Sequence[Matches]) -> RowCheck:
    """Judge the rows as vertical_disparity does, from matches in the rectified images of each
    pair.
    """
    plan = plan_rectification(rig)
    pair, R_left, R_right = plan.matching_pair, plan.R_left_matching, plan.R_right_matching
    left, right, numbers = _points_near_rows(pair, found)
    raw = (left, right)
    left, right = left - [pair.cx_left_px, pair.cy_px], right - [pair.cx_right_px, pair.cy_px]
    rows = right[:, 1] - left[:, 1]
    model, unexplained = explain(rows, left)
    has_distortion = rig.left.distortion.any() or rig.right.distortion.any()
    sides = [(R_left, left), (R_right, right)]
    # lenses would look like air
    index, index_unexplained = (
        _best_index(sides, pair.focal_px) if has_distortion else (1.0, np.inf)
    )
    row_error_px = float(np.median(np.abs(rows)))
    in_images = raw_points(rig, *raw)
    across = 1 - plan.pair.quarter_turns % 2  # rows, or columns of a vertical pair
    agree = row_error_px <= LIMITS.acceptable_px or rig.port is not None or rig.is_rectified
    return RowCheck(
        pairs=len(found),
        matches=len(rows),
        row_error_px=row_error_px,
        offset_px=float(model[0]),
        scale=float(1 + model[1]),
        roll_deg=float(np.degrees(model[2])),
        unexplained_px=float(np.median(np.abs(unexplained))),
        behind_fraction=float((left[:, 0] - right[:, 0] < BEHIND_PX).mean()),
        index=index,
        index_unexplained_px=index_unexplained,
        enlargement=NOT_ENLARGED if agree else best_enlargement(rig, *raw),
        keystone=find_keystone(left, right, numbers, pair.focal_px),
        unrectified_px=float(np.median(np.abs(in_images[1][:, across] - in_images[0][:, across]))),
        apart_px=float(np.median(np.hypot(*(in_images[1] - in_images[0]).T))),
        between_pairs_px=_between_pairs_px(unexplained, numbers),
    )


def _points_near_rows(
    pair: RectifiedPair, found: Sequence[Matches]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """(n, 2) matched points of the left and right images that agree about the rows, and (n,) the
    number of the pair of each. Raises CalibrationError for too few.
    """
    left, right = (
        np.concatenate([np.zeros((0, 2)), *(getattr(m, side) for m in found)])
        for side in ("left", "right")
    )
    numbers = np.repeat(np.arange(len(found)), [len(matches.left) for matches in found])
    if len(left) >= MIN_MATCHES:
        kept = row_inliers(left, right, pair)
        left, right, numbers = left[kept], right[kept], numbers[kept]
    if len(left) < MIN_MATCHES:
        raise CalibrationError(
            f"only {len(left)} points were found in both images of {counted(len(found), 'pair')}, "
            f"{MIN_MATCHES} are needed: give pairs with texture, and see whether both images show "
            "the same scene at the same time"
        )
    return left, right, numbers


def _between_pairs_px(rest: Array, numbers: NDArray[np.int64]) -> float:
    """Robust standard deviation of the medians of each pair's rows; numbers: (n,) each match's
    pair.
    """
    medians = [np.median(rest[numbers == number]) for number in np.unique(numbers)]
    if len(medians) < 3:
        return 0.0
    return float(1.4826 * np.median(np.abs(medians - np.median(medians))))


def _best_index(sides: list[tuple[Array, Array]], focal_px: float) -> tuple[float, float]:
    """The refractive index behind flat ports, square to each optical axis, whose bending makes rows
    agree best; and what it leaves.

    A calibration made in air takes a pixel for its ray in air; in the water, sin(theta) is 1/n of
    that (Snell). Where the two images see a point at different distances from their middles, the
    wrong rays move it to different rows: that is the evidence. Each index is judged after the
    offset, scale and roll that suit it best, in pixels of the same size in the scene.

    sides: rectifying rotation (3, 3), and pixels (n, 2) from the principal point, of the left and
    the right image.
    """
    rays = [np.column_stack([pixels / focal_px, np.ones(len(pixels))]) @ R for R, pixels in sides]
    rays = [directions / np.linalg.norm(directions, axis=1, keepdims=True) for directions in rays]
    left_over = []
    for index in INDICES:
        pixels = []
        for (R, _), directions in zip(sides, rays, strict=True):
            across = directions[:, :2] / index
            bent = np.column_stack([across, np.sqrt(1 - (across**2).sum(axis=1))]) @ R.T
            pixels.append(bent[:, :2] / bent[:, 2:] * focal_px * index)
        _, rest = explain(pixels[1][:, 1] - pixels[0][:, 1], pixels[0])
        left_over.append(float(np.median(np.abs(rest))))
    best = int(np.argmin(left_over))
    return float(INDICES[best]), left_over[best]


# Range errors that a flat port causes, modeled or ignored: exact rays traced through it, compared
# with the rectification.

GRID = (17, 13)  # points over the image, columns and rows: errors of a port are smooth


@dataclass(frozen=True, eq=False)
class PortError:
    """Errors over the image at each depth_m (k,) before the rig; NaN where the cameras share no
    view.

    range_error: root mean square, relative; row_error_px: root mean square difference of rows.
    """

    depth_m: Array
    range_error: Array
    row_error_px: Array


def port_error(rig: StereoRig, depth_m: Array, seen_as: StereoRig | None = None) -> PortError:
    """Trace points before ``rig``, which must have a flat port, and measure them as ``seen_as``
    does, by default the same rig.

    Raises CalibrationError for a rig without a flat port.
    """
    seen_as = seen_as or rig
    traced = [_errors_at(rig, seen_as, float(depth)) for depth in depth_m]
    ranges, rows = np.array(traced).T
    return PortError(depth_m, ranges, rows)


def _errors_at(rig: StereoRig, seen_as: StereoRig, depth_m: float) -> tuple[float, float]:
    points, pixels = _traced(rig, depth_m)
    if len(points) == 0:
        return np.nan, np.nan
    left, right = rectified_points(seen_as, *pixels)
    pair = plan_rectification(seen_as).matching_pair
    disparity = left[:, 0] - right[:, 0] - (pair.cx_left_px - pair.cx_right_px)
    slopes = (left - [pair.cx_left_px, pair.cy_px]) / pair.focal_px
    range_m = pair.focal_px * pair.baseline_m / disparity * np.sqrt(1 + (slopes**2).sum(axis=1))
    relative = range_m / np.linalg.norm(points, axis=1) - 1
    return float(np.sqrt(np.mean(relative**2))), float(
        np.sqrt(np.mean((left[:, 1] - right[:, 1]) ** 2))
    )


def _traced(rig: StereoRig, depth_m: float) -> tuple[Array, tuple[Array, Array]]:
    """Points (n, 3) that both cameras see, in rectified axes from the left camera's center in
    water; and their raw pixels.
    """
    left, right, _ = cameras_in_water(rig)
    if not isinstance(left, CameraInWater) or not isinstance(right, CameraInWater):
        raise CalibrationError("the rig has no flat port: nothing is bent")
    plan = plan_rectification(rig)
    pair, R_left = plan.matching_pair, plan.R_left_matching
    width, height = pair.image_size
    x, y = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    slopes = (
        np.column_stack([x.ravel(), y.ravel()]) - [pair.cx_left_px, pair.cy_px]
    ) / pair.focal_px
    points = np.column_stack([slopes, np.ones(len(slopes))]) * depth_m
    before_left = points @ R_left + left.center_m
    before_right = before_left @ rig.R.T + rig.T_right_left[:3, 3]
    pixels = [left.project_points(before_left), right.project_points(before_right)]
    with np.errstate(invalid="ignore"):
        inside = np.all(
            [((p >= 0) & (p <= [width - 1, height - 1])).all(axis=1) for p in pixels], axis=0
        )
    return points[inside], (pixels[0][inside], pixels[1][inside])
