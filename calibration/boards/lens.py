"""A rig from views of a target: each camera alone, the rig between them, then all together."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from calibration.boards.bundle import Array, Bundle, CornerObservation, Lens, rms, solve
from calibration.boards.target_views import TargetView, observations_of
from calibration.boards.targets import Target
from calibration.errors import CalibrationError
from calibration.geometry import camera_matrix
from calibration.rig import Camera, CameraModel
from calibration.transforms import inverse, rigid_transform

FISHEYE_TRIAL_ITERATIONS = 10  # of each guess; the best one is then fitted to the end
FISHEYE_FOCAL_GUESSES = (0.25, 0.4, 0.6, 0.9, 1.4)  # of the image's width
Size = tuple[int, int]


def fit_rig(views: Sequence[TargetView], target: Target, lens: Lens) -> Bundle:
    """The rig and the target's poses of least reprojection error."""
    return solve(first_guess(views, target, lens), observations_of(views, target))


def first_guess(views: Sequence[TargetView], target: Target, lens: Lens) -> Bundle:
    """Each camera fitted alone, and the rig between them that most views agree on.

    Raises CalibrationError if the views do not determine a camera.
    """
    observations = observations_of(views, target)
    sides = [[replace(o, side=0) for o in observations if o.side == side] for side in (0, 1)]
    left, right = (fit_camera(lens, own, views[0].image_size) for own in sides)
    steps = [
        T_right @ inverse(T_left)
        for T_left, T_right in zip(left.T_left_target, right.T_left_target, strict=True)
    ]
    return Bundle(
        lens, (left.intrinsics[0], right.intrinsics[0]), _middle(steps), left.T_left_target
    )


def fit_camera(lens: Lens, observations: list[CornerObservation], image_size: Size) -> Bundle:
    """Fit one camera by bundle adjustment. observations: of side 0, views numbered from 0."""
    if lens.model == "fisheye":
        fits = [
            _fit_fisheye(lens, guess * image_size[0], observations, image_size)
            for guess in FISHEYE_FOCAL_GUESSES
        ]
        return solve(min(fits, key=lambda fit: rms(fit, observations)), observations)
    points = [observation.points_m.astype(np.float32) for observation in observations]
    pixels = [observation.pixels.astype(np.float32) for observation in observations]
    try:
        _, K, distortion, rotations, translations = cv2.calibrateCamera(
            points, pixels, image_size, None, None
        )
    except cv2.error as error:
        raise CalibrationError(
            "the views do not determine a camera: tilt the target differently in each"
        ) from error
    focal_px = np.full(2, (K[0, 0] + K[1, 1]) / 2) if lens.square_pixels else K[[0, 1], [0, 1]]
    intrinsics = np.concatenate(
        [focal_px, K[:2, 2], np.ravel(distortion)[:5], np.zeros(lens.coefficients - 5)]
    )
    poses = np.array(
        [
            rigid_transform(cv2.Rodrigues(r)[0], t.ravel())
            for r, t in zip(rotations, translations, strict=True)
        ]
    )
    return solve(Bundle(lens, (intrinsics, intrinsics), np.eye(4), poses), observations)


def target_pose(camera: Camera, observation: CornerObservation) -> Array:
    """Estimate the target's pose, (4, 4) target to camera, from one view's corners."""
    rays = camera.rays(observation.pixels)
    seen = np.isfinite(rays[:, 0])
    if seen.sum() < 4:
        return rigid_transform(np.eye(3), np.array([0, 0, 5 * np.ptp(observation.points_m)]))
    _, rotation, translation = cv2.solvePnP(
        observation.points_m[seen], rays[seen, :2], np.eye(3), None
    )
    return rigid_transform(cv2.Rodrigues(rotation)[0], translation.ravel())


def to_camera(model: CameraModel, intrinsics: Array, image_size: Size) -> Camera:
    """A Camera of bundle intrinsics."""
    return Camera(camera_matrix(*intrinsics[:4]), intrinsics[4:].copy(), image_size, model)


def _fit_fisheye(
    lens: Lens, focal_px: float, observations: list[CornerObservation], image_size: Size
) -> Bundle:
    """From an ideal fisheye (r = f theta) of this focal length; cv2.fisheye.calibrate has no such
    start and often fails.
    """
    width, height = image_size
    intrinsics = np.array([focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, 0, 0, 0, 0])
    camera = to_camera("fisheye", intrinsics, image_size)
    poses = np.array([target_pose(camera, observation) for observation in observations])
    return solve(
        Bundle(lens, (intrinsics, intrinsics), np.eye(4), poses),
        observations,
        iterations=FISHEYE_TRIAL_ITERATIONS,
    )


def _middle(transforms: list[Array]) -> Array:
    """The transform nearest to all others: one bad view changes nothing."""
    stacked = np.array([T[:3].ravel() for T in transforms])
    distances = np.linalg.norm(stacked[:, None] - stacked[None], axis=2).sum(axis=1)
    return transforms[int(np.argmin(distances))]
