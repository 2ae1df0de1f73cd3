"""A calibration file as keys and values, whatever it is written in."""

import configparser
import re
import stat
import tomllib
from collections import Counter
from json import JSONDecodeError
from operator import itemgetter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from calibration.errors import CalibrationError
from calibration.files import MAX_VALUES, TooMuchError, load_json, load_toml, load_yaml
from calibration.formats import colmap, metashape
from calibration.formats.others import calib_filter
from calibration.formats.reading.binary import is_binary, load_binary
from calibration.formats.reading.folder import foreign
from calibration.formats.reading.leaves import MAX_NUMBERS
from calibration.formats.reading.section import Section

# Notations of calibrations that are lines of numbers: ``P0: 718.8 0 ...``, ``cam0=[...]``,
# tables, sections.

LEAST_FOCAL_PX = 10  # tells a projection from a pose, whose numbers are cosines
OST_KEYS = {
    "camera matrix": "camera_matrix",
    "distortion": "distortion_coefficients",
    "rectification": "rectification_matrix",
    "projection": "projection_matrix",
}


def read(text: str) -> dict[str, Any] | None:
    """Keys and values of a text in one of these notations; None if it is in none."""
    if re.search(r"^(cam0|\w*IntrinsicMatrix\w*)\s*=\s*\[", text, re.MULTILINE):
        return _parse_lines(
            re.sub(r"\[[^\]]*\]", lambda matrix: " ".join(matrix[0].split()), text), "="
        )
    if re.search(r"^P(_rect_0)?[0-3]:[ \t]*[-+.\d]", text, re.MULTILINE):
        return _parse_lines(text, ":")
    if text.startswith("# oST version"):
        return _parse_ost(text)
    if re.search(r"^\d+ [A-Z_]+ \d+ \d+ [-\d.]", text, re.MULTILINE):
        return {colmap.CAMERAS: _table(text)}
    if re.search(r"^\d+ \d+ CAMERA \d+", text, re.MULTILINE):
        return {colmap.RIGS: _table(text)}
    if re.search(r"^\[[\w ]+\]\s*$", text, re.MULTILINE):
        return _parse_toml(text)
    if (numbers := calib_filter.read(text)) is not None:
        return numbers
    if (rows := _rows_of_twelve(text)) is not None:
        return {f"P{camera}": row for camera, row in enumerate(rows)}
    return _matrices(text) or _report(text)


def _parse_lines(text: str, mark: str) -> dict[str, Any]:
    """Middlebury's and MATLAB's ``cam0=[1733.74 0 792.27; 0 1733.74 541.89; 0 0 1]``, KITTI's ``P0:
    718.8 0 607.1 ...``.
    """
    pairs = (line.split(mark, 1) for line in text.splitlines() if mark in line)
    return {key.strip(): _value(value.strip(" \t;")) for key, value in pairs}


def _value(text: str) -> str | list[str]:
    """Numbers, of a matrix row by row; of text in quotes, as MATLAB writes it, the text."""
    if text[:1] in ("'", '"'):
        return text.strip("'\"")
    return text.strip("[]").replace(";", " ").replace(",", " ").split()


def _parse_toml(text: str) -> dict[str, Any]:
    """TOML, as Anipose and Pose2Sim write it, or an INI file."""
    try:
        return load_toml(text)
    except tomllib.TOMLDecodeError:
        return _parse_ini(text)


def _matrices(text: str) -> dict[str, Any] | None:
    """A matrix alone, as numpy.savetxt writes it, or K, R, t and distortion with blank lines
    between (KRTD).
    """
    try:
        blocks = [
            [float(word) for word in re.split(r"[\s,;]+", block.strip())]
            for block in re.split(r"\n\s*\n", text.strip())
        ]
    except ValueError:
        return None
    if [len(block) for block in blocks[:3]] == [9, 9, 3]:
        return dict(zip("KRTD", blocks, strict=False))
    return (
        {"matrix": blocks[0]} if len(blocks) == 1 and 2 <= len(blocks[0]) <= MAX_NUMBERS else None
    )


def _report(text: str) -> dict[str, Any] | None:
    """A text for people: lines that end with a matrix as NumPy prints it, or stand above one; None
    without two of them.
    """
    found = re.findall(
        r"^[ \t]*([A-Za-z][^\n:=\[]*?)[ \t]*[:=]?\s*(\[[-+.\deE\s\[\]]*\])\s*$", text, re.MULTILINE
    )
    matrices = {name: matrix.replace("[", " ").replace("]", " ").split() for name, matrix in found}
    matrices = {name: words for name, words in matrices.items() if len(words) > 2}
    return matrices if len(matrices) > 1 else None


