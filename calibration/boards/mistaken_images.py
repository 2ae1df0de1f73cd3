"""What images of a target show where they give no rig: another chessboard than the one named, or
images of one side that are mirrored or turned.
"""

from collections import Counter
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.aprilgrid import images_for_detection
from calibration.boards.bundle import Lens, rms
from calibration.boards.lens import fit_rig
from calibration.boards.report import MAX_RMS_PX
from calibration.boards.target_views import MIN_VIEWS, SIDES, detect_view, observations_of
from calibration.boards.targets import Chessboard, Target
from calibration.errors import CalibrationError
from calibration.gray import to_gray

Image = NDArray[np.generic]
LENS = Lens("pinhole", 5)
CHANGES: dict[str, Callable[[Image], Image]] = {
    "mirrored": lambda image: np.ascontiguousarray(image[:, ::-1]),
    "turned by 180 degrees": lambda image: np.ascontiguousarray(image[::-1, ::-1]),
}


def mistake_of(pairs: Sequence[tuple[Image, Image]], target: Target) -> str | None:
    """What is wrong with image pairs, (H, W) or (H, W, 3), that give no rig, where a test shows it:
    with the mistake undone the target is found, or one rig fits all.
    """
    if isinstance(target, Chessboard) and (other := _other_chessboard(pairs, target)):
        return other
    for change, undo in CHANGES.items():
        changed = [
            side
            for side in SIDES
            if _fit(
                [
                    (undo(left), right) if side == "left" else (left, undo(right))
                    for left, right in pairs
                ],
                target,
            )
        ]
        if changed:
            side = f"the {changed[0]}" if len(changed) == 1 else "one"
            return f"the images of {side} side are {change}: with that undone, one rig fits"
    return None


def _other_chessboard(pairs: Sequence[tuple[Image, Image]], target: Chessboard) -> str | None:
    """The chessboard that most images show, where it has other counts."""
    shown = Counter(size for pair in pairs for image in pair if (size := _size(image)))
    if not shown:
        return None
    (columns, rows), count = shown.most_common(1)[0]
    if count <= len(pairs) or {columns, rows} == {target.columns, target.rows}:
        return None
    return (
        f"the images show a chessboard of {columns}x{rows} inner corners, not "
        f"{target.columns}x{target.rows} (squares are one more each way)"
    )


def _size(image: Image) -> tuple[int, int] | None:
    """Inner corners of the largest chessboard in an image, the longer side first."""
    small, _, _ = images_for_detection(to_gray(image))
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER
    found, _, marks = cv2.findChessboardCornersSBWithMeta(small, (3, 3), flags)
    return (max(marks.shape), min(marks.shape)) if found else None


def _fit(pairs: Sequence[tuple[Image, Image]], target: Target) -> bool:
    """Whether one rig fits the target in these pairs."""
    views = [detect_view("", *pair, target) for pair in pairs]
    seen = [view for view in views if view.left is not None and view.right is not None]
    if len(seen) < MIN_VIEWS:
        return False
    try:
        fit = fit_rig(seen, target, LENS)
    except CalibrationError:
        return False
    return rms(fit, observations_of(seen, target)) < MAX_RMS_PX[1]
