"""Corners of a target in an image, and the bounds of their detection; and a grid of AprilTags as
Kalibr prints it: tags of the family 36h11 with black squares at their corners.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

MIN_CORNERS = 8  # a pose has 6 unknowns, corners have two numbers: 8 leave 10 to judge it
DETECTION_SIDE_PX = 1600
"""Larger images are searched at this size first: quick, and refined at full size after."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners found in an image. ids: (n,) in the target; pixels: (n, 2) float64."""

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]


def images_for_detection(
    image: NDArray[np.uint8],
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], float]:
    """The image as a target is looked for in it, the same with its contrast raised (haze), and how
    many of their pixels a pixel of the image has along a side.
    """
    scale = min(1.0, DETECTION_SIDE_PX / max(image.shape))
    small = (
        image
        if scale == 1
        else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    )
    clear = cv2.createCLAHE(3.0, (8, 8)).apply(small)
    return np.asarray(small, np.uint8), np.asarray(clear, np.uint8), scale


Array = NDArray[np.float64]
# of a tag's side: 6 of the code, and Kalibr's border of two on both sides
CELLS, BORDER_CELLS = (10, 2)
BORDERS_CELLS = (2, 1)  # tags of other printers have a border of one
# of a tag's side: a window that reaches neither the code nor the next square
SUBPIXEL_FRACTION = 0.15
# and of a tag's side: detectors place corners better; others went to another corner
MOVED_PX, MOVED_FRACTION = (2.5, 0.05)
# of a tag's side: one this far from its place in the grid is a tag of something else in the scene
OTHER_TAG = 0.5


@dataclass(frozen=True)
class AprilGrid:
    """A grid of columns x rows tags; lengths in meters: the side of a tag (its black border), and
    the space between two.

    first_id: number of the tag at the lower left; they count to the right, then upwards.
    """

    columns: int
    rows: int
    tag_m: float
    space_m: float
    first_id: int = 0

    @cached_property
    def points_m(self) -> Array:
        """The corners of the tags on the plane, x to the right and y down: (4 * columns * rows, 3).

        Four of each tag, clockwise from its upper left; tags in the order of their numbers.
        """
        tag = np.arange(self.columns * self.rows)
        upper_left = np.column_stack([tag % self.columns, self.rows - 1 - tag // self.columns]) * (
            self.tag_m + self.space_m
        )
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * self.tag_m
        flat = (upper_left[:, None] + corners).reshape(-1, 2)
        return np.column_stack([flat, np.zeros(len(flat))])

    def detect(self, image: NDArray[np.uint8]) -> Corners | None:
        """The corners seen in a gray image (H, W), or None if they are fewer than 8."""
        ids, corners = _tags(image)
        known = (ids >= self.first_id) & (ids < self.first_id + self.columns * self.rows)
        tags, corners = self._in_grid(ids[known] - self.first_id, corners[known])
        numbers, pixels = (4 * tags[:, None] + np.arange(4)).ravel(), corners.reshape(-1, 2)
        sides_px = np.repeat(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1), 4)
        pixels, sharp = _refined(image, pixels, sides_px)
        if sharp.sum() < MIN_CORNERS:
            return None
        order = np.argsort(numbers[sharp])
        return Corners(numbers[sharp][order], pixels[sharp][order])

    def same_labels(self, left: Corners, right: Corners) -> Corners:
        """``right`` itself: the tags number the corners."""
        return right

    def _in_grid(self, tags: NDArray[np.int64], corners: Array) -> tuple[NDArray[np.int64], Array]:
        """Tags (n,) and their corners (n, 4, 2), as ``points_m`` counts both, without tags that lie
        elsewhere.

        Detectors differ in which corner of a tag is the first one, and printers in whether rows
        count upwards, as Kalibr's do, or downwards: of the eight ways, the one that most tags fit.
        """
        if len(tags) < 2:
            return tags[:0], corners[:0]
        downwards = (self.rows - 1 - tags // self.columns) * self.columns + tags % self.columns
        side_px = float(np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)))
        best = (0, 0.0), tags[:0], corners[:0]
        for numbers in (tags, downwards):
            for first in range(4):
                turned = np.roll(corners, -first, axis=1)
                fitting, error_px = self._fitting(numbers, turned, OTHER_TAG * side_px)
                score = int(fitting.sum()), -error_px
                if score > best[0]:
                    best = score, numbers[fitting], turned[fitting]
        return best[1:]

    def _fitting(
        self, tags: NDArray[np.int64], corners: Array, limit_px: float
    ) -> tuple[NDArray[np.bool_], float]:
        """(n,) which tags a homography from the board puts where they are, and their mean error in
        tenths of the limit.
        """
        points = self.points_m[:, :2].reshape(-1, 4, 2)[tags]
        H, _ = cv2.findHomography(
            points.reshape(-1, 1, 2), corners.reshape(-1, 1, 2), cv2.RANSAC, limit_px
        )
        if H is None:
            return np.zeros(len(tags), bool), np.inf
        placed = cv2.perspectiveTransform(points.reshape(-1, 1, 2), H).reshape(-1, 4, 2)
        errors_px = np.linalg.norm(placed - corners, axis=2).max(axis=1)
        fitting = errors_px < limit_px
        error_px = float(errors_px[fitting].mean()) if fitting.any() else np.inf
        return fitting, round(10 * error_px / limit_px) if np.isfinite(error_px) else np.inf


