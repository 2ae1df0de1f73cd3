"""Features of a frame: points with descriptors, matched, and their positions in the camera."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.mapping.track.depth_smoothing import smooth_depth
from stereo_seecolor.mapping.track.local_contrast import local_contrast
from stereo_seecolor.mapping.track.sift import keypoints
from stereo_seecolor.records import Array, SurveyFrame


@dataclass(frozen=True)
class FeatureSettings:
    """How features are found."""

    # Both were measured: docs/lab/mapping.md.
    # a frame: some 300 matches remain at 60 % overlap; fewer make some tracks worse
    max_features: int = 2000
    # images are reduced to it: a track is as exact as at 960, in half of the time
    max_width_px: int = 640
    # how well SIFT finds a point again (measured on the synthetic reef)
    lateral_std_px: float = 0.3


FEATURE_SETTINGS = FeatureSettings()


@dataclass(frozen=True, eq=False)
class Features:
    """The features of a frame.

    points: (n, 3) in image space, x / z, y / z and 1 / z of the camera's coordinates, 1 / z in 1/m.
    std: (n, 3) their errors.
    near: (n,) 1 / z averaged over a narrower window. A window flattens relief; a matcher's noise
    shrinks with it.
    descriptors: (n, 128) uint8. In image space errors are symmetric; in meters they are not, the
    less so the farther a point.
    """

    points: Array
    std: Array
    near: Array
    descriptors: NDArray[np.uint8]

    @classmethod
    def none(cls) -> "Features":
        """Make the features of a frame that shows nothing."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 128), np.uint8))

    def scaled(self, scale: float) -> "Features":
        """Scale the ranges by a factor."""
        by = np.array([1, 1, 1 / scale])
        return Features(self.points * by, self.std * by, self.near / scale, self.descriptors)

    def unflattened(self) -> "Features":
        """The same points by ranges averaged over the narrower window."""
        return replace(self, points=np.column_stack([self.points[:, :2], self.near]))

    @property
    def points_m(self) -> Array:
        """The points in the camera: (n, 3) meters."""
        return np.column_stack([self.points[:, :2], np.ones(len(self.points))]) / self.points[:, 2:]


def detect(
    frame: SurveyFrame, geometry: RectifiedPair, settings: FeatureSettings = FEATURE_SETTINGS
) -> Features:
    """SIFT (Lowe 2004) on local contrast, kept where the range is measured and smooth."""
    gray: NDArray[np.uint8] = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    scale = min(1.0, settings.max_width_px / gray.shape[1])
    contrast = local_contrast(gray, scale)
    depth = smooth_depth(frame, geometry, int(1 / scale))
    mask = cv2.resize(
        depth.usable.astype(np.uint8), contrast.shape[::-1], interpolation=cv2.INTER_NEAREST
    )
    found, descriptors = keypoints(contrast, mask, settings.max_features)
    if not len(found):
        return Features.none()
    pixels = (found + 0.5) / scale - 0.5
    inverse, near, inverse_std, good = depth.at(pixels)
    directions = (pixels[good] - [geometry.cx_left_px, geometry.cy_px]) / geometry.focal_px
    lateral = np.full(len(directions), settings.lateral_std_px / (geometry.focal_px * scale))
    points = np.column_stack([directions, inverse[good]])
    std = np.column_stack([lateral, lateral, inverse_std[good]])
    return Features(points, std, near[good], np.rint(descriptors[good]).astype(np.uint8))
