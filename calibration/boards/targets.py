"""Calibration targets, chessboard, ChArUco and AprilGrid, and the detection of their corners in an
image; and how users name a target.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import errors
from calibration.aprilgrid import MIN_CORNERS, AprilGrid, Corners, images_for_detection
from calibration.errors import CalibrationError
from calibration.formats.reading.document import load_document
from calibration.formats.reading.section import Section
from calibration.geometry import Array

MAX_COUNT = 100  # of corners or tags across and down
APRIL_TAGS = 587  # of the family 36h11


@dataclass(frozen=True)
class Chessboard:
    """A chessboard of columns x rows inner corners; square_m: the side of a square in meters."""

    columns: int
    rows: int
    square_m: float

    @cached_property
    def points_m(self) -> Array:
        """The corners on the board's plane, row by row: (columns * rows, 3)."""
        return _grid(self.columns, self.rows, self.square_m)

    def detect(self, image: NDArray[np.uint8]) -> Corners | None:
        """All corners of the board in a gray image (H, W), right-handed; None unless all."""
        found = _find_chessboard(image, (self.columns, self.rows))
        if found is None:
            return None
        return Corners(np.arange(self.columns * self.rows), _right_handed(found, self.columns))

    def same_labels(self, left: Corners, right: Corners) -> Corners:
        """``right`` with its corners numbered as in ``left``.

        A chessboard looks the same turned by half (a square one by a quarter), so each view is
        numbered by chance. The cameras of a pair stand upright to each other, so the right
        numbering is the one that moves the corners most alike.
        """
        grid = right.pixels.reshape(self.rows, self.columns, 2)
        quarter_turns = range(4) if self.rows == self.columns else (0, 2)
        candidates = [np.rot90(grid, turns).reshape(-1, 2) for turns in quarter_turns]
        spread = [np.std(candidate - left.pixels, axis=0).sum() for candidate in candidates]
        return Corners(right.ids, candidates[int(np.argmin(spread))])


@dataclass(frozen=True)
class Charuco:
    """A ChArUco board of columns x rows squares; sides in meters; dictionary: such as 5X5_100."""

    dictionary: str
    columns: int
    rows: int
    square_m: float
    marker_m: float

    @cached_property
    def points_m(self) -> Array:
        """The inner corners on the board's plane, row by row: ((columns - 1) * (rows - 1), 3)."""
        return _grid(self.columns - 1, self.rows - 1, self.square_m)

    def board(self, legacy: bool = False) -> cv2.aruco.CharucoBoard:
        """OpenCV's board; legacy: as before 4.6, whose even-rowed boards start with a marker."""
        dictionary = cv2.aruco.getPredefinedDictionary(
            getattr(cv2.aruco, f"DICT_{self.dictionary}")
        )
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square_m, self.marker_m, dictionary
        )
        board.setLegacyPattern(legacy)
        return board

    def detect(self, image: NDArray[np.uint8]) -> Corners | None:
        """The corners seen in a gray image (H, W), of either layout, or None if they are fewer than
        8 or all in one line.
        """
        found = max(
            (self._detect(image, legacy) for legacy in (False, True)),
            key=lambda corners: corners.ids.size,
        )
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
        detector = cv2.aruco.CharucoDetector(
            self.board(legacy), cv2.aruco.CharucoParameters(), parameters
        )
        pixels, ids, _, _ = detector.detectBoard(image)
        if ids is None:
            return Corners(np.zeros(0, np.int64), np.zeros((0, 2)))
        return Corners(ids.ravel().astype(np.int64), pixels.reshape(-1, 2).astype(np.float64))


Target = Chessboard | Charuco | AprilGrid
FORMS = (
    "chessboard:9x6:24.23mm, charuco:5X5_100:11x8:30mm:22mm, aprilgrid:6x6:88mm:26.4mm, or a "
    "target file of Kalibr"
)


def parse_target(text: str) -> Target:
    """A target as users name it.

    ``chessboard:9x6:24.23mm`` (inner corners, square), ``charuco:5X5_100:11x8:30mm:22mm`` (squares,
    square, marker), ``aprilgrid:6x6:88mm:26.4mm`` (tags, tag, space between tags), or a target file
    of Kalibr (``.yaml``).
    Raises CalibrationError for anything else, saying which part is wrong.
    """
    if Path(text).suffix.lower() in (".yaml", ".yml"):
        return _of_kalibr(load_document(Path(text)))
    kind, *parts = text.strip().split(":")
    if kind == "chessboard" and len(parts) == 2:
        return Chessboard(*_counts(parts[0], text), _length_m(parts[1], text))
    if kind == "charuco" and len(parts) == 4:
        dictionary = parts[0].upper().removeprefix("DICT_")
        if not hasattr(cv2.aruco, f"DICT_{dictionary}"):
            raise CalibrationError(
                f"target {text!r}: OpenCV has no dictionary {parts[0]!r}: use for example 5X5_100"
            )
        square_m, marker_m = (_length_m(part, text) for part in parts[2:])
        if marker_m >= square_m:
            raise CalibrationError(f"target {text!r}: a marker must be smaller than its square")
        return Charuco(dictionary, *_counts(parts[1], text), square_m, marker_m)
    if kind == "aprilgrid" and len(parts) == 3:
        return _april_grid(
            *_counts(parts[0], text, least=1),
            _length_m(parts[1], text),
            _length_m(parts[2], text),
            0,
            text,
        )
    raise CalibrationError(f"target {text!r}: expected {FORMS}")