def marker(number: int) -> NDArray[np.bool_]:
    """The tag as AprilTag's authors and Kalibr print it, (10, 10), True where black: OpenCV has it
    turned by half.
    """
    return np.asarray(
        np.rot90(
            cv2.aruco.generateImageMarker(_dictionary(), number, CELLS, borderBits=BORDER_CELLS), 2
        )
        == 0
    )


@lru_cache
def _dictionary() -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def _tags(image: NDArray[np.uint8]) -> tuple[NDArray[np.int64], Array]:
    """Numbers (n,) and corners (n, 4, 2) of all tags, clockwise in the image.

    Looked for in the image, in one with its contrast raised (haze), and in both with dark parts
    shrunk, which parts the tags from the squares that touch their corners.
    """
    small, clear, scale = images_for_detection(image)
    variants = [
        shrunk
        for picture in (small, clear)
        for shrunk in (picture, cv2.dilate(picture, np.ones((3, 3))))
    ]
    found: dict[int, Array] = {}
    for border in BORDERS_CELLS:
        by_border: dict[int, Array] = {}
        for variant in variants:
            for number, corners in _detected(variant, border):
                by_border.setdefault(number, corners)
        found = max(found, by_border, key=len)
    numbers = np.array(sorted(found), np.int64)
    corners = np.array([found[number] for number in numbers.tolist()]).reshape(-1, 4, 2)
    return numbers, (corners + 0.5) / scale - 0.5


def _detected(image: NDArray[np.uint8], border_cells: int) -> list[tuple[int, Array]]:
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border_cells
    corners, numbers, _ = cv2.aruco.ArucoDetector(_dictionary(), parameters).detectMarkers(image)
    if numbers is None:
        return []
    return [
        (int(number), np.asarray(four[0], np.float64))
        for number, four in zip(numbers.ravel(), corners, strict=True)
    ]


def _refined(
    image: NDArray[np.uint8], pixels: Array, sides_px: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Corners (n, 2) to a fraction of a pixel; (n,) which moved little, within the image."""
    windows = np.clip(SUBPIXEL_FRACTION * sides_px, 2, 15).astype(int)
    refined = pixels.astype(np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    height, width = image.shape
    inside = (
        (pixels > windows[:, None] + 1)
        & (pixels < np.array([width, height]) - windows[:, None] - 2)
    ).all(axis=1)
    for window in np.unique(windows[inside]).tolist():
        of = inside & (windows == window)
        moved = np.ascontiguousarray(refined[of])
        cv2.cornerSubPix(image, moved, (window, window), (-1, -1), criteria)  # in place
        refined[of] = moved
    near = np.linalg.norm(refined - pixels, axis=1) <= MOVED_PX + MOVED_FRACTION * sides_px
    return refined.astype(np.float64), inside & near
