"""Rigs in several files of a folder: which files belong together, and how they are merged."""

import os
from contextlib import suppress
from pathlib import Path

from calibration.errors import CalibrationError
from calibration.formats.reading.leaves import side_marks, words
from calibration.formats.reading.section import Section

SUFFIXES = (
    ".yaml", ".yml", ".xml", ".json", ".txt", ".mat", ".npz", ".cam", ".conf", ".toml", ".npy",
    ".csv", ".krtd",
)  # fmt: skip
MAX_FILES = 100  # read of one folder: a rig is a few files


def calibration_files(folder: Path, pattern: str = "*") -> list[Path]:
    """The files of a folder that could be calibrations; pattern: ``*/*`` for those of the folders
    in it.

    Raises CalibrationError if they are too many.
    """
    files = sorted(
        file for file in folder.glob(pattern) if file.suffix.lower() in SUFFIXES and file.is_file()
    )
    if len(files) > MAX_FILES:
        raise CalibrationError(
            f"{folder}: holds {len(files)} files that could be calibrations: name the one"
        )
    return files


def left_first(cameras: list[Section], where: Path | str) -> list[Section]:
    """Two cameras' files, left before right, by their names or the projection that holds the
    baseline. Raises CalibrationError if neither says which is which.
    """

    def of_name(camera: Section) -> tuple[str, ...]:
        return side_marks(words(str(camera.content.get("camera_name", ""))))

    def of_file(camera: Section) -> tuple[str, ...]:
        return side_marks(words(Path(camera.where.rsplit(": ", 1)[-1]).stem))

    def of_projection(camera: Section) -> tuple[str, ...]:
        key = next((key for key in ("projection_matrix", "P", "p") if camera.has(key)), "")
        with suppress(CalibrationError):
            return ("right" if camera.numbers(key, 12)[[3, 7]].any() else "left",) if key else ()
        return ()

    sides = [("left", "right")]
    numbers = [("0", "1"), ("1", "2")]
    for said, pairs in (
        (of_name, sides), (of_file, sides), (of_projection, sides), (of_file, numbers)
    ):  # fmt: skip
        by_side = {said(camera): camera for camera in cameras}
        for left, right in pairs:
            if set(by_side) == {(left,), (right,)}:
                return [by_side[left,], by_side[right,]]
    raise CalibrationError(
        f"{where}: it is unclear which of two cameras is the left one: give left.yaml,right.yaml"
    )


def merged(documents: list[Section]) -> Section:
    """One or more files as one whose keys are their names: K1.xml ... R.xml T.xml, or left.xml,
    right.xml and extrinsics.xml.

    What the names have in common says nothing: ``calibration/camera1/intrinsics.csv`` is ``camera1
    intrinsics``.
    """
    files = [Path(document.where).absolute() for document in documents]
    top = os.path.commonpath([file.parent for file in files])
    content = {
        file.relative_to(top).as_posix(): document.content
        for file, document in zip(files, documents, strict=True)
    }
    return Section(",".join(document.where for document in documents), content)
