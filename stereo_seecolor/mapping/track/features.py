"""What a frame can be recognized by: points with a description, and where they lie in the camera, in meters."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.records import SurveyFrame


@dataclass(frozen=True)
class FeatureSettings:
    """How features are found."""

    max_features: int = 2000  # a frame: some 300 matches remain at 60 % overlap; more only cost time
    max_width_px: int = 960  # images are reduced to it: SIFT's cost grows with the area, its accuracy hardly
    contrast: float = 0.01  # SIFT's threshold, a quarter of Lowe's 0.04: hazy frames have little contrast
    clahe_clip: float = 4.0  # contrast limit of the local equalization (OpenCV's own default is 40)
    window_px: int = 9  # ranges are averaged over it: as wide as their errors are correlated
    fill_px: tuple[int, ...] = (9, 33, 129, 513)  # widths of the means that fill in what was painted black
    lateral_std_px: float = 0.3  # how well SIFT finds a point again (measured on the synthetic reef)
    min_known: float = 0.6  # fraction of the window with a range
    max_spread_std: float = 3.0  # spread of the window's ranges, in standard errors,
    max_spread: float = 0.005  # and as a fraction of the range: more is an edge, such as a fish's
    unknown_std: float = 0.01  # standard error as a fraction of the range where it is not known


SETTINGS = FeatureSettings()


@dataclass(frozen=True, eq=False)
class Features:
    """pixels: (n, 2) float64. points_m: (n, 3) in the camera. descriptors: (n, 128) uint8.

    along_m2, across_m2: (n,) variances of the points along their rays and across them.
    """

    pixels: NDArray[np.float64]
    points_m: NDArray[np.float64]
    along_m2: NDArray[np.float64]
    across_m2: NDArray[np.float64]
    descriptors: NDArray[np.uint8]

    @classmethod
    def none(cls) -> "Features":
        """Of a frame that shows nothing."""
        return cls(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 128), np.uint8))

    def covariance_m2(self, chosen: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 3, 3) of the points chosen."""
        rays = self.points_m[chosen] / np.linalg.norm(self.points_m[chosen], axis=1, keepdims=True)
        outer = rays[:, :, None] * rays[:, None, :]
        return np.asarray(self.across_m2[chosen, None, None] * (np.eye(3) - outer) + self.along_m2[chosen, None, None] * outer)


def detect(frame: SurveyFrame, geometry: RectifiedPair) -> Features:
    """SIFT (Lowe 2004) on the locally equalized gray image, kept where the range is measured and smooth all around."""
    gray = _gray(frame.color)
    scale = min(1.0, SETTINGS.max_width_px / gray.shape[1])
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    gray = cv2.createCLAHE(clipLimit=SETTINGS.clahe_clip, tileGridSize=(8, 8)).apply(gray)
    range_m, std_m, usable = _smooth_range(frame)
    mask = cv2.resize(usable.astype(np.uint8), gray.shape[::-1], interpolation=cv2.INTER_NEAREST)
    sift = cv2.SIFT.create(nfeatures=SETTINGS.max_features, contrastThreshold=SETTINGS.contrast)
    keypoints, descriptors = sift.detectAndCompute(gray, mask)
    if not keypoints:
        return Features.none()
    pixels = (np.array([k.pt for k in keypoints], dtype=np.float64) + 0.5) / scale - 0.5
    columns, rows = np.clip(np.rint(pixels).astype(int), 0, np.array(frame.range_m.shape[::-1]) - 1).T
    good = usable[rows, columns]
    pixels, rows, columns = pixels[good], rows[good], columns[good]
    rays = np.column_stack([(pixels - [geometry.cx_left_px, geometry.cy_px]) / geometry.focal_px, np.ones(len(pixels))])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distance_m = range_m[rows, columns].astype(np.float64)
    across_m = distance_m * SETTINGS.lateral_std_px / (geometry.focal_px * scale)
    along_m = std_m[rows, columns].astype(np.float64)
    found = np.rint(descriptors[good]).astype(np.uint8)
    return Features(pixels, rays * distance_m[:, None], along_m**2, across_m**2, found)


def _gray(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Gray, with what was painted black for want of a range filled in smoothly: its rim is no thing on the bottom."""
    gray: NDArray[np.uint8] = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    known = (gray > 0).astype(np.float32)
    filled = gray.astype(np.float32)
    for width in SETTINGS.fill_px:
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
    window = (SETTINGS.window_px, SETTINGS.window_px)
    share = cv2.blur(known.astype(np.float32), window)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = cv2.blur(filled, window) / share
        spread = np.sqrt(np.maximum(cv2.blur(filled * filled, window) / share - mean**2, 0))
    std_m = np.where(np.isfinite(frame.range_std_m), frame.range_std_m, SETTINGS.unknown_std * mean)
    smooth = spread < SETTINGS.max_spread_std * std_m + SETTINGS.max_spread * mean
    return mean.astype(np.float32), std_m.astype(np.float32), known & (share > SETTINGS.min_known) & smooth
