"""Warnings about a rig that is usable but looks wrong, found in its numbers alone."""

import cv2
import numpy as np

from calibration.port import DESCRIBE_PORT
from calibration.rectification import DIAGONAL_DEG, plan_rectification, rectified_points
from calibration.rig import Camera, StereoRig, quarter_turn, quarter_turns_of
from calibration.transforms import inverse, is_backward

# what is unusual in a rig, though possible
# of the image: no lens is mounted that far off; K of half the resolution gives 0.25
CENTER_OFFSET = 0.2
CORNER_OFFSET = 0.05  # of the image, from its first pixel; K of a tenth of the resolution gives it
ASPECT = 0.05  # fx / fy off 1: sensors have square pixels, and ports stretch them by 1 or 2 %
FOCAL_OF_WIDTH = (0.2, 10.0)  # 136 degrees across, and 6
FOCAL_RATIO = (0.8, 1.25)  # left to right: pairs are made of equal lenses
ANGLE_DEG = 30.0  # between the cameras, quarter turns apart: pairs look the same way
KEPT_PINHOLE = 0.4  # of the view after rectification
KEPT_FISHEYE = 0.1  # a flat image shows the middle of a fisheye alone
RMS_PX = 1.0  # a calibration is good to 0.3 px


def suspicions(rig: StereoRig) -> tuple[str, ...]:
    """List what looks wrong in a usable rig, one line each; empty where nothing does."""
    found = list(rig.doubts)
    if rig.alternatives:
        found.append(
            f"{rig.reading}: the file can be read in {len(rig.alternatives) + 1} ways, and the "
            "images of the dive must decide"
        )
    found += [
        text
        for side, camera in (("left", rig.left), ("right", rig.right))
        for text in _camera_suspicions(side, camera)
    ]
    focal_ratio = rig.left.K[0, 0] / rig.right.K[0, 0]
    if not FOCAL_RATIO[0] < focal_ratio < FOCAL_RATIO[1]:
        found.append(
            f"the focal lengths differ: {rig.left.K[0, 0]:.0f} px left and "
            f"{rig.right.K[0, 0]:.0f} px right"
        )
    # scipy would take 0.3 s to load
    turned = cv2.Rodrigues(quarter_turn(-quarter_turns_of(rig.R)) @ rig.R)[0]
    angle_deg = np.degrees(np.linalg.norm(turned))
    if angle_deg > ANGLE_DEG:
        found.append(
            f"the cameras are rotated by {angle_deg:.0f} degrees relative to each other: does "
            "the rotation belong to this rig?"
        )
    found += placement_suspicions(rig)
    kept = min(kept_fractions(rig))
    if kept < (KEPT_FISHEYE if rig.left.model == "fisheye" else KEPT_PINHOLE):
        found.append(
            f"rectified images keep {kept:.0%} of the field of view: check rotation, focal "
            "lengths and distortion"
        )
    if not (rig.left.distortion.any() or rig.right.distortion.any() or rig.is_rectified):
        found.append(
            "no lens distortion in the calibration, although its cameras are not rectified: is "
            "it missing in the file?"
        )
    if rig.rms_px is not None and rig.rms_px > RMS_PX:
        found.append(
            f"the reprojection error of the calibration is {rig.rms_px:.2f} px, over "
            f"{RMS_PX:g} px: calibrate again"
        )
    if rig.medium == "air" and rig.port is None and not rig.is_rectified:
        found.append(
            "calibrated in air: behind a flat port under water, ranges are wrong by about a "
            f"quarter; calibrate in water, or describe the port: {DESCRIBE_PORT}"
        )
    return tuple(found)


def placement_suspicions(rig: StereoRig) -> list[str]:
    """List what is unusual in the position of the right camera: to the left, or diagonal."""
    found = []
    if is_backward(rig.T_right_left):
        left_m = -float(inverse(rig.T_right_left)[0, 3])
        found.append(
            f"the right camera stands {left_m:.3f} m to the LEFT of the left one: this is correct "
            "if the cameras are mounted upside down, or if left and right are exchanged in "
            "both the calibration and the folders; otherwise left and right are swapped, or "
            "the transform is inverted: check it on images of the dive"
        )
    plan = plan_rectification(rig)
    if abs(plan.diagonal_deg) > DIAGONAL_DEG:
        (width, height), (kept, _) = plan.pair.image_size, kept_fractions(rig)
        found.append(
            f"the baseline lies {abs(plan.diagonal_deg):.0f} degrees off the axes of the image: "
            f"the rectified images are rotated, and {width}x{height} px in size to keep the "
            f"whole view ({kept:.0%} of the left image)"
        )
    return found


def _camera_suspicions(side: str, camera: Camera) -> list[str]:
    found = []
    (fx, _, cx), (_, fy, cy), _ = camera.K.tolist()
    width, height = camera.image_size
    if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) > CENTER_OFFSET:
        reason = (
            "it seems to be counted from the center: add half of the width and height"
            if max(abs(cx) / width, abs(cy) / height) < CORNER_OFFSET
            else "K may belong to another resolution, or to larger images that these are cut out "
            f"of (about {2 * cx:.0f}x{2 * cy:.0f})"
        )
        found.append(
            f"{side}: the principal point ({cx:.0f}, {cy:.0f}) is far from the center of "
            f"{width}x{height} px: {reason}"
        )
    if abs(fx / fy - 1) > ASPECT:
        found.append(
            f"{side}: fx = {fx:.0f} and fy = {fy:.0f} px differ, but pixels are usually square"
        )
    if not FOCAL_OF_WIDTH[0] < fx / width < FOCAL_OF_WIDTH[1]:
        found.append(
            f"{side}: a focal length of {fx:.0f} px for an image {width} px wide: does K belong "
            "to another resolution?"
        )
    if lens_folds(camera):
        found.append(
            f"{side}: the distortion is not monotonic up to the image corners, which are cut "
            "off: was it fitted only to points near the center?"
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
