"""Calibrations of any format: ``load_rig`` reads every known one, ``write_rig`` writes some.

Formats of many users are modules here; packages add others (``calibration_format``).
"""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Literal, get_args

from calibration.errors import CalibrationError
from calibration.files import write_atomic
from calibration.formats import colmap, kalibr, matlab, native, opencv, rectified, ros
from calibration.formats.calibration_format import CameraFormat, RigFormat, added_formats
from calibration.formats.reading.document import load_document
from calibration.formats.reading.finder import find
from calibration.formats.reading.rig_files import calibration_files, left_first, merged
from calibration.formats.reading.section import Section, naming
from calibration.resizing import refuse_other_resolution
from calibration.rig import StereoRig

__all__ = [
    "CameraFormat",
    "RigFormat",
    "Section",
    "WritableFormat",
    "format_name",
    "load_rig",
    "load_rig_of_images",
    "parse_size",
    "write_rig",
]

WritableFormat = Literal["native", "ros", "kalibr", "opencv", "matlab", "viame"]
RIG_FORMATS = {
    "native": RigFormat(native.matches, lambda document, _: native.parse(document)),
    "kalibr": RigFormat(kalibr.matches, lambda document, _: kalibr.parse(document)),
    "matlab": RigFormat(matlab.matches, matlab.parse),
    "colmap": RigFormat(colmap.matches, colmap.parse),
}
CAMERA_FORMATS = {"ros": CameraFormat("ROS", ros.matches, ros.parse)}
# told by the form of its numbers: the formats that have names of their own are asked before
RECTIFIED = RigFormat(rectified.matches, rectified.parse)
NO_POSE = (
    "R and T between them are missing: calibrate the two as a stereo pair, or write R and T into a "
    "third file and give a folder with all three"
)
PARTS = (".csv", ".npy", ".txt", ".xml", ".json", ".yml", ".yaml", ".mat")
MAX_AROUND = 3  # mappings around a calibration: /ns, ros__parameters, stereo
Size = tuple[int, int]


def load_rig(path: str | Path, image_size: Size | None = None) -> StereoRig:
    """Read a calibration of any known format, which is recognized by the content of the file.

    Args:
        path: A file, a folder, or two files with a comma between: ``left.yaml,right.yaml``.
        image_size: (width, height) of the images, pixels, for files that do not store it; ignored
            where the file does.

    Returns:
        The rig, with what had to be guessed in ``doubts``.

    Raises:
        CalibrationError: If the calibration cannot be read; the message names the file and the key.
    """
    documents = _documents(path)
    with naming(documents[0].where):
        return _parse(documents, image_size)


def load_rig_of_images(path: str | Path, image_size: Size) -> StereoRig:
    """Read a calibration as ``load_rig`` does, for images whose size (width, height) is known.

    Raises CalibrationError also where the file stores no size and was made for images of another.
    """
    rig = load_rig(path, image_size)
    if rig.left.image_size == image_size:
        refuse_other_resolution(rig, str(path))
    return rig


def format_name(path: str | Path) -> str:
    """The format that load_rig takes ``path`` for, such as "kalibr". Raises CalibrationError."""
    for document in _within(_documents(path)[0]):
        if name := _format_of(document):
            return name
    raise CalibrationError(
        f"{path}: is not a calibration of a known format; see docs/calibration.md for the formats"
    )


