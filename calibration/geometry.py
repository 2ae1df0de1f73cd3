"""Geometry of a rectified pair: disparity and range, rigid transforms, and what each camera
sees.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.refraction import CameraInWater
from calibration.rig import MAX_IMAGE_SIDE_PX, Camera, quarter_turns_of

# Geometry of a rectified pair: disparity, depth, range and points, converted into each other.
#
# Axes of the rectified left camera: x right, y down, z forward. ``depth_m`` is Z, the distance
# along the optical axis; ``range_m`` is the distance along the ray, which is what water acts on.
# NaN is unknown and stays NaN.

Map = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """The pinhole geometry that both rectified images share.

    Attributes:
        focal_px: Focal length, pixels.
        cx_left_px: Principal point of the left image along x, pixels.
        cx_right_px: The same of the right image.
        cy_px: Principal point of both along y, pixels.
        baseline_m: Distance of the optical centers, meters.
        image_size: (width, height), pixels.
        quarter_turns: 0..3, counterclockwise turns that bring the images that are matched, whose
            disparity runs along x, to the images that this geometry is of (``numpy.rot90``).
    """

    focal_px: float
    cx_left_px: float
    cx_right_px: float
    cy_px: float
    baseline_m: float
    image_size: tuple[int, int]
    quarter_turns: int = 0

    def __reduce__(self) -> tuple[type["RectifiedPair"], tuple[object, ...]]:
        """Without the tables computed from it, which are larger than the images."""
        return RectifiedPair, tuple(getattr(self, field.name) for field in fields(self))

    @property
    def P_left(self) -> NDArray[np.float64]:
        """Projection (3, 3) of the rectified left camera: pixel = P_left @ (x, y, z) / z."""
        return np.array(
            [[self.focal_px, 0, self.cx_left_px], [0, self.focal_px, self.cy_px], [0, 0, 1]],
            dtype=np.float64,
        )

    def turned(self, turns: int) -> "RectifiedPair":
        """The geometry of these images turned counterclockwise; disparities keep their meaning.

        Args:
            turns: Quarter turns.

        Returns:
            The geometry.
        """
        width, height = self.image_size
        focal_px, cx, cy, shift_px = (
            self.focal_px,
            self.cx_left_px,
            self.cy_px,
            self.cx_left_px - self.cx_right_px,
        )
        for _ in range(turns % 4):
            cx, cy, width, height = cy, width - 1 - cx, height, width
        cx_right_px = cx - shift_px if turns % 4 else self.cx_right_px
        quarter_turns = (self.quarter_turns + turns) % 4
        return RectifiedPair(
            focal_px, cx, cx_right_px, cy, self.baseline_m, (width, height), quarter_turns
        )

    def outside_right(self, range_m: Map) -> NDArray[np.bool_]:
        """Where the right image does not reach what the left one shows.

        Args:
            range_m: (H, W), meters along the ray of the left camera; NaN where unknown.

        Returns:
            (H, W) bool; False where the range is unknown.
        """
        disparity = self.disparity_from_depth(self.depth_from_range(range_m))
        along = np.rot90(disparity, -self.quarter_turns)  # as matched: disparity runs along x
        right_x = np.arange(along.shape[1], dtype=np.float32) - along
        return np.rot90((right_x < 0) | (right_x > along.shape[1] - 1), self.quarter_turns)

    @cached_property
    def ray_length(self) -> Map:
        """The ratio range_m / depth_m of each pixel of the left image: (H, W), at least 1."""
        width, height = self.image_size
        x = ((np.arange(width) - self.cx_left_px) / self.focal_px)[None, :]
        y = ((np.arange(height) - self.cy_px) / self.focal_px)[:, None]
        lengths = np.empty((height, width), np.float32)
        # one by one: sums of whole images in double precision are four times the result
        for row in range(height):
            lengths[row] = np.sqrt(1 + x[0] ** 2 + y[row] ** 2)
        return lengths

    def depth_from_disparity(self, disparity: Map) -> Map:
        """Compute Z = f B / (d - (cx_left - cx_right)).

        Args:
            disparity: (H, W) float32, pixels.

        Returns:
            (H, W) float32, meters; NaN where the disparity is unknown, or at or beyond infinity.
        """
        shifted = disparity - np.float32(self.cx_left_px - self.cx_right_px)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth_m = np.float32(self.focal_px * self.baseline_m) / shifted
        return np.where(shifted > 0, depth_m, np.float32(np.nan)).astype(np.float32)

    def disparity_from_depth(self, depth_m: Map) -> Map:
        """Compute d = f B / Z + (cx_left - cx_right).

        Args:
            depth_m: (H, W) float32, meters.

        Returns:
            (H, W) float32, pixels; NaN where the depth is unknown.
        """
        shift_px = np.float32(self.cx_left_px - self.cx_right_px)
        return (np.float32(self.focal_px * self.baseline_m) / depth_m + shift_px).astype(np.float32)

    def range_from_depth(self, depth_m: Map) -> Map:
        """Compute the distance along the ray from Z.

        Args:
            depth_m: (H, W) float32, meters.

        Returns:
            (H, W) float32, meters.
        """
        return depth_m * self.ray_length

    def depth_from_range(self, range_m: Map) -> Map:
        """Compute Z from the distance along the ray.

        Args:
            range_m: (H, W) float32, meters.

        Returns:
            (H, W) float32, meters.
        """
        return range_m / self.ray_length

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        """The unit vector along each pixel's ray in the rectified left camera: (H, W, 3)."""
        width, height = self.image_size
        x = ((np.arange(width) - self.cx_left_px) / self.focal_px)[None, :]
        y = ((np.arange(height) - self.cy_px) / self.focal_px)[:, None]
        rays = np.empty((height, width, 3), np.float32)
        for row in range(height):  # as in ray_length
            directions = np.stack(np.broadcast_arrays(x[0], y[row], 1.0), axis=-1)
            rays[row] = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        return rays

    def points_from_range(self, range_m: Map) -> NDArray[np.float32]:
        """Compute points in the axes of the rectified left camera.

        Args:
            range_m: (H, W) float32, meters along the ray.

        Returns:
            (H, W, 3) float32, meters; NaN where the range is unknown.
        """
        return np.asarray(self.rays * range_m[..., None])


