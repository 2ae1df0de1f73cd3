"""Rigs whose baseline is long against the range: points that both cameras see from different sides
are found, in pictures as compressed video has them.
"""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration import CalibrationError
from calibration.checks import vertical_disparity
from calibration.rectification import Rectification
from calibration.refine import refine_matches
from calibration.rig import Camera, StereoRig
from calibration.verification.matches import (
    MATCH_LIMITS,
    describe_left,
    describe_right,
    find_matches,
    match_described,
    raw_matches,
)

SIZE = (960, 540)
FOCAL_PX = 900.0
BASELINE_M = 0.86
PITCH = 4.5 / FOCAL_PX


def wide_rig(pitch: float = 0.0) -> StereoRig:
    """Cameras that look at a place 4 m ahead; the right one is turned by ``pitch``, radians."""
    K = np.array([[FOCAL_PX, 0, SIZE[0] / 2], [0, FOCAL_PX, SIZE[1] / 2], [0, 0, 1]])
    camera = Camera(K, np.array([-0.05, 0.01, 0.0, 0.0, 0.0]), SIZE)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xy", [pitch, 2 * np.arctan(BASELINE_M / 8)]).as_matrix()
    T[:3, 3] = -T[:3, :3] @ [BASELINE_M * np.cos(0.107), 0, BASELINE_M * np.sin(0.107)]
    return StereoRig(camera, camera, T)


def rows_px() -> float:
    """By how much the rows of the right images move with the turned camera."""
    return -PITCH * Rectification.from_rig(wide_rig()).matching_pair.focal_px


def photographs(rig: StereoRig, scene: int, noise: float = 18.0) -> list[np.ndarray]:
    """Both pictures of boards of many depths and slants, dim, blurred and noisy."""
    rng = np.random.default_rng([scene, 5])
    boards = [(np.array([0.4, 0.3, 7.0]), np.radians([25, 0]), 9.0)]
    for _ in range(16):
        middle = np.array([rng.uniform(-1.4, 2.2), rng.uniform(-0.9, 0.9), rng.uniform(2.5, 5)])
        boards.append((middle, np.radians(rng.uniform(-35, 35, 2)), rng.uniform(0.5, 0.9)))
    boards.sort(key=lambda board: -board[0][2])
    textures = [_texture(rng) for _ in boards]
    pictures = []
    for side, T in enumerate((np.eye(4), rig.T_right_left)):
        seen = np.full((SIZE[1], SIZE[0]), 100, np.float32)
        camera = (rig.left, rig.right)[side]
        for (middle, turn, size_m), texture in zip(boards, textures, strict=True):
            axes = Rotation.from_euler("xy", turn).as_matrix()[:, :2] * size_m / len(texture)
            plane = np.column_stack([axes, middle - axes @ np.full(2, len(texture) / 2)])
            H = camera.K @ (T[:3, :3] @ plane + np.outer(T[:3, 3], [0, 0, 1]))
            drawn = cv2.warpPerspective(texture, H, SIZE, flags=cv2.INTER_AREA)
            there = cv2.warpPerspective(np.ones_like(texture), H, SIZE)
            seen = np.where(there > 0.99, drawn, seen)
        camera_rays = cv2.undistortPoints(_grid(), camera.K, camera.distortion, P=camera.K)
        x, y = camera_rays.reshape(*seen.shape, 2).transpose(2, 0, 1).astype(np.float32)
        seen = cv2.GaussianBlur(cv2.remap(seen, x, y, cv2.INTER_CUBIC), (0, 0), 1.2)
        grain = np.random.default_rng([scene, side]).normal(0, noise, seen.shape)
        pictures.append(np.clip(seen + grain, 0, 255).astype(np.uint8))
    return pictures


def _texture(rng: np.random.Generator) -> np.ndarray:
    size, image = 256, np.full((256, 256), 100, np.float32)
    for cells in (8, 16, 32, 64):
        noise = rng.normal(0, 12, (cells, cells)).astype(np.float32)
        image += cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC)
    return image


def _grid() -> np.ndarray:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    return np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float64)


@pytest.fixture(scope="module")
def turned() -> list[list[np.ndarray]]:
    """Pairs of a rig whose right camera has turned since it was calibrated."""
    return [photographs(wide_rig(PITCH), scene) for scene in range(3)]


@pytest.mark.slow
def test_points_are_found_where_plain_flow_loses_them(turned) -> None:
    rectification = Rectification.from_rig(wide_rig())
    for left, right in turned:
        sides = describe_left(rectification, left), describe_right(rectification, right)
        plain = match_described(*sides, MATCH_LIMITS)
        found = find_matches(rectification, left, right)
        assert len(plain.left) < MATCH_LIMITS.enough
        assert len(found.left) > max(50, 2 * len(plain.left))
        rows = found.right[:, 1] - found.left[:, 1]
        assert np.median(rows) == pytest.approx(rows_px(), abs=0.15)
        assert np.abs(rows - np.median(rows)).max() < 3


@pytest.mark.slow
def test_refining_finds_how_a_wide_rig_has_moved(turned) -> None:
    given = wide_rig()
    found = raw_matches(given, [(left, right) for left, right in turned])
    refined = refine_matches(given, found)
    assert refined.refinement is not None
    moved = {movement.name: movement for movement in refined.refinement.movements}
    assert moved["pitch"].value == pytest.approx(PITCH, abs=0.2 / FOCAL_PX)
    rows = vertical_disparity(given, [(left, right) for left, right in turned])
    assert rows.offset_px == pytest.approx(rows_px(), abs=0.15)
    assert rows.has_moved
    assert not vertical_disparity(wide_rig(PITCH), [(a, b) for a, b in turned]).ranges_are_wrong


@pytest.mark.slow
def test_other_scenes_have_no_points_in_common(turned) -> None:
    """A check of such pairs finds too few points: it names no fault of the calibration."""
    pairs = [(turned[i][0], turned[i - 1][1]) for i in range(3)]
    with pytest.raises(CalibrationError, match=r"points were found in both images"):
        vertical_disparity(wide_rig(), pairs)
