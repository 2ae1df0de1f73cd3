"""Rectification: bring both images onto one image plane, rows aligned."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry import RectifiedPair
from calibration.refraction import CameraInWater, cameras_in_water
from calibration.rig import Camera, StereoRig

Image = NDArray[np.uint8] | NDArray[np.uint16]
Array = NDArray[np.float64]
AnyCamera = Camera | CameraInWater
RemapTables = tuple[NDArray[np.int16], NDArray[np.uint16]]
WIDEST_SLOPE = 2.0  # tan of 63 degrees: a pinhole image of more spends its pixels on the rim
BORDER_STEPS = 33


@dataclass(frozen=True, eq=False)
class Rectification:
    """How a rig's images become rectified ones; built once for a run.

    pair: the geometry after rectification.
    R_left, R_right: (3, 3) rotation from each camera's axes to the rectified axes.
    center_left_m: (3,) in the left camera's axes, where the rectified left camera has its center; off zero behind a flat port.
    maps_left, maps_right: cv2.remap tables (fixed point), None for a rig that is rectified already: its images pass
    through untouched.
    """

    pair: RectifiedPair
    R_left: Array
    R_right: Array
    center_left_m: Array
    maps_left: RemapTables | None
    maps_right: RemapTables | None

    @classmethod
    def from_rig(cls, rig: StereoRig) -> "Rectification":
        """Rectify ``rig`` onto images of the left camera's size, as wide as both cameras see without empty corners."""
        pair, R_left, R_right = plan_rectification(rig)
        if rig.is_rectified:
            return cls(pair, R_left, R_right, np.zeros(3), None, None)
        left, right, _ = cameras_in_water(rig)
        center_m = left.center_m if isinstance(left, CameraInWater) else np.zeros(3)
        return cls(pair, R_left, R_right, center_m, _maps(left, R_left, pair), _maps(right, R_right, pair))

    def apply_left(self, image: Image) -> Image:
        """Rectify a left image (H, W) or (H, W, C); dtype kept, black where the camera saw nothing."""
        return _remap(image, self.maps_left, self.pair.image_size, "left")

    def apply_right(self, image: Image) -> Image:
        """Rectify a right image; as apply_left."""
        return _remap(image, self.maps_right, self.pair.image_size, "right")

    @property
    def T_rectified_left(self) -> Array:
        """(4, 4): a point in the left camera's axes, as calibrated, into the rectified left camera's."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.R_left, -self.R_left @ self.center_left_m
        return T

    def rectified_rig(self) -> StereoRig:
        """The rig that the rectified images look taken by: no distortion, no rotation, one focal length."""
        right_of_left = np.eye(4)
        right_of_left[0, 3] = -self.pair.baseline_m
        K_right = self.pair.P_left.copy()
        K_right[0, 2] = self.pair.cx_right_px
        none, size = np.zeros(0), self.pair.image_size
        return StereoRig(Camera(self.pair.P_left, none, size), Camera(K_right, none, size), right_of_left)

    def seen_left(self) -> NDArray[np.bool_]:
        """(H, W) True where the rectified left image shows something that the left camera saw."""
        width, height = self.pair.image_size
        return np.asarray(self.apply_left(np.full((height, width), 255, np.uint8)) == 255)


def rectified_points(rig: StereoRig, left: Array, right: Array) -> tuple[Array, Array]:
    """Where pixels (n, 2) of the raw left and right images lie in the rectified ones; NaN where a lens does not reach."""
    pair, R_left, R_right = plan_rectification(rig)
    rectified = []
    left_camera, right_camera, _ = cameras_in_water(rig)
    for camera, R, pixels in ((left_camera, R_left, left), (right_camera, R_right, right)):
        x, y, z = (camera.rays(pixels) @ R.T).T
        rectified.append(np.column_stack([x / z * pair.focal_px + pair.cx_left_px, y / z * pair.focal_px + pair.cy_px]))
    if rig.is_rectified:
        rectified[1][:, 0] += pair.cx_right_px - pair.cx_left_px
    return rectified[0], rectified[1]


def rectifying_rotations(T_right_left: Array) -> tuple[Array, Array]:
    """(3, 3) rotations from each camera's axes to common ones whose x axis is the baseline, each camera turned equally.

    Bouguet's construction, as in Learning OpenCV (Bradski and Kaehler 2008), ch. 12: halve the rotation between the cameras,
    then turn both so that the translation lies along x.
    """
    half, _ = cv2.Rodrigues(cv2.Rodrigues(T_right_left[:3, :3])[0] / 2)
    turn = _rotation_onto_x(-(half.T @ T_right_left[:3, 3]))
    return turn @ half, turn @ half.T


def _rotation_onto_x(vector: Array) -> Array:
    x = vector / np.linalg.norm(vector)
    axis = np.cross(x, [1.0, 0.0, 0.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-15:
        return np.eye(3)
    return np.asarray(cv2.Rodrigues(axis / sine * np.arctan2(sine, x[0]))[0], dtype=np.float64)


def plan_rectification(rig: StereoRig) -> tuple[RectifiedPair, Array, Array]:
    """The rectified geometry, and the rotations (3, 3) from the left and the right camera onto it."""
    if rig.left.image_size != rig.right.image_size:
        raise CalibrationError(f"left and right images differ in size: {rig.left.image_size} and {rig.right.image_size}")
    if rig.is_rectified:
        K = rig.left.K
        pair = RectifiedPair(K[0, 0], K[0, 2], rig.right.K[0, 2], K[1, 2], rig.baseline_m, rig.left.image_size)
        return pair, np.eye(3), np.eye(3)
    left, right, T_right_left = cameras_in_water(rig)
    R_left, R_right = rectifying_rotations(T_right_left)
    focal_px, cx_px, cy_px = _common_view([(left, R_left), (right, R_right)])
    baseline_m = float(np.linalg.norm(T_right_left[:3, 3]))
    return RectifiedPair(focal_px, cx_px, cx_px, cy_px, baseline_m, rig.left.image_size), R_left, R_right


def _common_view(cameras: list[tuple[AnyCamera, Array]]) -> tuple[float, float, float]:
    """Focal length and principal point of the widest image, of the cameras' size, that both fill without an empty corner."""
    bounds = np.array([_inner_bounds(camera, R) for camera, R in cameras])
    x0, y0 = bounds[:, 0].max(axis=0)
    x1, y1 = bounds[:, 1].min(axis=0)
    if not (x1 > x0 and y1 > y0):
        raise CalibrationError("the cameras share no field of view after rectification: check the rotation and the focal lengths")
    width, height = cameras[0][0].image_size
    focal_px = max((width - 1) / (x1 - x0), (height - 1) / (y1 - y0))
    return focal_px, (width - 1) / 2 - focal_px * (x0 + x1) / 2, (height - 1) / 2 - focal_px * (y0 + y1) / 2


