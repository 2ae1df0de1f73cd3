"""Geometry of a rectified pair: disparity, depth, range and points, converted into each other.

Axes of the rectified left camera: x right, y down, z forward. ``depth_m`` is Z, the distance along the optical axis;
``range_m`` is the distance along the ray, which is what water acts on. NaN is unknown and stays NaN.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """The pinhole geometry that both rectified images share.

    focal_px: focal length; cx_left_px, cx_right_px, cy_px: principal points; baseline_m: distance of the optical centers;
    image_size: (width, height). quarter_turns: 0..3, counterclockwise turns that bring the images that are matched, whose
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
        return np.array([[self.focal_px, 0, self.cx_left_px], [0, self.focal_px, self.cy_px], [0, 0, 1]], dtype=np.float64)

    def turned(self, turns: int) -> "RectifiedPair":
        """The geometry of these images turned counterclockwise by ``turns`` quarters; disparities keep their meaning."""
        width, height = self.image_size
        focal_px, cx, cy, shift_px = self.focal_px, self.cx_left_px, self.cy_px, self.cx_left_px - self.cx_right_px
        for _ in range(turns % 4):
            cx, cy, width, height = cy, width - 1 - cx, height, width
        cx_right_px = cx - shift_px if turns % 4 else self.cx_right_px
        quarter_turns = (self.quarter_turns + turns) % 4
        return RectifiedPair(focal_px, cx, cx_right_px, cy, self.baseline_m, (width, height), quarter_turns)

    @cached_property
    def ray_length(self) -> Map:
        """The ratio range_m / depth_m of each pixel of the left image: (H, W), at least 1."""
        width, height = self.image_size
        x = ((np.arange(width) - self.cx_left_px) / self.focal_px)[None, :]
        y = ((np.arange(height) - self.cy_px) / self.focal_px)[:, None]
        lengths = np.empty((height, width), np.float32)
        for row in range(height):  # one by one: sums of whole images in double precision are four times the result
            lengths[row] = np.sqrt(1 + x[0] ** 2 + y[row] ** 2)
        return lengths

    def depth_from_disparity(self, disparity: Map) -> Map:
        """Compute Z = f B / (d - (cx_left - cx_right)), meters; NaN where the disparity is unknown or at or beyond infinity."""
        shifted = disparity - np.float32(self.cx_left_px - self.cx_right_px)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth_m = np.float32(self.focal_px * self.baseline_m) / shifted
        return np.where(shifted > 0, depth_m, np.float32(np.nan)).astype(np.float32)

    def disparity_from_depth(self, depth_m: Map) -> Map:
        """Compute d = f B / Z + (cx_left - cx_right), pixels; NaN where the depth is unknown."""
        shift_px = np.float32(self.cx_left_px - self.cx_right_px)
        return (np.float32(self.focal_px * self.baseline_m) / depth_m + shift_px).astype(np.float32)

    def range_from_depth(self, depth_m: Map) -> Map:
        """Compute the distance along the ray from Z; both (H, W) meters."""
        return depth_m * self.ray_length

    def depth_from_range(self, range_m: Map) -> Map:
        """Compute Z from the distance along the ray; both (H, W) meters."""
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
        """Compute points in the rectified left camera: (H, W, 3) meters, NaN where the range is unknown."""
        return np.asarray(self.rays * range_m[..., None])
