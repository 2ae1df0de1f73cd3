"""Views of a target through a known rig: corners by projection with noise, or whole images rendered
by each pixel's ray.
"""

from functools import cache, lru_cache
from pathlib import Path

import cv2
import numpy as np

from calibration import Camera, StereoRig
from calibration.aprilgrid import AprilGrid, Corners
from calibration.boards.printing import print_target
from calibration.boards.target_views import TargetView
from calibration.boards.targets import Chessboard, parse_target
from calibration.refraction import CameraInWater, cameras_in_water

SIZE = (1280, 960)


def pinhole_rig() -> StereoRig:
    """A pair 0.12 m apart, toed in a little, with barrel distortion."""
    K_left = np.array([[1100.0, 0, 652.3], [0, 1098.0, 470.1], [0, 0, 1]])
    K_right = np.array([[1107.0, 0, 630.9], [0, 1104.5, 489.6], [0, 0, 1]])
    left = Camera(K_left, np.array([-0.21, 0.07, 0.0006, -0.0004, -0.01]), SIZE)
    right = Camera(K_right, np.array([-0.2, 0.06, -0.0003, 0.0007, -0.005]), SIZE)
    return StereoRig(left, right, _pose([0.004, 0.03, -0.006], [-0.12, 0.0015, 0.002]))


def fisheye_rig() -> StereoRig:
    """A pair 0.1 m apart that sees 130 degrees."""
    K = np.array([[560.0, 0, 640.2], [0, 559.0, 481.5], [0, 0, 1]])
    left = Camera(K, np.array([0.03, -0.012, 0.004, -0.001]), SIZE, "fisheye")
    right = Camera(
        K + np.diag([4.0, 3.5, 0]), np.array([0.028, -0.01, 0.003, -0.0008]), SIZE, "fisheye"
    )
    return StereoRig(left, right, _pose([0.01, -0.02, 0.005], [-0.1, -0.001, 0.003]))


def seen_by(
    rig: StereoRig, count: int, noise_px: float, rng: np.random.Generator
) -> list[np.ndarray]:
    """Raw pixels (n, 2), with noise, of ``count`` random points 0.6 to 4 m before the rig, less
    those beside the right image.
    """
    left, right, _ = cameras_in_water(rig)
    size = np.array(rig.left.image_size)
    points = left.rays(rng.uniform([0, 0], size - 1, (count, 2))) * rng.uniform(0.6, 4, (count, 1))
    if isinstance(left, CameraInWater) and isinstance(right, CameraInWater):
        points += left.center_m
        pixels = [
            left.project_points(points),
            right.project_points(points @ rig.R.T + rig.T_right_left[:3, 3]),
        ]
    else:
        pixels = [
            rig.left.project(points),
            rig.right.project(points @ rig.R.T + rig.T_right_left[:3, 3]),
        ]
    inside = ((pixels[1] > 0) & (pixels[1] < size - 1)).all(axis=1)
    return [p[inside] + rng.normal(0, noise_px, (inside.sum(), 2)) for p in pixels]