def _of_kalibr(file: Section) -> Target:
    """The target of a file that Kalibr takes with ``--target``; its lengths are in meters, the
    space as a fraction of a tag.
    """
    kind, text = file.text(file.first("target_type")), file.where

    def count(key: str, least: int = 3) -> int:
        return _count(str(file.number(key)).removesuffix(".0"), text, least)

    if kind == "aprilgrid":
        columns, rows = count("tagCols", 1), count("tagRows", 1)
        tag_m = _length_m(f"{file.number('tagSize')}m", text)
        first_id = int(file.number("codeOffset", 0.0))
        return _april_grid(columns, rows, tag_m, file.number("tagSpacing") * tag_m, first_id, text)
    if kind == "checkerboard":
        columns, rows = count("targetCols"), count("targetRows")
        across_m, down_m = (file.number(key) for key in ("colSpacingMeters", "rowSpacingMeters"))
        if abs(across_m - down_m) > 1e-6:
            raise CalibrationError(
                f"target {text!r}: its squares are not square: {across_m:g} m across, {down_m:g} "
                "m down"
            )
        return Chessboard(columns, rows, _length_m(f"{across_m}m", text))
    raise CalibrationError(
        f"target {text!r}: Kalibr's aprilgrid and checkerboard targets are supported, not {kind!r}"
    )


def _april_grid(
    columns: int, rows: int, tag_m: float, space_m: float, first_id: int, target: str
) -> AprilGrid:
    if columns * rows < 2 or first_id < 0 or first_id + columns * rows > APRIL_TAGS:
        raise CalibrationError(
            f"target {target!r}: needs 2 to {APRIL_TAGS} tags of the family 36h11"
        )
    if not 0.05 * tag_m < space_m < tag_m:
        raise CalibrationError(
            f"target {target!r}: the space between tags must be smaller than a tag (0.3 of it, as "
            "Kalibr prints)"
        )
    return AprilGrid(columns, rows, tag_m, space_m, first_id)


def _counts(text: str, target: str, least: int = 3) -> tuple[int, int]:
    columns, _, rows = text.lower().partition("x")
    try:
        return _count(columns, target, least), _count(rows, target, least)
    except CalibrationError:
        message = (
            f"target {target!r}: {text!r} must be columns x rows, {least} to {MAX_COUNT} "
            "each, such as 9x6"
        )
        raise CalibrationError(message) from None


def _count(text: str, target: str, least: int = 3) -> int:
    if not (text.isdecimal() and least <= int(text) <= MAX_COUNT):
        raise CalibrationError(
            f"target {target!r}: {text} must be a whole number, {least} to {MAX_COUNT}"
        )
    return int(text)


def _length_m(text: str, target: str) -> float:
    length_m = errors.length_m(text, f"target {target!r}")
    if not 1e-4 < length_m < 2:
        raise CalibrationError(
            f"target {target!r}: a length of {length_m:g} m is impossible for a target"
        )
    return length_m


def _grid(columns: int, rows: int, step_m: float) -> Array:
    x, y = np.meshgrid(np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * step_m


def _find_chessboard(image: NDArray[np.uint8], size: tuple[int, int]) -> Array | None:
    """(n, 2) corners: by the quick detector, the sector-based, both at raised contrast."""
    small, clear, scale = images_for_detection(image)
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


def _refine(image: NDArray[np.uint8], pixels: Array, columns: int) -> Array:
    """Corners to sub-pixel, in the largest window that never reaches the neighboring corner.

    cornerSubPix beats the detector's own refinement by a third on small, compressed images.
    """
    grid = pixels.reshape(-1, columns, 2)
    nearest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    window = int(np.clip(0.4 * nearest, 2, 15))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    refined = np.ascontiguousarray(pixels, dtype=np.float32)
    cv2.cornerSubPix(image, refined, (window, window), (-1, -1), criteria)  # in place
    return refined.astype(np.float64)


def _right_handed(pixels: Array, columns: int) -> Array:
    """Corners numbered so that rows go right when columns go down, as on the printed board."""
    grid = pixels.reshape(-1, columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[:, ::-1]
    return grid.reshape(-1, 2)