def _parse_ini(text: str) -> dict[str, Any]:
    parser = configparser.RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise CalibrationError(f"cannot be parsed: {' '.join(str(error).split())[:200]}") from error
    return {name: dict(parser.items(name)) for name in parser.sections()}


def _table(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]


def _parse_ost(text: str) -> dict[str, Any]:
    """ost.txt, which ROS's calibrator packs beside its YAML: a section a camera, a line that names
    each matrix before its rows.
    """
    cameras: dict[str, Any] = {}
    size: dict[str, Any] = {}
    for name, body in re.findall(r"^\[(.+)\]\s*$([^\[]*)", text, re.MULTILINE):
        found = re.findall(r"^([a-z][a-z ]*)$([^a-z]*)", body, re.MULTILINE)
        values = {key.strip(): numbers.split() for key, numbers in found}
        if name == "image":
            size = {f"image_{key}": value for key, value in values.items()}
        else:
            cameras[name] = {OST_KEYS.get(key, key): value for key, value in values.items()} | {
                "camera_name": name
            }
    return {name: camera | size for name, camera in cameras.items()}


def _rows_of_twelve(text: str) -> list[list[str]] | None:
    """KITTI's projections without their names: two or four lines of twelve numbers, the first three
    a focal length in pixels.
    """
    rows = [line.split() for line in text.splitlines() if line.strip()]
    if len(rows) not in (2, 4) or any(len(row) != 12 for row in rows):
        return None
    try:
        focal = all(float(row[0]) > LEAST_FOCAL_PX and float(row[10]) == 1 for row in rows)
    except ValueError:
        return None
    return rows if focal else None


# A calibration file as keys and values, whatever it is written in: YAML, OpenCV's YAML, XML,
# JSON, INI, ``key=value``, or binary.
#
# Bounded on purpose: a calibration is a few kilobytes, so larger files, deep nesting and alias
# bombs are refused before they cost time, and only plain data is ever built (no tags that run
# code, no XML entities).

MAX_BYTES = 256 * 1024  # a calibration as text is a few kB
START_BYTES = 2048  # the first key of a file that is too large
MAX_DEPTH = 20  # levels; known formats have far fewer
MAX_INTEGER = 10**18  # larger ones overflow 64 bits when they become floats and back
ARCHIVES = (".gz", ".tgz", ".bz2", ".xz", ".zip", ".7z", ".rar")
TOO_MUCH = (
    f"holds more than {MAX_VALUES} values or {MAX_DEPTH} levels, which no calibration "
    "does: is it the right file?"
)


def load_document(path: Path) -> Section:
    """Read ``path`` into a Section, its values still unchecked.

    Raises CalibrationError if the file is not there, not text, too large, or in no notation known
    here.
    """
    if _is_binary(path):
        return load_binary(path)
    text = _read_text(path)
    if kind := foreign(text):
        raise CalibrationError(f"{path}: {kind}")
    try:
        content = _parse(text)
        _check_bounded(content)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    except (RecursionError, TooMuchError) as error:
        raise CalibrationError(f"{path}: {TOO_MUCH}") from error
    except (yaml.YAMLError, ValueError, ElementTree.ParseError) as error:
        raise CalibrationError(f"{path}: cannot be parsed: {_one_line(error)}") from error
    return Section(str(path), content)


def _is_binary(path: Path) -> bool:
    try:
        return path.is_file() and is_binary(path)
    except OSError:
        return False


def _read_text(path: Path) -> str:
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
            raise CalibrationError(f"{path}: is a device or a named pipe, not a file")
        if status.st_size > MAX_BYTES:
            with path.open("rb") as file:
                if kind := foreign(file.read(START_BYTES).decode(errors="replace")):
                    raise CalibrationError(f"{path}: {kind}")
            raise CalibrationError(
                f"{path}: is larger than {MAX_BYTES // 1024} kB: a calibration file holds a few "
                "kB, is it the right file?"
            )
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        if path.suffix in ARCHIVES:
            raise CalibrationError(
                f"{path}: is an archive: unpack it, and give the files of both cameras, "
                "left.yaml,right.yaml"
            ) from error
        if path.suffix.lower() == ".mat":
            raise CalibrationError(
                f"{path}: is not a MAT-file of MATLAB 5 or later: save it again, with -v7 (in "
                "Octave "
                "too)"
            ) from error
        raise CalibrationError(
            f"{path}: is not UTF-8 text (byte {error.start}): a calibration is a text file, is it "
            "the right one?"
        ) from error
    if not text.strip():
        raise CalibrationError(f"{path}: is empty")
    return text


