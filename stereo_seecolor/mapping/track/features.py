"""What a frame can be recognized by: points with a description, and where they lie in the camera, in meters."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.records import SurveyFrame

MAX_FEATURES = 2000
MAX_WIDTH_PX = 960
WINDOW_PX = 9
"""Ranges are averaged over so wide a window, which their errors are about as wide as."""
FILL_PX = (9, 33, 129, 513)
LATERAL_STD_PX = 0.3
"""How well SIFT finds the same point again."""


@dataclass(frozen=True, eq=False)
class Features:
    """pixels: (n, 2) float64. points_m: (n, 3) in the camera. covariance_m2: (n, 3, 3). descriptors: (n, 128) uint8."""

    pixels: NDArray[np.float64]
    points_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    descriptors: NDArray[np.uint8]

    @classmethod
    def none(cls) -> "Features":
        """Of a frame that shows nothing."""
        return cls(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 128), np.uint8))


def detect(frame: SurveyFrame, pair: RectifiedPair) -> Features:
    """SIFT (Lowe 2004) on the locally equalized gray image, kept where the range is measured and smooth all around."""
    gray = _gray(frame.color)
    scale = min(1.0, MAX_WIDTH_PX / gray.shape[1])
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    gray = cv2.createCLAHE(clipLimit=4.0, tileGridSize=(8, 8)).apply(gray)
    range_m, std_m, usable = _smooth_range(frame)
    mask = cv2.resize(usable.astype(np.uint8), gray.shape[::-1], interpolation=cv2.INTER_NEAREST)
    sift = cv2.SIFT.create(nfeatures=MAX_FEATURES, contrastThreshold=0.01)
    keypoints, descriptors = sift.detectAndCompute(gray, mask)
    if not keypoints:
        return Features.none()
    pixels = (np.array([k.pt for k in keypoints], dtype=np.float64) + 0.5) / scale - 0.5
    columns, rows = np.clip(np.rint(pixels).astype(int), 0, np.array(frame.range_m.shape[::-1]) - 1).T
    good = usable[rows, columns]
    pixels, rows, columns = pixels[good], rows[good], columns[good]
    rays = np.stack(
        [(pixels[:, 0] - pair.cx_left_px) / pair.focal_px, (pixels[:, 1] - pair.cy_px) / pair.focal_px, np.ones(len(pixels))],
        axis=-1,
    )
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distance_m = range_m[rows, columns].astype(np.float64)
    along, across = std_m[rows, columns].astype(np.float64) ** 2, (distance_m * LATERAL_STD_PX / (pair.focal_px * scale)) ** 2
    outer = rays[:, :, None] * rays[:, None, :]
    covariance = across[:, None, None] * (np.eye(3) - outer) + along[:, None, None] * outer
    return Features(pixels, rays * distance_m[:, None], covariance, np.rint(descriptors[good]).astype(np.uint8))


def _gray(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Gray, with what was painted black for want of a range filled in smoothly: its rim is no thing on the bottom."""
    gray: NDArray[np.uint8] = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    known = (gray > 0).astype(np.float32)
    filled = gray.astype(np.float32)
    for width in FILL_PX:
        share = cv2.blur(known, (width, width))
        mean = cv2.blur(filled * known, (width, width)) / np.maximum(share, 1e-6)
        filled = np.where((known == 0) & (share > 0.02), mean, filled)
        known = np.where(share > 0.02, np.float32(1), known)
        if known.all():
            break
    return np.rint(filled).astype(np.uint8)


def _smooth_range(frame: SurveyFrame) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Mean range of a window, its standard error, and where the window is measured and holds no edge, such as a fish's."""
    known = np.isfinite(frame.range_m) & (frame.confidence > 0)
    filled = np.where(known, frame.range_m, 0).astype(np.float32)
    window = (WINDOW_PX, WINDOW_PX)
    share = cv2.blur(known.astype(np.float32), window)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = cv2.blur(filled, window) / share
        spread = np.sqrt(np.maximum(cv2.blur(filled * filled, window) / share - mean**2, 0))
    std_m = np.where(np.isfinite(frame.range_std_m), frame.range_std_m, 0.01 * mean)
    usable = known & (share > 0.6) & (spread < 3 * std_m + 0.005 * mean)
    return mean.astype(np.float32), std_m.astype(np.float32), usable
