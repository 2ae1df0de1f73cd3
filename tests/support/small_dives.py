"""A dive in pictures of half the size: for tests that need a real or the sample dive, and not its
resolution.
"""

from collections.abc import Iterable
from pathlib import Path

import cv2

from calibration.formats import load_rig, native
from calibration.resizing import resized_rig
from calibration.verification.conventions import resolve_convention

REEF = Path(__file__).resolve().parents[2] / "data_samples" / "reef"
OVERLAPPING = range(4, 8)
"""The frames of the sample dive where its two lines overlap."""


def write_half_pictures(files: Iterable[Path], folder: Path) -> None:
    """Write images or range maps (meters, all known) in half their size into ``folder``."""
    folder.mkdir(parents=True)
    for file in files:
        picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert picture is not None, file
        small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / file.name), small)


def write_short_reef(root: Path, frames: range = OVERLAPPING) -> None:
    """Write ``left``, ``right`` and ``cam.yaml`` of some frames of the sample dive, in half their
    size.
    """
    for side in ("left", "right"):
        write_half_pictures(
            sorted((REEF / side).iterdir())[frames.start : frames.stop], root / side
        )
    rig = load_rig(REEF / "cam.yaml")
    native.write(resized_rig(rig, (288, 224)), root / "cam.yaml")


def write_half_of_the_real_dive(real_data: Path, root: Path, pairs: int = 20) -> None:
    """Write ``left``, ``right`` and ``cam.yaml`` of the first pairs of the real dive, all if it
    has no more, in half their size.
    """
    data = real_data / "acfr"
    sides = [sorted((data / side).iterdir()) for side in ("left", "right")]
    for files in sides:
        write_half_pictures(files[:pairs], root / files[0].parent.name)
    first = tuple(cv2.imread(str(files[0]), cv2.IMREAD_UNCHANGED) for files in sides)
    rig = resolve_convention(load_rig(data / "stereo_calib.mat", (1360, 1024)), [first])
    native.write(resized_rig(rig, (680, 512)), root / "cam.yaml")
