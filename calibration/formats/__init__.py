"""Calibration formats: ``load_rig`` reads every known one, ``write_rig`` writes some; each format
is a module.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, get_args

from calibration.errors import CalibrationError
from calibration.files import write_atomic
from calibration.formats import (
    bouguet,
    colmap,
    euroc,
    kalibr,
    kitti,
    matlab,
    metashape,
    native,
    okvis,
    opencv,
    orbslam,
    ros,
    seagis,
)
from calibration.formats.others import (
    basalt,
    calib_filter,
    calib_io,
    cityscapes,
    depthai,
    middlebury,
    oplab,
    rectified,
    zed,
)
from calibration.formats.reading.document import (
    calibration_files,
    left_first,
    load_document,
    merged,
)
from calibration.formats.reading.section import Section, naming
from calibration.resizing import refuse_other_resolution
from calibration.rig import StereoRig

__all__ = [
    "WritableFormat",
    "format_name",
    "load_rig",
    "load_rig_of_images",
    "parse_size",
    "write_rig",
]

WritableFormat = Literal["native", "ros", "kalibr", "opencv", "matlab", "viame"]
# these store the size of the images
SIZED = (native, kalibr, oplab, orbslam, basalt, depthai, calib_filter, calib_io)
# these hold a rig in one file
WHOLE_RIG = (
    *SIZED,
    middlebury,
    kitti,
    matlab,
    bouguet,
    zed,
    okvis,
    colmap,
    metashape,
    cityscapes,
    rectified,
)
# these hold a camera in each of two files
ONE_CAMERA = {"ROS": ros, "SeaGIS": seagis, "EuRoC": euroc}
READERS = (*WHOLE_RIG, *ONE_CAMERA.values(), opencv)
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
    """The format that load_rig takes ``path`` for, such as "kalibr". Raises CalibrationError if it
    is none.
    """
    for document in _within(_documents(path)[0]):
        if cameras := _two_cameras(document):
            return _name(cameras[0])
        for reader in READERS:
            if reader.matches(document):
                return _name(reader)
    raise CalibrationError(
        f"{path}: is not a calibration known here; see docs/calibration.md for the formats"
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
            f"{path}: give one calibration file, or two with a comma between, not {len(parts)}"
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
    if opencv.has_intrinsics(both := merged(documents)) and opencv.has_extrinsics(both):
        return opencv.parse(both, image_size)
    if all(map(opencv.is_one_lens, documents)):
        raise CalibrationError(f"holds one lens, and so does {second.where}: {NO_POSE}")
    raise CalibrationError(
        f"is {_kind(first)}, and {second.where} is {_kind(second)}: two files must be the left "
        "and right camera_info of ROS, "
        ".cam of SeaGIS or sensor.yaml of EuRoC, or OpenCV's intrinsics and extrinsics"
    )


def _two_cameras(document: Section) -> tuple[Any, list[Section]] | None:
    """The reader and the mappings of two cameras in one file; None if it holds no such two."""
    cameras = [
        document.section(key) for key, value in document.content.items() if isinstance(value, dict)
    ]
    reader = next(
        (
            one
            for one in ONE_CAMERA.values()
            if len(cameras) == 2 and all(map(one.matches, cameras))
        ),
        None,
    )
    return (reader, cameras) if reader else None


def _of_cameras(documents: list[Section]) -> StereoRig | None:
    """The rig of a left and a right camera of the same format; None if they are not."""
    for reader in ONE_CAMERA.values():
        left, right = (
            next(filter(reader.matches, _within(document)), None) for document in documents
        )
        if left and right:
            rig: StereoRig = reader.parse(left, right)
            return rig
    return None


def _parse_one(document: Section, image_size: Size | None) -> StereoRig:
    document = next(
        (found for found in _within(document) if any(reader.matches(found) for reader in READERS)),
        document,
    )
    rig: StereoRig
    for reader in WHOLE_RIG:
        if reader.matches(document):
            rig = reader.parse(document) if reader in SIZED else reader.parse(document, image_size)
            return rig
    if cameras := _two_cameras(document):
        rig = cameras[0].parse(*left_first(cameras[1], document.where))
        return rig
    for name, reader in ONE_CAMERA.items():
        if reader.matches(document):
            raise CalibrationError(
                f"is one camera of a {name} pair: give both files, as left.yaml,right.yaml"
            )
    if opencv.is_one_lens(document):
        raise CalibrationError(
            "holds one lens: give the file of both cameras with R and T between them, or a folder "
            "with its parts"
        )
    if opencv.matches(document):
        return opencv.parse(document, image_size)
    words = re.findall(r"[\w./-]+", repr(document.content))
    files = [word for word in words if word.endswith(PARTS)]
    if len(files) > 1:
        raise CalibrationError(
            f"holds no numbers but names of files, such as {files[0]}: give the folder with these"
        )
    keys = ", ".join(map(repr, list(document.content)[:6]))
    raise CalibrationError(
        f"is not a calibration known here (its keys: {keys:.120}); see docs/calibration.md for the "
        "formats"
    )


def _within(document: Section) -> Iterator[Section]:
    """The document, and what a mapping around all of it holds: ``stereo_calibration: {K1:
    ...}``.
    """
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
    euroc_files = [folder / camera / "sensor.yaml" for camera in ("cam0", "cam1")]
    if all(file.is_file() for file in euroc_files):
        return [load_document(file) for file in euroc_files]
    documents = _readable(calibration_files(folder))
    if (
        colmap.matches(parts := _together(documents))
        and parts.has(colmap.CAMERAS)
        and len(parts.content) > 1
    ):
        return [Section(str(folder), parts.content)]
    # the configuration names them
    documents = [document for document in documents if not okvis.is_lens(document)]
    whole = [
        d
        for d in documents
        if any(reader.matches(inner) for inner in _within(d) for reader in WHOLE_RIG)
        or _is_opencv_rig(d)
    ]
    if len(whole) == 1:
        return whole
    for reader in ONE_CAMERA.values():
        cameras = [document for document in documents if reader.matches(document)]
        if not whole and len(cameras) == 2:
            return left_first(cameras, folder)
    if not whole and not any(map(ros.matches, documents)):
        deeper: list[Path] = []
        with suppress(CalibrationError):
            deeper = calibration_files(folder, "*/*")
        for files in (documents, [*documents, *_readable(deeper)]):
            if files and _is_opencv_rig(parts := merged(files)):
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


def _is_opencv_rig(document: Section) -> bool:
    return opencv.has_intrinsics(document) and opencv.has_extrinsics(document)


def _kind(document: Section) -> str:
    for reader in READERS:
        if reader.matches(document):
            return f"of {_name(reader)} format"
    return "one lens" if opencv.is_one_lens(document) else "no calibration"


def _name(reader: object) -> str:
    return str(getattr(reader, "__name__", reader)).rsplit(".", 1)[1]


def _readable(files: list[Path]) -> list[Section]:
    documents = []
    for file in files:
        with suppress(CalibrationError):
            documents.append(load_document(file))
    return documents


def _pair_of_paths(path: Path) -> tuple[Path, Path]:
    parts = str(path).split(",")
    if len(parts) == 2:
        return Path(parts[0].strip()), Path(parts[1].strip())
    if path.suffix:
        raise CalibrationError(
            f"{path}: ROS keeps a rig in two files: give left.yaml,right.yaml or a folder"
        )
    return path / "left.yaml", path / "right.yaml"