# Rigid transforms as (4, 4) matrices: p_target = T_target_source @ p_source.

Array = NDArray[np.float64]


def rigid(R: Array, translation: Array) -> Array:
    """Make the (4, 4) transform of a rotation (3, 3) and a translation of three numbers."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = np.ravel(translation)
    return T


def rotation_of_quaternion(xyzw: Array) -> Array:
    """The rotation (3, 3) of a quaternion, w last, of any length; NaN for one of length zero."""
    x, y, z, w = xyzw / (np.linalg.norm(xyzw) or np.nan)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * (w * cross + cross @ cross))


def inverse_transform(T: Array) -> Array:
    """The inverse of a rigid transform (4, 4)."""
    return rigid(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


# Limits of the rectified image: the directions that a camera sees, in rectified axes.

AnyCamera = Camera | CameraInWater


@dataclass(frozen=True)
class ViewLimits:
    """Decides how much of a view the rectified image shows."""

    # tan of 63 degrees: a pinhole image of more spends its pixels on the rim
    widest_slope: float = 2.0
    # points along each edge of the raw image, and from its center to each: smooth lenses need no
    # more
    border_steps: int = 33
    # a whole view turned by 45 degrees takes 2.04 times a 4:3 image; more is a wide lens's rim
    max_area_ratio: float = 3.0


LIMITS = ViewLimits()


@dataclass(frozen=True)
class View:
    """A pinhole image: focal_px, principal point cx_px and cy_px, image_size (width, height)."""

    focal_px: float
    cx_px: float
    cy_px: float
    image_size: tuple[int, int]


def common_view(cameras: list[tuple[AnyCamera, Array]]) -> View:
    """The widest image, of the cameras' size, that all fill without an empty corner.

    cameras: each with its rotation (3, 3) into rectified axes. Raises CalibrationError if they
    share no field of view.
    """
    bounds = np.array([_inner_bounds(camera, R) for camera, R in cameras])
    x0, y0 = bounds[:, 0].max(axis=0)
    x1, y1 = bounds[:, 1].min(axis=0)
    if not (x1 > x0 and y1 > y0):
        raise CalibrationError(
            "the cameras share no field of view after rectification: check the rotation and the "
            "focal lengths"
        )
    width, height = cameras[0][0].image_size
    focal_px = max((width - 1) / (x1 - x0), (height - 1) / (y1 - y0))
    cx_px, cy_px = (
        (width - 1) / 2 - focal_px * (x0 + x1) / 2,
        (height - 1) / 2 - focal_px * (y0 + y1) / 2,
    )
    return View(focal_px, cx_px, cy_px, (width, height))


def whole_view(left: tuple[AnyCamera, Array], right: tuple[AnyCamera, Array], along: int) -> View:
    """The image that shows all that the left camera sees, as fine as the raw one, with empty
    corners.

    along: the axis (0 = x, 1 = y) of the baseline; along it the right camera's view is shown too,
    where its matches lie.
    """
    low, high = _outer_bounds(*left)
    low_right, high_right = _outer_bounds(*right)
    low[along], high[along] = min(low[along], low_right[along]), max(high[along], high_right[along])
    focal_px = _central_focal_px(left[0])
    width, height = left[0].image_size
    extent = focal_px * (high - low)
    shrink = min(
        1.0,
        (MAX_IMAGE_SIDE_PX - 1) / extent.max(),
        np.sqrt(LIMITS.max_area_ratio * width * height / extent.prod()),
    )
    focal_px *= float(shrink)
    size = (np.ceil(focal_px * (high - low)) + 1).astype(int).tolist()
    cx_px, cy_px = (-focal_px * low).tolist()
    return View(focal_px, cx_px, cy_px, (size[0], size[1]))


def _inner_bounds(camera: AnyCamera, R: Array) -> Array:
    """((x0, y0), (x1, y1)) slopes of the largest upright rectangle found inside the camera's
    rectified outline.
    """
    edges = _edges(camera, R)
    # a camera turned by a quarter has its top edge at the right of the rectified view
    turns = quarter_turns_of(R)
    top, right, bottom, left = [edges[(i - turns) % 4] for i in range(4)]
    return np.array([[left[:, 0].max(), top[:, 1].max()], [right[:, 0].min(), bottom[:, 1].min()]])


def _outer_bounds(camera: AnyCamera, R: Array) -> tuple[Array, Array]:
    """(2,) least and (2,) largest slopes of the camera's rectified outline."""
    outline = np.concatenate(_edges(camera, R))
    return outline.min(axis=0), outline.max(axis=0)