def parse_size(text: str) -> Size:
    """Parse ``1280x960`` to (width, height). Raises CalibrationError for anything else."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise CalibrationError(f"size {text!r}: expected WIDTHxHEIGHT, such as 1280x960")
    return int(width), int(height)


def write_rig(rig: StereoRig, path: str | Path, format: WritableFormat = "native") -> None:
    """Write a calibration. Each file is written whole or not at all.

    Args:
        rig: The rig to write.
        path: A file; for ROS ``left.yaml,right.yaml``, or a folder for these two.
        format: The name of the format.

    Raises:
        CalibrationError: For a format that is not written, a rig that the format cannot hold, or a
            place that cannot be written.
    """
    from calibration.formats import viame  # is only written

    writers: dict[str, Callable[[StereoRig, Path], None]] = {
        "native": native.write,
        "kalibr": kalibr.write,
        "opencv": opencv.write,
        "matlab": matlab.write,
        "viame": viame.write,
    }
    try:
        if format == "ros":
            ros.write(rig, *_pair_of_paths(Path(path)))
        elif format in writers:
            with write_atomic(Path(path)) as temporary:
                writers[format](rig, temporary)
        else:
            raise CalibrationError(
                f"cannot write {format!r}: the formats written are "
                f"{', '.join(get_args(WritableFormat))}"
            )
    except OSError as error:
        raise CalibrationError(
            f"{path}: the calibration cannot be written: {error.strerror or error}"
        ) from error


def paths_of(path: str | Path, format: WritableFormat) -> tuple[Path, ...]:
    """List the files that ``write_rig`` writes. Raises CalibrationError."""
    return _pair_of_paths(Path(path)) if format == "ros" else (Path(path),)


def _documents(path: str | Path) -> list[Section]:
    whole = Path(path)
    if whole.is_dir():
        return _of_folder(whole)
    parts = [whole] if whole.exists() else [Path(part.strip()) for part in str(path).split(",")]
    if len(parts) > 2:
        raise CalibrationError(
            f"{path}: give one calibration file, or two separated by a comma, not {len(parts)}"
        )
    if all(part.is_dir() for part in parts):  # a folder a camera
        return [
            merged([document for part in parts for document in _readable(calibration_files(part))])
        ]
    return [load_document(part) for part in parts]


def _parse(documents: list[Section], image_size: Size | None) -> StereoRig:
    if len(documents) == 1:
        return _parse_one(documents[0], image_size)
    if (rig := _of_cameras(documents)) is not None:
        return rig
    first, second = documents
    if colmap.matches(both := _together(documents)):
        return colmap.parse(both, image_size)
    if opencv.is_rig(both := merged(documents)):
        return opencv.parse(both, image_size)
    if all(map(opencv.is_one_lens, documents)):
        raise CalibrationError(f"contains one lens, and so does {second.where}: {NO_POSE}")
    raise CalibrationError(
        f"is {_kind(first)}, and {second.where} is {_kind(second)}: two files must be the left "
        "and right camera_info of ROS, "
        ".cam of SeaGIS or sensor.yaml of EuRoC, or OpenCV's intrinsics and extrinsics"
    )


def _rig_formats() -> Iterator[tuple[str, RigFormat]]:
    """The formats of whole rigs in the order in which they are asked."""
    yield from RIG_FORMATS.items()
    yield from ((name, one) for name, one in added_formats().items() if isinstance(one, RigFormat))
    yield "rectified", RECTIFIED


def _camera_formats() -> Iterator[tuple[str, CameraFormat]]:
    """The formats of single cameras in the order in which they are asked."""
    yield from CAMERA_FORMATS.items()
    for name, one in added_formats().items():
        if isinstance(one, CameraFormat):
            yield name, one


def _matching(document: Section) -> Iterator[str]:
    """The names of the formats that a document is of."""
    formats: Iterator[tuple[str, RigFormat | CameraFormat]] = chain(
        _rig_formats(), _camera_formats()
    )
    yield from (name for name, one in formats if one.matches(document))
    if opencv.matches(document):
        yield "opencv"


def _format_of(document: Section) -> str | None:
    """The name of the format of a document, or of both cameras in it; None if it is of none."""
    if cameras := _two_cameras(document):
        return cameras[0]
    return next(_matching(document), None)


def _two_cameras(document: Section) -> tuple[str, CameraFormat, list[Section]] | None:
    """The format's name, the format, and the mappings of two cameras in one file; else None."""
    cameras = [
        document.section(key) for key, value in document.content.items() if isinstance(value, dict)
    ]
    if len(cameras) != 2:
        return None
    for name, format in _camera_formats():
        if all(map(format.matches, cameras)):
            return name, format, cameras
    return None


def _of_cameras(documents: list[Section]) -> StereoRig | None:
    """The rig of a left and a right camera of the same format; None if they are not."""
    for _, format in _camera_formats():
        left, right = (
            next(filter(format.matches, _within(document)), None) for document in documents
        )
        if left and right:
            return format.parse(left, right)
    return None


