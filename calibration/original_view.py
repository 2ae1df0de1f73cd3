"""Maps from the rectified left image back to the left camera's own pixels."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.rectification import Rectification
from calibration.refraction import cameras_in_water
from calibration.rig import StereoRig

Map = NDArray[np.float32]


ONE_SURFACE = 0.01
"""Relative standard deviation of the four ranges around a point, up to which they are of one
surface: slopes of 80 degrees have 0.006.
"""


@dataclass(frozen=True, eq=False)
class OriginalView:
    """The position of each pixel of the raw left image in the upright rectified one.

    x, y: (H, W) float32 pixels of the rectified image; far outside where no ray of the lens leads
    there.
    The rectified camera has the center of the raw one (behind a flat port, the center that stands
    for it), so that a range along a ray is the same number in both.
    """

    x: Map
    y: Map

    @classmethod
    def from_rig(cls, rig: StereoRig) -> "OriginalView":
        """Built once for a run."""
        rectification = Rectification.from_rig(rig)
        pair, camera = rectification.pair, cameras_in_water(rig)[0]
        width, height = rig.left.image_size
        where = np.empty((2, height, width), np.float32)
        for row in range(height):
            pixels = np.column_stack(
                [np.arange(width, dtype=np.float64), np.full(width, float(row))]
            )
            x, y, z = (camera.rays(pixels) @ rectification.R_left.T).T
            with np.errstate(divide="ignore", invalid="ignore"):
                seen = z > 0
                where[0, row] = np.where(seen, x / z * pair.focal_px + pair.cx_left_px, -1e4)
                where[1, row] = np.where(seen, y / z * pair.focal_px + pair.cy_px, -1e4)
        return cls(*where)

    def ranges(self, range_m: Map) -> Map:
        """Resample ranges to the raw pixels: (H, W) float32, NaN where unknown or not in the
        rectified image.

        The mean of the four neighbors where they are of one surface, else the nearest one's: no
        range is made up between two.
        """
        nearest = self._remap(range_m, cv2.INTER_NEAREST, np.nan)
        mean = self._remap(range_m, cv2.INTER_LINEAR, np.nan)
        variance = self._remap(range_m**2, cv2.INTER_LINEAR, np.nan) - mean**2
        with np.errstate(invalid="ignore"):
            return np.where(variance < (ONE_SURFACE * mean) ** 2, mean, nearest).astype(np.float32)

    def mask(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Resample a mask to the raw pixels: (H, W), False outside of the rectified image."""
        return self._remap(mask.astype(np.uint8), cv2.INTER_NEAREST, 0).astype(np.bool_)

    def smooth(self, values: Map) -> Map:
        """Resample smooth values to the raw pixels: (H, W), the border repeated beyond it."""
        return np.asarray(
            cv2.remap(values, self.x, self.y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
            np.float32,
        )

    def _remap(self, values: NDArray[Any], interpolation: int, outside: float) -> NDArray[Any]:
        moved = cv2.remap(
            values,
            self.x,
            self.y,
            interpolation,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=outside,
        )
        return np.asarray(moved)
