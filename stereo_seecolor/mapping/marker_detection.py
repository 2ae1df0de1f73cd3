"""Detection of square markers in an image."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.mapping.marker_corners import refined

FAMILIES = {
    "36h11": "DICT_APRILTAG_36h11",
    "25h9": "DICT_APRILTAG_25h9",
    "16h5": "DICT_APRILTAG_16h5",
    "aruco-4x4": "DICT_4X4_250",
    "aruco-5x5": "DICT_5X5_250",
    "aruco-6x6": "DICT_6X6_250",
    "aruco-original": "DICT_ARUCO_ORIGINAL",
}
"""Name -> OpenCV's dictionary. AprilTag 36h11 first: the fewest false ones (Olson 2011)."""


@dataclass(frozen=True, eq=False)
class MarkerObservation:
    """A marker in an image. number: of the marker. corners_px: (4, 2) of its black border,
    clockwise from its own top left, (0, 0) a pixel's center.
    """

    number: int
    corners_px: NDArray[np.float64]


class MarkerDetector:
    """Finds the markers of one family. Raises InputError for a family that is not known."""

    def __init__(self, family: str) -> None:
        if family not in FAMILIES:
            raise InputError(f"--family {family}: is unknown: one of {', '.join(FAMILIES)}")
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[family]))
        self.cells = dictionary.markerSize + 2  # with the black border
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def find(self, color: NDArray[np.uint8]) -> list[MarkerObservation]:
        """Find the markers in an RGB image (H, W, 3)."""
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        corners, numbers, _ = self._detector.detectMarkers(gray)
        if numbers is None:
            return []
        light = decode_srgb(color.astype(np.float32) / 255).mean(axis=2)
        return [
            MarkerObservation(
                int(number), refined(light, np.asarray(own, np.float64).reshape(4, 2))
            )
            for number, own in zip(np.ravel(numbers), corners, strict=True)
        ]