def _edges(camera: AnyCamera, R: Array) -> list[Array]:
    """(n, 2) slopes of the top, right, bottom and left edge of the raw image."""
    width, height = camera.image_size
    along = np.linspace(0, 1, LIMITS.border_steps)[:, None]
    center = np.array([(width - 1) / 2, (height - 1) / 2])
    corners = np.array(
        [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64
    )
    return [
        _outermost(camera, R, center, corners[i] + along * (corners[(i + 1) % 4] - corners[i]))
        for i in range(4)
    ]


def _outermost(camera: AnyCamera, R: Array, center: Array, border: Array) -> Array:
    """(n, 2) slopes, in rectified axes, of the outermost ray on the way from the center to each
    border pixel.

    A lens model may reach no further (its polynomial turns back), and a fisheye sees wider than an
    image plane can show.
    """
    inwards = np.linspace(0, 1, LIMITS.border_steps)[1:, None, None]
    pixels = center + inwards * (border - center)
    x, y, z = np.moveaxis(
        (camera.rays(pixels.reshape(-1, 2)) @ R.T).reshape(*pixels.shape[:2], 3), 2, 0
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = np.stack([x / z, y / z], axis=-1)
        usable = (z > 0) & (np.abs(slopes).max(axis=-1) < LIMITS.widest_slope)
    reached = np.cumprod(usable, axis=0).sum(axis=0) - 1
    if (reached < 0).any():
        raise CalibrationError(
            "a camera's lens model reaches no pixel near the middle of the image: check focal "
            "lengths and distortion"
        )
    return np.asarray(slopes[reached, np.arange(len(border))])


def _central_focal_px(camera: AnyCamera) -> float:
    """Pixels a unit of slope at the middle of the raw image."""
    width, height = camera.image_size
    center = np.array([(width - 1) / 2, (height - 1) / 2])
    step = camera.rays(center + np.array([[-1.0, -1.0], [1.0, 1.0]]))[:, :2]
    return float(np.sqrt(8) / np.linalg.norm(step[1] - step[0]))