def _parse_one(document: Section, image_size: Size | None) -> StereoRig:
    document = next((found for found in _within(document) if any(_matching(found))), document)
    for _, format in _rig_formats():
        if format.matches(document):
            return format.parse(document, image_size)
    if found := _two_cameras(document):
        _, of_camera, cameras = found
        return of_camera.parse(*left_first(cameras, document.where))
    for _, of_camera in _camera_formats():
        if of_camera.matches(document):
            raise CalibrationError(
                f"is one camera of a {of_camera.title} pair: give both files, as "
                "left.yaml,right.yaml"
            )
    if opencv.is_one_lens(document):
        raise CalibrationError(
            "contains only one lens: give the file of both cameras with R and T between them, or "
            "a folder with all files"
        )
    if opencv.matches(document):
        return opencv.parse(document, image_size)
    words = re.findall(r"[\w./-]+", repr(document.content))
    files = [word for word in words if word.endswith(PARTS)]
    if len(files) > 1:
        raise CalibrationError(
            f"contains only file names, such as {files[0]}: give the folder with these"
        )
    if find(document.content).get("baseline"):
        raise CalibrationError(
            "contains a baseline and no camera matrix: add the fx, fy, cx and cy of the rectified "
            "images, in pixels"
        )
    keys = ", ".join(map(repr, list(document.content)[:6]))
    raise CalibrationError(
        f"is not a calibration of a known format (its keys: {keys:.120}); see "
        "docs/calibration.md for the formats"
    )


def _within(document: Section) -> Iterator[Section]:
    """The document, and what a mapping around it holds: ``stereo_calibration: {K1: ...}``."""
    yield document
    for _ in range(MAX_AROUND):
        if len(document.content) != 1:
            return
        (value,) = document.content.values()
        if not isinstance(value, dict):
            return
        document = Section(document.where, {str(key): inner for key, inner in value.items()})
        yield document


def _of_folder(folder: Path) -> list[Section]:
    """The one rig in a folder, or the files that make one, left before right."""
    of_cameras = [folder / camera / "sensor.yaml" for camera in ("cam0", "cam1")]  # as of EuRoC
    if all(file.is_file() for file in of_cameras):
        return [load_document(file) for file in of_cameras]
    documents = _readable(calibration_files(folder))
    if (
        colmap.matches(parts := _together(documents))
        and parts.has(colmap.CAMERAS)
        and len(parts.content) > 1
    ):
        return [Section(str(folder), parts.content)]
    whole = [
        d
        for d in documents
        if any(format.matches(inner) for inner in _within(d) for _, format in _rig_formats())
        or opencv.is_rig(d)
    ]
    if len(whole) == 1:
        return whole
    for _, of_camera in _camera_formats():
        cameras = [document for document in documents if of_camera.matches(document)]
        if not whole and len(cameras) == 2:
            return left_first(cameras, folder)
    if not whole and not any(map(ros.matches, documents)):
        deeper: list[Path] = []
        with suppress(CalibrationError):
            deeper = calibration_files(folder, "*/*")
        for files in (documents, [*documents, *_readable(deeper)]):
            if files and opencv.is_rig(parts := merged(files)):
                return [Section(str(folder), parts.content)]
    found = (
        ", ".join(f"{Path(d.where).name} ({_kind(d)})" for d in documents)[:300]
        or "no file that can be read"
    )
    raise CalibrationError(
        f"{folder}: expected one rig, or the files of one, and found {found}: name the file"
    )


def _together(documents: list[Section]) -> Section:
    """The keys of several files as one's."""
    return Section(
        ",".join(d.where for d in documents),
        {key: value for d in documents for key, value in d.content.items()},
    )


def _kind(document: Section) -> str:
    if name := next(_matching(document), None):
        return f"of {name} format"
    return "one lens" if opencv.is_one_lens(document) else "no calibration"


def _readable(files: list[Path]) -> list[Section]:
    added_formats()  # errors of a package are not those of a file
    documents = []
    for file in files:
        with suppress(CalibrationError):
            documents.append(load_document(file))
    return documents


def _pair_of_paths(path: Path) -> tuple[Path, Path]:
    parts = str(path).split(",")
    if len(parts) == 2:
        left, right = (Path(part.strip()) for part in parts)
        if left.absolute() == right.absolute():
            raise CalibrationError(f"{path}: ROS stores a rig in two files: give two names")
        return left, right
    if path.suffix:
        raise CalibrationError(
            f"{path}: ROS stores a rig in two files: give left.yaml,right.yaml or a folder"
        )
    return path / "left.yaml", path / "right.yaml"
