"""Make docs/images/before_after.png from a finished run: python docs/before_after.py OUT LEFT_FOLDER NAME."""

import sys
from pathlib import Path

import cv2
import numpy as np

from calibration import Rectification
from calibration.formats import load_rig

WIDTH = 1200


def main(out: Path, left: Path, name: str) -> None:
    rectification = Rectification.from_rig(load_rig(left.parent / "cam.yaml"))
    before = rectification.apply_left(cv2.imread(str(left / f"{name}.png")))
    after = cv2.imread(str(out / "corrected" / f"{name}.png"))
    both = np.hstack([before, after])
    scale = WIDTH / both.shape[1]
    small = cv2.resize(both, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(Path(__file__).parent / "images" / "before_after.png"), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