def _inner_bounds(camera: AnyCamera, R: Array) -> Array:
    """((x0, y0), (x1, y1)) slopes of the largest upright rectangle found inside the camera's rectified outline."""
    width, height = camera.image_size
    along = np.linspace(0, 1, BORDER_STEPS)[:, None]
    center = np.array([(width - 1) / 2, (height - 1) / 2])
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    edges = [_outermost(camera, R, center, corners[i] + along * (corners[(i + 1) % 4] - corners[i])) for i in range(4)]
    top, right, bottom, left = edges
    return np.array([[left[:, 0].max(), top[:, 1].max()], [right[:, 0].min(), bottom[:, 1].min()]])


def _outermost(camera: AnyCamera, R: Array, center: Array, border: Array) -> Array:
    """(n, 2) slopes, in rectified axes, of the outermost ray on the way from the center to each border pixel.

    A lens model may reach no further (its polynomial turns back), and a fisheye sees wider than an image plane can show.
    """
    inwards = np.linspace(0, 1, BORDER_STEPS)[1:, None, None]
    pixels = center + inwards * (border - center)
    x, y, z = np.moveaxis((camera.rays(pixels.reshape(-1, 2)) @ R.T).reshape(*pixels.shape[:2], 3), 2, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = np.stack([x / z, y / z], axis=-1)
        usable = (z > 0) & (np.abs(slopes).max(axis=-1) < WIDEST_SLOPE)
    reached = np.cumprod(usable, axis=0).sum(axis=0) - 1
    if (reached < 0).any():
        raise CalibrationError(
            "a camera's lens model reaches no pixel near the middle of the image: check focal lengths and distortion"
        )
    return np.asarray(slopes[reached, np.arange(len(border))])


def _maps(camera: AnyCamera, R: Array, pair: RectifiedPair) -> RemapTables:
    if isinstance(camera, CameraInWater):
        return _maps_in_water(camera, R, pair)
    build = cv2.fisheye.initUndistortRectifyMap if camera.model == "fisheye" else cv2.initUndistortRectifyMap
    table, fraction = build(camera.K, camera.distortion, R, pair.P_left, camera.image_size, cv2.CV_16SC2)
    return table, fraction


def _maps_in_water(camera: CameraInWater, R: Array, pair: RectifiedPair) -> RemapTables:
    width, height = pair.image_size
    where = np.empty((height, width, 2), dtype=np.float32)
    x = (np.arange(width) - pair.cx_left_px) / pair.focal_px
    for row in range(height):
        y = (row - pair.cy_px) / pair.focal_px
        directions = np.column_stack([x, np.full(width, y), np.ones(width)]) @ R
        where[row] = np.nan_to_num(camera.project(directions), nan=-1e4)
    table, fraction = cv2.convertMaps(where, None, cv2.CV_16SC2)
    return table, fraction


def _remap(image: Image, maps: RemapTables | None, image_size: tuple[int, int], side: str) -> Image:
    height, width = image.shape[:2]
    if (width, height) != image_size:
        raise CalibrationError(
            f"the {side} image is {width}x{height} px but the calibration is for {image_size[0]}x{image_size[1]}: "
            "use the calibration made at this resolution"
        )
    if maps is None:
        return image
    rectified: Image = cv2.remap(image, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return rectified
