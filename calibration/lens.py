"""First guesses of cameras and poses from views of a target, before everything is refined together."""

import cv2
import numpy as np

from calibration.bundle import Array, Bundle, Observation, camera_matrix, rms, solve
from calibration.rig import Camera, CameraModel

FISHEYE_FOCAL_GUESSES = (0.25, 0.4, 0.6, 0.9, 1.4)  # of the image's width
Size = tuple[int, int]


def fit_camera(model: CameraModel, coefficients: int, observations: list[Observation], image_size: Size) -> Bundle:
    """One camera alone, refined. observations: all of side 0, views numbered from 0 without a gap."""
    if model == "fisheye":
        fits = [_fit_fisheye(guess * image_size[0], observations, image_size) for guess in FISHEYE_FOCAL_GUESSES]
        return min(fits, key=lambda fit: rms(fit, observations))
    points = [observation.points_m.astype(np.float32) for observation in observations]
    pixels = [observation.pixels.astype(np.float32) for observation in observations]
    _, K, distortion, rotations, translations = cv2.calibrateCamera(points, pixels, image_size, None, None)
    intrinsics = np.concatenate([K[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(distortion)[:5], np.zeros(coefficients - 5)])
    poses = np.array([rigid(cv2.Rodrigues(r)[0], t) for r, t in zip(rotations, translations, strict=True)])
    return solve(Bundle("pinhole", (intrinsics, intrinsics), np.eye(4), poses), observations)


def target_pose(camera: Camera, observation: Observation) -> Array:
    """(4, 4) target to camera, from one view's corners."""
    rays = camera.rays(observation.pixels)
    seen = np.isfinite(rays[:, 0])
    if seen.sum() < 4:
        return rigid(np.eye(3), np.array([0, 0, 5 * np.ptp(observation.points_m)]))
    _, rotation, translation = cv2.solvePnP(observation.points_m[seen], rays[seen, :2], np.eye(3), None)
    return rigid(cv2.Rodrigues(rotation)[0], translation)


def to_camera(model: CameraModel, intrinsics: Array, image_size: Size) -> Camera:
    """A Camera of bundle intrinsics."""
    return Camera(camera_matrix(intrinsics), intrinsics[4:].copy(), image_size, model)


def rigid(R: Array, t: Array) -> Array:
    """(4, 4) of a rotation and a translation."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = np.ravel(t)
    return T


def _fit_fisheye(focal_px: float, observations: list[Observation], image_size: Size) -> Bundle:
    """From an ideal fisheye (r = f theta) of this focal length; cv2.fisheye.calibrate has no such start and often fails."""
    width, height = image_size
    intrinsics = np.array([focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, 0, 0, 0, 0])
    camera = to_camera("fisheye", intrinsics, image_size)
    poses = np.array([target_pose(camera, observation) for observation in observations])
    return solve(Bundle("fisheye", (intrinsics, intrinsics), np.eye(4), poses), observations)
