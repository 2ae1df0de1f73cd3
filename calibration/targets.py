"""Calibration targets, chessboard and ChArUco, and the detection of their corners in an image."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import lengths
from calibration.errors import CalibrationError

MIN_CORNERS = 8  # a pose has 6 unknowns, corners have two numbers: 8 leave 10 to judge it
DETECTION_SIDE_PX = 1600  # larger images are searched at this size first: quick, and refined at full size after


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners found in one image. ids: (n,) which corner of the target; pixels: (n, 2) float64, where."""

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]


@dataclass(frozen=True)
class Chessboard:
    """A chessboard of columns x rows inner corners; square_m: the side of a square in meters."""

    columns: int
    rows: int
    square_m: float

    @cached_property
    def points_m(self) -> NDArray[np.float64]:
        """The corners on the board's plane, row by row: (columns * rows, 3)."""
        return _grid(self.columns, self.rows, self.square_m)

    def detect(self, image: NDArray[np.uint8]) -> Corners | None:
        """Find all corners of the board in a gray image (H, W), right-handed; None unless all are found."""
        found = _find_chessboard(image, (self.columns, self.rows))
        if found is None:
            return None
        return Corners(np.arange(self.columns * self.rows), _right_handed(found, self.columns))

    def same_labels(self, left: Corners, right: Corners) -> Corners:
        """``right`` with its corners numbered as in ``left``.

        A chessboard looks the same turned by half (a square one by a quarter), so each view is numbered by chance. The cameras of
        a pair stand upright to each other, so the right numbering is the one that moves the corners most alike.
        """
        grid = right.pixels.reshape(self.rows, self.columns, 2)
        quarter_turns = range(4) if self.rows == self.columns else (0, 2)
        candidates = [np.rot90(grid, turns).reshape(-1, 2) for turns in quarter_turns]
        spread = [np.std(candidate - left.pixels, axis=0).sum() for candidate in candidates]
        return Corners(right.ids, candidates[int(np.argmin(spread))])


@dataclass(frozen=True)
class Charuco:
    """A ChArUco board of columns x rows squares; sides in meters; dictionary: OpenCV's name without DICT_, such as 5X5_100."""

    dictionary: str
    columns: int
    rows: int
    square_m: float
    marker_m: float

    @cached_property
    def points_m(self) -> NDArray[np.float64]:
        """The inner corners on the board's plane, row by row: ((columns - 1) * (rows - 1), 3)."""
        return _grid(self.columns - 1, self.rows - 1, self.square_m)

    def board(self, legacy: bool = False) -> cv2.aruco.CharucoBoard:
        """OpenCV's board; legacy: the layout of OpenCV before 4.6, whose even-rowed boards start with a marker."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, dictionary)
        board.setLegacyPattern(legacy)
        return board

    def detect(self, image: NDArray[np.uint8]) -> Corners | None:
        """The corners seen in a gray image (H, W), of either layout, or None if they are fewer than 8 or all in one line."""
        found = max((self._detect(image, legacy) for legacy in (False, True)), key=lambda corners: corners.ids.size)
        lines = (found.ids // (self.columns - 1), found.ids % (self.columns - 1))
        if found.ids.size < MIN_CORNERS or any(np.unique(line).size < 2 for line in lines):
            return None
        return found

    def same_labels(self, left: Corners, right: Corners) -> Corners:
        """``right`` itself: the markers number the corners."""
        return right

    def _detect(self, image: NDArray[np.uint8], legacy: bool) -> Corners:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        detector = cv2.aruco.CharucoDetector(self.board(legacy), cv2.aruco.CharucoParameters(), parameters)
        pixels, ids, _, _ = detector.detectBoard(image)
        if ids is None:
            return Corners(np.zeros(0, np.int64), np.zeros((0, 2)))
        return Corners(ids.ravel().astype(np.int64), pixels.reshape(-1, 2).astype(np.float64))


Target = Chessboard | Charuco


def parse_target(text: str) -> Target:
    """``chessboard:9x6:24.23mm`` (inner corners, square) or ``charuco:5X5_100:11x8:30mm:22mm`` (squares, square, marker).

    Raises CalibrationError for anything else, saying which part is wrong.
    """
    kind, *parts = text.strip().split(":")
    if kind == "chessboard" and len(parts) == 2:
        return Chessboard(*_counts(parts[0], text), _length_m(parts[1], text))
    if kind == "charuco" and len(parts) == 4:
        dictionary = parts[0].upper().removeprefix("DICT_")
        if not hasattr(cv2.aruco, f"DICT_{dictionary}"):
            raise CalibrationError(f"target {text!r}: OpenCV has no dictionary {parts[0]!r}: use one such as 5X5_100")
        square_m, marker_m = (_length_m(part, text) for part in parts[2:])
        if marker_m >= square_m:
            raise CalibrationError(f"target {text!r}: a marker must be smaller than its square")
        return Charuco(dictionary, *_counts(parts[1], text), square_m, marker_m)
    raise CalibrationError(f"target {text!r}: expected chessboard:9x6:24.23mm or charuco:5X5_100:11x8:30mm:22mm")


def _counts(text: str, target: str) -> tuple[int, int]:
    columns, _, rows = text.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and 3 <= int(columns) <= 100 and 3 <= int(rows) <= 100):
        raise CalibrationError(f"target {target!r}: {text!r} must be columns x rows, 3 to 100 each, such as 9x6")
    return int(columns), int(rows)


def _length_m(text: str, target: str) -> float:
    length_m = lengths.length_m(text, f"target {target!r}")
    if not 1e-4 < length_m < 2:
        raise CalibrationError(f"target {target!r}: a length of {length_m:g} m cannot be a target's")
    return length_m


def _grid(columns: int, rows: int, step_m: float) -> NDArray[np.float64]:
    x, y = np.meshgrid(np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * step_m


def _find_chessboard(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.float64] | None:
    """(n, 2) corners: the quick detector, then the sector-based one, then both with the contrast raised."""
    scale = min(1.0, DETECTION_SIDE_PX / max(image.shape))
    small = image if scale == 1 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    clear = cv2.createCLAHE(3.0, (8, 8)).apply(small)
    quick = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    thorough = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    for find, candidate, flags in (
        (cv2.findChessboardCorners, small, quick),
        (cv2.findChessboardCornersSB, small, cv2.CALIB_CB_NORMALIZE_IMAGE),
        (cv2.findChessboardCorners, clear, quick),
        (cv2.findChessboardCornersSB, clear, thorough),
    ):
        found, corners = find(candidate, size, flags=flags)
        if found:
            pixels = (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) / scale - 0.5
            return _refine(image, pixels, size[0])
    return None


def _refine(image: NDArray[np.uint8], pixels: NDArray[np.float64], columns: int) -> NDArray[np.float64]:
    """Corners to a fraction of a pixel, in the largest window that never reaches the neighboring corner.

    cornerSubPix beats the sector-based detector's own refinement by a third on small, compressed images.
    """
    grid = pixels.reshape(-1, columns, 2)
    nearest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    window = int(np.clip(0.4 * nearest, 2, 15))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    refined = np.ascontiguousarray(pixels, dtype=np.float32)
    cv2.cornerSubPix(image, refined, (window, window), (-1, -1), criteria)  # in place
    return refined.astype(np.float64)


def _right_handed(pixels: NDArray[np.float64], columns: int) -> NDArray[np.float64]:
    """Corners numbered so that rows go to the right when columns go down, as on the printed board."""
    grid = pixels.reshape(-1, columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[:, ::-1]
    return grid.reshape(-1, 2)
