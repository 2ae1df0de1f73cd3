"""Rigs in several files of a folder: which files belong together, which is the left camera's, and how their keys are merged."""

import re
from pathlib import Path
from typing import Any

from calibration.errors import CalibrationError
from calibration.formats import opencv
from calibration.formats.scalars import spelling
from calibration.formats.section import Section

SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".mat", ".npz", ".cam", ".conf")
MAX_FILES = 100  # read of one folder: a rig is a few files
SIDE_WORDS = {"left": "1", "right": "2", "l": "1", "r": "2", "1": "1", "2": "2", "cam1": "1", "cam2": "2", "cam0": "1"}


def calibration_files(folder: Path) -> list[Path]:
    """The files of a folder that could be calibrations. Raises CalibrationError if they are too many."""
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES and file.is_file())
    if len(files) > MAX_FILES:
        raise CalibrationError(f"{folder}: holds {len(files)} files that could be calibrations: name the one")
    return files


def left_first(cameras: list[Section], where: Path | str) -> list[Section]:
    """Two cameras' files, left before right. Raises CalibrationError if their names do not say which is which."""

    def side(camera: Section) -> str | None:
        words = f"{Path(camera.where.rsplit(': ', 1)[-1]).stem} {camera.content.get('camera_name', '')}".lower()
        found = [word for word in ("left", "right") if word in words]
        return found[0] if len(found) == 1 else None

    by_side = {side(camera): camera for camera in cameras}
    if set(by_side) != {"left", "right"}:
        raise CalibrationError(f"{where}: cannot tell which of two cameras is the left one: give left.yaml,right.yaml")
    return [by_side["left"], by_side["right"]]


def merged(documents: list[Section]) -> Section:
    """OpenCV's matrices of several files together: K1.xml D1.xml ... R.xml T.xml, or left.xml, right.xml and extrinsics.xml.

    A key that names no side takes it from its file's name; a file of one matrix lends it its name.
    """
    content: dict[str, Any] = {}
    for document in documents:
        stem = Path(document.where).stem
        side = next((SIDE_WORDS[word] for word in re.split(r"[^a-z0-9]+", stem.lower()) if word in SIDE_WORDS), None)
        for key, value in document.content.items():
            sided = key + side if side and spelling(key) in (*opencv.K_NAMES, *opencv.D_NAMES) else key
            content.setdefault(sided, value)
            if len(document.content) == 1 and document.size(key):
                content.setdefault(stem, value)
    return Section(",".join(document.where for document in documents), content)
