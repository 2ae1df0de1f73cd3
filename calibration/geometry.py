"""Geometry of a rectified pair: disparity, depth, range and points, converted into each other.

Axes of the rectified left camera: x right, y down, z forward. ``depth_m`` is Z, the distance along
the optical axis; ``range_m`` is the distance along the ray, which is what water acts on. NaN is
unknown and stays NaN.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Map = NDArray[np.float32]

DISPARITY_STD_PX = 0.1
"""Standard error of a disparity, pixels: the matcher's median on the sample dive is 0.09."""


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """The pinhole geometry that both rectified images share.

    Attributes:
        focal_px: Focal length, pixels.
        cx_left_px: Principal point of the left image along x, pixels.
        cx_right_px: The same of the right image.
        cy_px: Principal point of both along y, pixels.
        baseline_m: Distance between the optical centers, meters.
        image_size: (width, height), pixels.
        quarter_turns: 0..3, counterclockwise turns that bring the images that are matched, whose
            disparity runs along x, to the images that this geometry is of (``numpy.rot90``).
        slope_std: Standard errors of the disparity's slopes along and across the baseline that the
            rig's refinement left, pixels a pixel.
    """

    focal_px: float
    cx_left_px: float
    cx_right_px: float
    cy_px: float
    baseline_m: float
    image_size: tuple[int, int]
    quarter_turns: int = 0
    slope_std: tuple[float, float] = (0.0, 0.0)

    def __reduce__(self) -> tuple[type["RectifiedPair"], tuple[object, ...]]:
        """Without the tables computed from it, which are larger than the images."""
        return RectifiedPair, tuple(getattr(self, field.name) for field in fields(self))

    @property
    def P_left(self) -> NDArray[np.float64]:
        """Projection (3, 3) of the rectified left camera: pixel = P_left @ (x, y, z) / z."""
        return camera_matrix(self.focal_px, self.focal_px, self.cx_left_px, self.cy_px)

    def turned(self, turns: int) -> "RectifiedPair":
        """The geometry of these images turned counterclockwise; disparities keep their meaning.

        Args:
            turns: Quarter turns.

        Returns:
            The geometry.
        """
        width, height = self.image_size
        cx, cy = self.cx_left_px, self.cy_px
        shift_px = self.cx_left_px - self.cx_right_px
        for _ in range(turns % 4):
            cx, cy, width, height = cy, width - 1 - cx, height, width
        cx_right_px = cx - shift_px if turns % 4 else self.cx_right_px
        quarter_turns = (self.quarter_turns + turns) % 4
        return replace(
            self,
            cx_left_px=cx,
            cx_right_px=cx_right_px,
            cy_px=cy,
            image_size=(width, height),
            quarter_turns=quarter_turns,
        )

    def outside_right(self, range_m: Map) -> NDArray[np.bool_]:
        """Compute which pixels of the left image are outside the field of view of the right camera.

        Args:
            range_m: (H, W), meters along the ray of the left camera; NaN where unknown.

        Returns:
            (H, W) bool; False where the range is unknown.
        """
        disparity = self.disparity_from_depth(self.depth_from_range(range_m))
        along = np.rot90(disparity, -self.quarter_turns)  # as matched: disparity runs along x
        right_x = np.arange(along.shape[1], dtype=np.float32) - along
        return np.rot90((right_x < 0) | (right_x > along.shape[1] - 1), self.quarter_turns)

    @property
    def _slopes(self) -> tuple[Array, Array]:
        """x / z of each column and y / z of each row of the left image."""
        width, height = self.image_size
        x = (np.arange(width, dtype=np.float64) - self.cx_left_px) / self.focal_px
        return x, (np.arange(height, dtype=np.float64) - self.cy_px) / self.focal_px

    @cached_property
    def ray_length(self) -> Map:
        """The ratio range_m / depth_m of each pixel of the left image: (H, W), at least 1."""
        x, y = self._slopes
        lengths = np.empty((len(y), len(x)), np.float32)
        # one by one: sums of whole images in double precision are four times the result
        for row in range(len(y)):
            lengths[row] = np.sqrt(1 + x**2 + y[row] ** 2)
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
        x, y = self._slopes
        rays = np.empty((len(y), len(x), 3), np.float32)
        for row in range(len(y)):  # as in ray_length
            directions = np.stack(np.broadcast_arrays(x, y[row], 1.0), axis=-1)
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

    def project(self, points_m: Array) -> Array:
        """Compute the pixels of the left image that show points.

        Args:
            points_m: (..., 3) in the axes of the rectified left camera.

        Returns:
            (..., 2) x and y; (0, 0) is the center of the top left pixel.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = self.focal_px * points_m[..., :2] / points_m[..., 2:]
        return np.asarray(pixels + np.array([self.cx_left_px, self.cy_px]))

    def reduced(self, factor: int) -> "RectifiedPair":
        """The geometry of images in which each pixel is the mean of ``factor`` x ``factor``
        pixels, without incomplete blocks at the end.

        Args:
            factor: How many times fewer pixels along each side.

        Returns:
            The geometry.
        """
        return replace(
            self,
            focal_px=self.focal_px / factor,
            cx_left_px=(self.cx_left_px + 0.5) / factor - 0.5,
            cx_right_px=(self.cx_right_px + 0.5) / factor - 0.5,
            cy_px=(self.cy_px + 0.5) / factor - 0.5,
            image_size=(self.image_size[0] // factor, self.image_size[1] // factor),
        )

    def estimated_range_std_m(self, range_m: Map) -> Map:
        """Estimate the standard errors of ranges whose own are not known: range depth std / (f B),
        with DISPARITY_STD_PX as std.

        Args:
            range_m: (H, W) float32, meters along the ray.

        Returns:
            (H, W) float32, meters; NaN where the range is unknown.
        """
        scale = np.float32(DISPARITY_STD_PX / (self.focal_px * self.baseline_m))
        return (range_m * self.depth_from_range(range_m) * scale).astype(np.float32)


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> Array:
    """K (3, 3) of focal lengths and principal point, pixels."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float64)
