"""The engine ``opencv``, semi-global block matching: to compare, and where numba cannot run."""

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.matching.disparity import FIXED_UNIQUENESS, MatchedDisparity
from stereo_seecolor.matching.gray import Gray, GrayPair
from stereo_seecolor.records import StereoFrame

BLOCK = 3
"""Side of a block, pixels."""
P1, P2 = 8, 32
"""Penalties per pixel of a block, from OpenCV's examples for one channel."""
UNIQUENESS_PERCENT = 10
"""Least excess of the second best cost over the best."""
LEFT_RIGHT_PX = 1
"""Largest difference in the left-right check."""


class OpenCvMatching:
    """The engine ``opencv``: three-way cv2.StereoSGBM over disparities lowest..highest, pixels."""

    refined = False

    def __init__(self, lowest: int, highest: int) -> None:
        self._lowest = lowest
        self._count = -(-(highest - lowest + 1) // 16) * 16
        self._beyond = max(0, lowest + self._count)

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """Find the disparities of a pair, in sixteenths of a pixel."""
        area = BLOCK**2
        matcher = cv2.StereoSGBM.create(
            minDisparity=self._lowest,
            numDisparities=self._count,
            blockSize=BLOCK,
            P1=P1 * area,
            P2=P2 * area,
            disp12MaxDiff=LEFT_RIGHT_PX,
            uniquenessRatio=UNIQUENESS_PERCENT,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )
        fixed = matcher.compute(self._padded(pair.left), self._padded(pair.right))[
            :, self._beyond :
        ]
        found = np.where(
            fixed >= 16 * self._lowest, fixed / np.float32(16), np.float32(np.nan)
        ).astype(np.float32)
        found = np.ascontiguousarray(found)
        return MatchedDisparity(found, found, np.full_like(found, FIXED_UNIQUENESS))

    def _padded(self, image: Gray) -> NDArray[np.uint8]:
        """8 bits, and wider on the left: OpenCV matches nothing nearer to that side than its
        largest disparity.
        """
        eight = cv2.convertScaleAbs(image, alpha=1 / 256)
        wider: NDArray[np.uint8] = cv2.copyMakeBorder(
            eight, 0, 0, self._beyond, 0, cv2.BORDER_REPLICATE
        )
        return wider
