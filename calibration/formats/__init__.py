"""Calibrations of every known format, in and out: ``load_rig`` and ``write_rig``; one module a format."""

from pathlib import Path
from typing import Literal, get_args

from calibration.errors import CalibrationError
from calibration.formats import kalibr, middlebury, native, opencv, oplab, orbslam, ros
from calibration.formats.document import load_document
from calibration.formats.section import Section, naming
from calibration.rig import StereoRig

__all__ = ["WritableFormat", "load_rig", "parse_size", "write_rig"]

WritableFormat = Literal["native", "ros", "kalibr", "opencv"]
WHOLE_RIG = (native, kalibr, oplab, orbslam, middlebury)
SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt")
MAX_FILES_IN_FOLDER = 100


def load_rig(path: str | Path, image_size: tuple[int, int] | None = None) -> StereoRig:
    """Read a calibration of any known format; which one it is, its content tells.

    path: a file, a folder, or two files with a comma between: ``left.yaml,right.yaml``.
    image_size: (width, height) of the images, for files that do not store it (OpenCV's); ignored where the file says.

    Raises CalibrationError, naming the file and the key.
    """
    files = _files(path)
    documents = [load_document(file) for file in files] if len(files) < 3 else []
    if Path(path).is_dir():
        documents = _usable(files, Path(path))
    with naming(documents[0].where):
        return _parse(documents, image_size)


def parse_size(text: str) -> tuple[int, int]:
    """(width, height) of ``1280x960``. Raises CalibrationError for anything else."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise CalibrationError(f"size {text!r}: expected WIDTHxHEIGHT, such as 1280x960")
    return int(width), int(height)


def write_rig(rig: StereoRig, path: str | Path, format: WritableFormat = "native") -> None:
    """Write ``rig`` in the named format; for ROS, path is ``left.yaml,right.yaml`` or a folder for these two.

    Raises CalibrationError for a format that is not written, a rig that the format cannot hold, or a place that cannot be written.
    """
    try:
        _write(rig, Path(path), format)
    except OSError as error:
        raise CalibrationError(f"{path}: the calibration cannot be written: {error.strerror or error}") from error


def _write(rig: StereoRig, path: Path, format: WritableFormat) -> None:
    if format != "ros":
        path.parent.mkdir(parents=True, exist_ok=True)
    if format == "native":
        native.write(rig, path)
    elif format == "ros":
        ros.write(rig, *_pair_of_paths(path))
    elif format == "kalibr":
        kalibr.write(rig, path)
    elif format == "opencv":
        opencv.write(rig, path)
    else:
        raise CalibrationError(f"cannot write {format!r}: the formats written are {', '.join(get_args(WritableFormat))}")


def _parse(documents: list[Section], image_size: tuple[int, int] | None) -> StereoRig:
    if len(documents) == 1:
        return _parse_one(documents[0], image_size)
    first, second = documents
    if ros.matches(first) and ros.matches(second):
        return ros.parse(first, second)
    if opencv.matches(first) and opencv.matches(second):
        return opencv.parse(Section(f"{first.where},{second.where}", {**first.content, **second.content}), image_size)
    raise CalibrationError(
        f"is {_kind(first)}, and {second.where} is {_kind(second)}: two files must be the left and right camera_info of ROS, "
        "or OpenCV's intrinsics and extrinsics"
    )


def _parse_one(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    for reader in WHOLE_RIG:
        if reader.matches(document):
            rig: StereoRig = reader.parse(document)
            return rig
    if ros.matches(document):
        raise CalibrationError("is one camera of a ROS pair: give both files, as left.yaml,right.yaml")
    if opencv.matches(document):
        return opencv.parse(document, image_size)
    keys = ", ".join(map(repr, list(document.content)[:6]))
    raise CalibrationError(f"is no calibration known here (its keys: {keys:.120}); see docs/calibration.md for the formats")


def _kind(document: Section) -> str:
    for reader in (*WHOLE_RIG, ros, opencv):
        if reader.matches(document):
            return f"of {reader.__name__.rsplit('.', 1)[1]} format"
    return "no calibration"


def _files(path: str | Path) -> list[Path]:
    whole = Path(path)
    if whole.is_dir():
        return sorted(file for file in whole.iterdir() if file.suffix.lower() in SUFFIXES and file.is_file())
    parts = str(path).split(",")
    if whole.exists() or len(parts) == 1:
        return [whole]
    if len(parts) > 2:
        raise CalibrationError(f"{path}: give one calibration file, or two with a comma between, not {len(parts)}")
    return [Path(part.strip()) for part in parts]


def _usable(files: list[Path], folder: Path) -> list[Section]:
    """The one rig in a folder, or the two files that make one, left before right."""
    if len(files) > MAX_FILES_IN_FOLDER:
        raise CalibrationError(f"{folder}: holds {len(files)} files that could be calibrations: name the one")
    documents = [document for document in map(_try_load, files) if document is not None]
    whole = [
        d
        for d in documents
        if any(reader.matches(d) for reader in WHOLE_RIG) or (opencv.has_intrinsics(d) and opencv.has_extrinsics(d))
    ]
    if len(whole) == 1:
        return whole
    cameras = [document for document in documents if ros.matches(document)]
    halves = [document for document in documents if opencv.matches(document)]
    if not whole and len(cameras) == 2:
        return _left_first(cameras, folder)
    if not whole and not cameras and len(halves) == 2:
        return halves
    found = ", ".join(f"{Path(d.where).name} ({_kind(d)})" for d in documents)[:300] or "no file that can be read"
    raise CalibrationError(f"{folder}: expected one rig, or the two files of one, and found {found}: name the file")


def _try_load(file: Path) -> Section | None:
    try:
        return load_document(file)
    except CalibrationError:
        return None


def _left_first(cameras: list[Section], folder: Path) -> list[Section]:
    def side(camera: Section) -> str | None:
        words = f"{Path(camera.where).stem} {camera.content.get('camera_name', '')}".lower()
        found = [word for word in ("left", "right") if word in words]
        return found[0] if len(found) == 1 else None

    by_side = {side(camera): camera for camera in cameras}
    if set(by_side) != {"left", "right"}:
        raise CalibrationError(f"{folder}: cannot tell which of two cameras is the left one: give left.yaml,right.yaml")
    return [by_side["left"], by_side["right"]]


def _pair_of_paths(path: Path) -> tuple[Path, Path]:
    parts = str(path).split(",")
    if len(parts) == 2:
        return Path(parts[0].strip()), Path(parts[1].strip())
    if path.suffix:
        raise CalibrationError(f"{path}: ROS keeps a rig in two files: give left.yaml,right.yaml or a folder")
    path.mkdir(parents=True, exist_ok=True)
    return path / "left.yaml", path / "right.yaml"
