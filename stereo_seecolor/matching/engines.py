"""Other engines: a user's own stereo network, and OpenCV's block matching."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import ConfigError, DeviceError, MatchingError
from stereo_seecolor.matching.disparity import FIXED_UNIQUENESS, UNKNOWN, MatchedDisparity
from stereo_seecolor.matching.gray import Gray, GrayPair
from stereo_seecolor.records import Image, Map, StereoFrame

# A user's own stereo network in place of semi-global matching (``matching.engine: NET.onnx``).

LEFT_RIGHT_PX = 1.0
"""Largest difference between a disparity and that of the pixel of the right image that it meets, as
in the other engines.
"""


class Network:
    """The engine ``onnx``: an ONNX model: inputs ``left`` and ``right``, output ``disparity``.

    left, right: float32 (1, 3, H, W), RGB, 0..1, rectified, at full size. disparity: float32 (1, 1,
    H, W) or (1, H, W), pixels of the left image, x_left - x_right. The model must take the size of
    the rectified images: export it with free H and W.
    """

    refined = True

    def __init__(self, model: Path) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise DeviceError(
                f"matching.engine: {model} needs onnxruntime: pip install 'stereo-seecolor[onnx]'"
            ) from error
        try:
            self._session: Any = onnxruntime.InferenceSession(
                str(model), providers=onnxruntime.get_available_providers()
            )
        except Exception as error:  # onnxruntime's own exceptions share no public base
            raise ConfigError(
                f"matching.engine: {model} cannot be loaded: {' '.join(str(error).split())[:200]}"
            ) from error
        names = sorted(i.name for i in self._session.get_inputs())
        if names != ["left", "right"] or "disparity" not in [
            o.name for o in self._session.get_outputs()
        ]:
            raise ConfigError(
                f"matching.engine: {model} must take 'left' and 'right' and give 'disparity', it "
                f"takes {names}"
            )

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """Run the network on a pair, and check its disparities against those of the mirrored
        pair.
        """
        disparity = self.disparity(frame.left, frame.right)
        back = self.disparity(frame.right[:, ::-1], frame.left[:, ::-1])[:, ::-1]
        width = disparity.shape[1]
        met = np.rint(np.arange(width, dtype=np.float32) - disparity)
        other = np.take_along_axis(back, np.clip(met, 0, width - 1).astype(np.int64), axis=1)
        agree = (met >= 0) & (met < width) & (np.abs(other - disparity) <= LEFT_RIGHT_PX)
        checked = np.where(agree, disparity, UNKNOWN)
        return MatchedDisparity(checked, checked, np.full_like(disparity, FIXED_UNIQUENESS))

    def disparity(self, left: Image, right: Image) -> Map:
        """Run the network on two images; return the disparity of the left one as the network gives
        it: (H, W).
        """
        try:
            (found,) = self._session.run(
                ["disparity"], {"left": _tensor(left), "right": _tensor(right)}
            )
        except Exception as error:
            raise MatchingError(
                "the network of matching.engine failed on this pair: "
                f"{' '.join(str(error).split())[:200]}"
            ) from error
        disparity = np.asarray(found, dtype=np.float32).squeeze()
        if disparity.shape != left.shape[:2]:
            raise MatchingError(
                f"the network gave a disparity of shape {disparity.shape} for an image of "
                f"{left.shape[:2]}"
            )
        return disparity.copy()


def _tensor(image: Image) -> Any:
    scale = np.float32(1 / np.iinfo(image.dtype).max)
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None], dtype=np.float32) * scale


# OpenCV's semi-global block matching (``matching.engine: opencv``): for comparison, and where
# numba cannot run.


@dataclass(frozen=True)
class BlockMatchingConstants:
    """Parameters of cv2.StereoSGBM.

    block: side of a block, pixels. p1, p2: penalties per pixel of a block, those of OpenCV's own
    examples for one channel.
    uniqueness_percent: by how much the second best must be worse. left_right_px: how far the right
    image may disagree.
    """

    block: int = 3
    p1: int = 8
    p2: int = 32
    uniqueness_percent: int = 10
    left_right_px: int = 1


CONSTANTS = BlockMatchingConstants()


class OpenCvMatching:
    """The engine ``opencv``: cv2.StereoSGBM in its three-way mode over the disparities
    lowest..highest, pixels.
    """

    refined = False

    def __init__(self, lowest: int, highest: int) -> None:
        self._lowest = lowest
        self._count = -(-(highest - lowest + 1) // 16) * 16
        self._beyond = max(0, lowest + self._count)

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """Find the disparities of a pair, in sixteenths of a pixel."""
        area = CONSTANTS.block**2
        matcher = cv2.StereoSGBM.create(
            minDisparity=self._lowest,
            numDisparities=self._count,
            blockSize=CONSTANTS.block,
            P1=CONSTANTS.p1 * area,
            P2=CONSTANTS.p2 * area,
            disp12MaxDiff=CONSTANTS.left_right_px,
            uniquenessRatio=CONSTANTS.uniqueness_percent,
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
