"""Images cropped from the middle of those that were calibrated and enlarged to their size: a video
mode, or a crop resized back.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.field_checks.matches import explain
from calibration.rectification import plan_rectification, raw_points
from calibration.rig import Camera, StereoRig

Array = NDArray[np.float64]
FACTORS = np.exp(np.arange(np.log(1.06), np.log(2.5), 0.03))
"""Below, rows tell too little; stabilized video keeps 0.8 to 0.9 of each side, and narrow modes of
action cameras a half.
"""
MOST_MATCHES = 800  # spread evenly: more cost time, and tell the same


@dataclass(frozen=True)
class Enlargement:
    """The factor, 1 = none, that explains rows best beside a movement of a camera; and what both
    leave, pixels, median.
    """

    factor: float = 1.0
    unexplained_px: float = np.inf


NOT_ENLARGED = Enlargement()


def best_enlargement(rig: StereoRig, left: Array, right: Array) -> Enlargement:
    """Find the enlargement that explains matches (n, 2) in the images that are matched.

    An enlarged image has a longer focal length, and its lens bends less toward the corners. The
    former alone looks like a camera that has moved, so each factor is judged after the offset,
    scale and roll that suit it best: the lens's distortion is the evidence, and without any there
    is none.
    """
    step = -(-len(left) // MOST_MATCHES)
    raw, plan = raw_points(rig, left[::step], right[::step]), plan_rectification(rig)
    turns = plan.R_left_matching, plan.R_right_matching  # of the enlarged rigs, too
    tried = [
        (_unexplained_px(enlarged(rig, factor), turns, raw), factor)
        for factor in map(float, FACTORS)
    ]
    unexplained_px, factor = min(tried)
    return Enlargement(factor, unexplained_px)


def enlarged(rig: StereoRig, factor: float) -> StereoRig:
    """The rig of images of which the middle was enlarged by a factor, to the size that they had."""
    return replace(
        rig, left=_enlarged(rig.left, factor), right=_enlarged(rig.right, factor), alternatives=()
    )


def _enlarged(camera: Camera, factor: float) -> Camera:
    K, middle = camera.K.copy(), (np.array(camera.image_size) - 1) / 2
    K[:2, :2] *= factor
    K[:2, 2] = middle + factor * (K[:2, 2] - middle)
    return replace(camera, K=K)


def _unexplained_px(rig: StereoRig, turns: tuple[Array, Array], raw: tuple[Array, Array]) -> float:
    """Median vertical disparity of the rig in raw matches, in pixels of its left camera, with the
    movement of a camera that suits it best.

    turns: rotations (3, 3) of the left and right camera into the axes of the images that are
    matched.
    """
    left, right = (
        rig.left.K[0, 0] * _slopes(camera, R, pixels)
        for camera, R, pixels in zip((rig.left, rig.right), turns, raw, strict=True)
    )
    seen = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    if not seen.any():
        return float(np.inf)
    _, rest = explain(right[seen, 1] - left[seen, 1], left[seen])
    return float(np.median(np.abs(rest)))


def _slopes(camera: Camera, R: Array, pixels: Array) -> Array:
    """(n, 2) slopes of pixels' rays in axes that the camera is turned into."""
    rays = camera.rays(pixels) @ R.T
    return np.asarray(rays[:, :2] / rays[:, 2:])