def mismatched(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A tenth of the pixels (n, 2) moved by some 8 px."""
    wrong = rng.random(len(pixels)) < 0.1
    moved = pixels.copy()
    moved[wrong] += rng.normal(0, 8, (wrong.sum(), 2))
    return moved


def poses(
    target: Chessboard | AprilGrid,
    views: int,
    rng: np.random.Generator,
    width_fraction: float = 0.5,
    slope: float = 0.45,
    tilt: float = 0.6,
) -> list[np.ndarray]:
    """Boards before the rig, tilted up to 35 degrees (``tilt``, radians), all over the image."""
    middle = np.append(target.points_m.max(axis=0)[:2] / 2, 0)
    found = []
    while len(found) < views:
        distance = (
            target.points_m[:, 0].max() / (2 * slope) / width_fraction * rng.uniform(0.8, 1.5)
        )
        T = _pose(rng.uniform(-tilt, tilt, 3) * [1, 1, 0.5], [0, 0, 0])
        center = np.append(rng.uniform(-slope, slope, 2) * [1, 0.7], 1.0) * distance
        T[:3, 3] = center - T[:3, :3] @ middle
        found.append(T)
    return found


def projected_views(
    rig: StereoRig,
    target: Chessboard | AprilGrid,
    views: int,
    noise_px: float,
    rng: np.random.Generator,
    slope: float | None = None,
    width_fraction: float = 0.5,
    tilt: float = 0.6,
) -> list[TargetView]:
    """Corners of views that both cameras see whole, with Gaussian noise. slope, width_fraction,
    tilt: of the outermost boards; all over the image by default.
    """
    found: list[TargetView] = []
    slope = slope or (0.9 if rig.left.model == "fisheye" else 0.45)
    while len(found) < views:
        (T,) = poses(target, 1, rng, width_fraction, slope, tilt)
        corners = []
        for camera, extrinsic in ((rig.left, np.eye(4)), (rig.right, rig.T_right_left)):
            pixels = camera.project(
                target.points_m @ (extrinsic @ T)[:3, :3].T + (extrinsic @ T)[:3, 3]
            )
            inside = ((pixels > 5) & (pixels < np.array(SIZE) - 6)).all()
            corners.append(
                Corners(np.arange(len(pixels)), pixels + rng.normal(0, noise_px, pixels.shape))
                if inside
                else None
            )
        if corners[0] is not None and corners[1] is not None:
            found.append(TargetView(f"view{len(found)}", SIZE, corners[0], corners[1]))
    return found


def rendered(
    camera: Camera,
    T_camera_target: np.ndarray,
    board: np.ndarray,
    board_px_per_m: float,
    origin_m: np.ndarray,
) -> np.ndarray:
    """The image (H, W) that a camera takes of a flat picture: each pixel's ray meets the plane;
    blurred as a lens does.

    origin_m: where the picture's top left pixel lies on the target's plane.
    """
    width, height = camera.image_size
    rays = _pixel_rays(camera)
    R, t = T_camera_target[:3, :3], T_camera_target[:3, 3]
    scale = (R[:, 2] @ t) / (rays @ R[:, 2])
    on_plane = (rays * scale[:, None] - t) @ R
    where = ((on_plane[:, :2] - origin_m) * board_px_per_m - 0.5).astype(np.float32)
    where[~(scale > 0)] = -1e6
    maps = where.reshape(height, width, 2)
    smooth = cv2.GaussianBlur(
        board, (0, 0), max(1.0, 0.5 * board_px_per_m * float(np.median(scale)) / camera.K[0, 0])
    )
    image = cv2.remap(
        smooth,
        maps[..., 0],
        maps[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=128,
    )
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7))


@cache
def photograph_board(folder: Path, target: str) -> StereoRig:
    """Six rendered pairs of a printed target of about 0.3 m, in left/ and right/ of a folder, and
    the rig that took them.
    """
    K = np.array([[520.0, 0, 243], [0, 520, 176], [0, 0, 1]])
    camera = Camera(K, np.array([-0.1, 0.02, 0, 0, 0]), (480, 360))
    T = np.eye(4)
    T[0, 3] = -0.1
    board = parse_target(target)
    print_target(board, folder / "board.png", dpi=300)
    picture = cv2.imread(str(folder / "board.png"), cv2.IMREAD_GRAYSCALE)
    white_m = board.tag_m + board.space_m if isinstance(board, AprilGrid) else 2 * board.square_m
    origin_m = np.full(2, -white_m)  # of the picture: its margin is a square or a tag wide
    for side in ("left", "right"):
        (folder / side).mkdir()
    tilts = [(0.4, 0.1), (-0.4, 0.1), (0.1, 0.45), (0.0, -0.45), (0.3, 0.3), (-0.3, -0.3)]
    for number, (tilt_x, tilt_y) in enumerate(tilts):
        pose = _pose([tilt_x, tilt_y, 0.1 * (number - 2)], [0, 0, 0])
        pose[:3, 3] = pose[:3, :3] @ [-0.12, -0.08, 0] + [
            0.05 + 0.03 * (number % 3 - 1),
            0.03 * (number % 2),
            0.62,
        ]
        for side, extrinsic in (("left", np.eye(4)), ("right", T)):
            image = rendered(camera, extrinsic @ pose, picture, 300 / 0.0254, origin_m)
            cv2.imwrite(str(folder / side / f"{number:02d}.png"), image)
    return StereoRig(camera, camera, T)


@lru_cache(maxsize=4)
def _pixel_rays(camera: Camera) -> np.ndarray:
    """(n, 3), to be read only: boards are photographed by the same camera again and again."""
    width, height = camera.image_size
    x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    return camera.rays(np.column_stack([x.ravel(), y.ravel()]))


def _pose(rotation: object, translation: object) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.asarray(rotation, dtype=float))[0]
    T[:3, 3] = translation
    return T