def _parse(text: str) -> dict[str, Any]:
    start = text.lstrip()
    if start.startswith("<"):
        content = _parse_xml(start)
    elif start.startswith(("{", "[{")) or re.match(r"\[\s*\{", start):
        content = _parse_json(start)
    elif (lines := read(text)) is not None:
        content = lines
    else:
        content = _parse_yaml(_repair(text))
    if not isinstance(content, dict):
        raise CalibrationError(
            f"is not a calibration: it holds {type(content).__name__} where keys and values are "
            "expected"
        )
    return {str(key): value for key, value in content.items()}


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """PyYAML's safe loader, in C where it can be; knows OpenCV's matrices and refuses keys given
    twice.
    """

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        if isinstance(node, yaml.MappingNode) and len(mapping) < len(node.value):
            names = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
            twice, _ = max(names.items(), key=itemgetter(1), default=("a key", 2))
            raise CalibrationError(
                f"{twice!r} is given twice (line {node.start_mark.line + 1} and below): keep one"
            )
        return mapping


def _opencv_matrix(loader: _Loader, node: yaml.Node) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _opencv_matrix)
_Loader.add_constructor("tag:yaml.org,2002:opencv-nd-matrix", _opencv_matrix)


def _parse_yaml(text: str) -> Any:
    return load_yaml(text, _Loader, MAX_DEPTH)


def _repair(text: str) -> str:
    """Make YAML of what OpenCV and oplab write: `%YAML:1.0`, `data:[1,2]`, `extrinsics:
    rotation_matrix:` on one line; of the messages that ROS prints, each ended by `---`, take the
    first.
    """
    text = re.sub(r"\A\s*%YAML.*\n(---.*\n)?", "", text)
    if re.search(r"^(header|height):", text, re.MULTILINE):
        text = re.split(r"^---\s*$", text.removeprefix("---\n"), maxsplit=1, flags=re.MULTILINE)[0]
    text = re.sub(r"^(\s*[\w.]+):\[", r"\1: [", text, flags=re.MULTILINE)
    indent = re.search(r"^( +)translation_vector:", text, re.MULTILINE)
    if indent:
        text = re.sub(
            r"^extrinsics: +rotation_matrix:",
            f"extrinsics:\n{indent[1]}rotation_matrix:",
            text,
            flags=re.MULTILINE,
        )
    return text


def _parse_json(text: str) -> Any:
    try:
        content = load_json(text, _once_each)
    except JSONDecodeError:
        return _parse_yaml(text)  # a YAML flow mapping starts like JSON
    return (
        content[0] if isinstance(content, list) and len(content) == 1 else content
    )  # COLMAP's list of one rig


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        twice, _ = max(Counter(key for key, _ in pairs).items(), key=itemgetter(1))
        raise CalibrationError(f"{twice!r} is given twice: keep one")
    return content


def _parse_xml(text: str) -> dict[str, Any]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CalibrationError(
            "its XML declares entities, which no calibration needs: remove the DOCTYPE"
        )
    root = ElementTree.fromstring(text.encode())
    if root.tag == "document" and root.find("chunk") is not None:
        return metashape.read(root)
    content = _xml_value(root)
    if not isinstance(content, dict):
        raise CalibrationError(f"is not a calibration: its XML holds nothing but <{root.tag}>")
    return content


def _xml_value(element: ElementTree.Element, depth: int = 0) -> Any:
    if depth > MAX_DEPTH:
        raise CalibrationError(TOO_MUCH)
    if len(element) and all(child.tag == "_" for child in element):
        return [_xml_value(child, depth + 1) for child in element]
    if len(element):
        return _once_each([(child.tag, _xml_value(child, depth + 1)) for child in element])
    words = (element.text or "").split()
    return words[0] if len(words) == 1 else words


def _check_bounded(content: Any) -> None:
    """Walk as a reader would, following YAML aliases, and stop at the limit."""
    pending = [(content, 0)]
    seen = 0
    while pending:
        value, depth = pending.pop()
        seen += 1
        if seen > MAX_VALUES or depth > MAX_DEPTH:
            raise CalibrationError(TOO_MUCH)
        if isinstance(value, int) and abs(value) > MAX_INTEGER:
            raise CalibrationError(
                "holds a whole number of more than 18 digits, which no calibration does"
            )
        if isinstance(value, dict):
            pending.extend((child, depth + 1) for child in value.values())
        elif isinstance(value, list):
            pending.extend((child, depth + 1) for child in value)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).replace(' in "<unicode string>",', "").split())[:200]
