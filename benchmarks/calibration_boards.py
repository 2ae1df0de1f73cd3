"""Calibration from a folder of chessboard pairs: this package beside OpenCV's plain way, and how
far ten views at random stray.

python benchmarks/calibration_boards.py FOLDER [chessboard:9x6:24.23mm] with left1.jpg, right1.jpg,
...
"""

import platform
import time
from pathlib import Path

import cv2
import numpy as np
from arguments import words_of

from calibration.boards.target_views import TargetView, detect_view
from calibration.boards.targets import Chessboard, parse_target
from calibration.calibrate import calibrate
from stereo_seecolor.compute.threads import Threads

SUBSETS = 20


def plain(views: list[TargetView], board: Chessboard) -> tuple[float, float, float]:
    """stereoCalibrate from calibrateCamera: rms, baseline in mm, focal length."""
    points = [board.points_m.astype(np.float32)] * len(views)
    left, right = (
        [getattr(view, side).pixels.astype(np.float32) for view in views]
        for side in ("left", "right")
    )
    size = views[0].image_size
    _, K1, D1, *_ = cv2.calibrateCamera(points, left, size, None, None)
    _, K2, D2, *_ = cv2.calibrateCamera(points, right, size, None, None)
    found = cv2.stereoCalibrate(
        points, left, right, K1, D1, K2, D2, size, flags=cv2.CALIB_USE_INTRINSIC_GUESS
    )
    return found[0], 1000 * float(np.linalg.norm(found[6])), float(found[1][0, 0])


def main() -> None:
    words = words_of(__doc__, "FOLDER [BOARD]")
    folder = Path(words[0])
    board = parse_target(words[1] if len(words) > 1 else "chessboard:9x6:24.23mm")
    assert isinstance(board, Chessboard)
    names = [path.stem.removeprefix("left") for path in sorted(folder.glob("left*"))]
    suffix = next(folder.glob("left*")).suffix

    def detect(name: str) -> TargetView:
        left, right = (
            cv2.imread(str(folder / f"{side}{name}{suffix}")) for side in ("left", "right")
        )
        return detect_view(name, left, right, board)

    start = time.perf_counter()
    views = list(Threads(2).each(detect, names))
    detected = time.perf_counter()
    rig, report = calibrate(views, board, "air")
    print("\n".join(report.lines()))
    print(
        f"\ndetection {detected - start:.1f} s, calibration {time.perf_counter() - detected:.1f} "
        f"s, {platform.machine()}"
    )
    shown = [view for view in views if view.left is not None and view.right is not None]
    print("OpenCV: rms %.3f px, baseline %.2f mm, f %.1f px" % plain(shown, board))  # noqa: UP031
    rng = np.random.default_rng(0)
    strays = []
    for _ in range(SUBSETS):
        some, _ = calibrate(
            [shown[i] for i in rng.choice(len(shown), 10, replace=False)], board, "air"
        )
        strays.append(
            [some.baseline_m / rig.baseline_m - 1, some.left.K[0, 0] / rig.left.K[0, 0] - 1]
        )
    deviation, largest = np.std(strays, axis=0), np.abs(strays).max(axis=0)
    print(
        f"ten views at random, {SUBSETS} times: baseline +- {deviation[0]:.2%} (largest "
        f"{largest[0]:.2%}),",
        end=" ",
    )
    print(f"focal length +- {deviation[1]:.2%} (largest {largest[1]:.2%})")


if __name__ == "__main__":
    main()
