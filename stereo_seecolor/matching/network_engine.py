"""The matching engine of a user's own stereo network (``matching.engine: NET.onnx``)."""

from pathlib import Path
from typing import Any

import numpy as np

from stereo_seecolor.errors import ConfigError, MatchingError, library_for
from stereo_seecolor.matching.disparity import FIXED_UNIQUENESS, UNKNOWN, MatchedDisparity
from stereo_seecolor.matching.gray import GrayPair
from stereo_seecolor.records import Image, Map, StereoFrame

LEFT_RIGHT_PX = 1.0
"""Left-right consistency: largest difference between a disparity and that of the matching pixel of
the right image, pixels; the same as in the other engines.
"""


class Network:
    """The engine ``onnx``: an ONNX model: inputs ``left`` and ``right``, output ``disparity``.

    left, right: float32 (1, 3, H, W), RGB, 0..1, rectified, at full size. disparity: float32 (1, 1,
    H, W) or (1, H, W), pixels of the left image, x_left - x_right. The model must take the size of
    the rectified images: export it with free H and W.
    """

    refined = True

    def __init__(self, model: Path) -> None:
        with library_for(f"matching.engine: {model}", "onnx"):
            import onnxruntime
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
        """Run the network on a pair and on the mirrored pair, and check left-right consistency."""
        disparity = self.disparity(frame.left, frame.right)
        back = self.disparity(frame.right[:, ::-1], frame.left[:, ::-1])[:, ::-1]
        width = disparity.shape[1]
        met = np.rint(np.arange(width, dtype=np.float32) - disparity)
        other = np.take_along_axis(back, np.clip(met, 0, width - 1).astype(np.int64), axis=1)
        agree = (met >= 0) & (met < width) & (np.abs(other - disparity) <= LEFT_RIGHT_PX)
        checked = np.where(agree, disparity, UNKNOWN)
        return MatchedDisparity(checked, checked, np.full_like(disparity, FIXED_UNIQUENESS))

    def disparity(self, left: Image, right: Image) -> Map:
        """Run the network on two images; return the unchecked disparity of the left one: (H, W)."""
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
