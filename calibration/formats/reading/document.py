"""A calibration file as keys and values, whatever it is written in: YAML, OpenCV's YAML, XML, JSON,
INI, ``key=value``, or binary.

Bounded on purpose: a calibration is a few kilobytes, so larger files, deep nesting and alias bombs
are refused before they cost time, and only plain data is ever built (no tags that run code, no XML
entities).
"""

import re
import stat
import tomllib
from collections import Counter
from contextlib import suppress
from json import JSONDecodeError
from operator import itemgetter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from calibration.bounded_text import (
    MAX_VALUES,
    TooMuchError,
    decode_text,
    load_json,
    load_toml,
    load_xml,
    load_yaml,
    values_of,
)
from calibration.errors import CalibrationError
from calibration.formats.calibration_format import NATIVE, added_formats
from calibration.formats.reading.binary import is_binary, load_binary
from calibration.formats.reading.notations import named_numbers, numbers_of_text, read
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.unread_formats import foreign

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

    Raises CalibrationError if the file is not there, not text, too large, or in no known notation.
    """
    if _is_binary(path):
        return load_binary(path)
    if (decoded := _of_added_format(path)) is not None:
        return Section(str(path), decoded)
    text = _read_text(path)
    if kind := foreign(text):
        raise CalibrationError(f"{path}: {kind}")
    try:
        content = _parse(text)
        _refuse_long_integers(content)
        content = _with_numbers(content)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    except (RecursionError, TooMuchError) as error:
        raise CalibrationError(f"{path}: {TOO_MUCH}") from error
    except (yaml.YAMLError, ValueError, ElementTree.ParseError) as error:
        if "python/" in str(error):
            raise CalibrationError(
                f"{path}: holds Python objects, as yaml.dump writes NumPy's arrays, which could "
                "run code: write the arrays with .tolist()"
            ) from error
        raise CalibrationError(f"{path}: cannot be parsed: {_one_line(error)}") from error
    return Section(str(path), content)


def _of_added_format(path: Path) -> dict[str, Any] | None:
    """The content of a file in a notation of a format's own; None for other files."""
    try:
        if not path.is_file() or path.stat().st_size > MAX_BYTES:
            return None
        raw = path.read_bytes()
    except OSError:
        return None  # named where its text is read
    if NATIVE.encode() in raw:
        return None
    formats = added_formats().values()
    with naming(str(path)):
        found = (format.decode(raw) for format in formats if format.decode)
        return next((content for content in found if content is not None), None)


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
        text = decode_text(path.read_bytes())
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
                "Octave too)"
            ) from error
        raise CalibrationError(
            f"{path}: is not text (byte {error.start}): a calibration is a text file, is it the "
            "right one?"
        ) from error
    if not text.strip():
        raise CalibrationError(f"{path}: is empty")
    return text


def _parse(text: str) -> dict[str, Any]:
    start = text.lstrip()
    content: Any
    if start.startswith("<"):
        content = _parse_xml(start)
    elif start.startswith(("{", "[{")) or re.match(r"\[\s*\{", start):
        content = _parse_json(start)
    elif (lines := read(text)) is not None:
        content = lines
    else:
        content = _parse_notations(text)
    if isinstance(content, list) and content and all(isinstance(one, dict) for one in content):
        content = _numbered(content)
    if not isinstance(content, dict):
        raise CalibrationError(
            f"is not a calibration: it holds {type(content).__name__} where keys and values are "
            "expected"
        )
    return {str(key): value for key, value in content.items()}


def _numbered(mappings: list[dict[Any, Any]]) -> dict[Any, Any]:
    """A list of cameras as a mapping of them; a list of one, as COLMAP's, as the one."""
    if len(mappings) == 1:
        return mappings[0]
    return {str(i): mapping for i, mapping in enumerate(mappings)}


def _parse_notations(text: str) -> Any:
    """YAML, else TOML without sections, else names and numbers in any other notation."""
    try:
        content = _parse_yaml(_repair(text))
        if isinstance(content, dict | list):
            return content
        failure = None
    except yaml.constructor.ConstructorError:
        raise
    except yaml.YAMLError as error:
        content, failure = None, error
    with suppress(tomllib.TOMLDecodeError):
        return load_toml(text)
    if (numbers := named_numbers(text)) is not None:
        return numbers
    if failure:
        raise failure
    return content


def _with_numbers(value: Any, inside: bool = False) -> Any:
    """The content with numbers where text holds only these: ``"500 0 322"``, ``"0,5"``."""
    if isinstance(value, dict):
        return {key: _with_numbers(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_with_numbers(inner, True) for inner in value]
    if not isinstance(value, str) or re.fullmatch(r"[-+\w.]*", value):
        plain = isinstance(value, str) and re.fullmatch(r"[-+]?[\d.]+[dD][-+]?\d+", value)
        return float(re.sub("[dD]", "e", value)) if plain else value
    numbers = numbers_of_text(value, one=inside)
    return value if numbers is None else numbers[0] if len(numbers) == 1 else numbers


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """PyYAML's safe loader, in C if possible; knows OpenCV's matrices, refuses double keys."""

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


def _tuple(loader: _Loader, node: yaml.Node) -> Any:
    return loader.construct_sequence(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:python/tuple", _tuple)
_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _opencv_matrix)
_Loader.add_constructor("tag:yaml.org,2002:opencv-nd-matrix", _opencv_matrix)


def _parse_yaml(text: str) -> Any:
    """Of several documents in one file, such as the messages that ROS prints, one mapping of those
    that differ by more than their header.
    """
    try:
        return load_yaml(text, _Loader, MAX_DEPTH)
    except yaml.composer.ComposerError:
        parts = [part for part in re.split(r"^---\s*$", text, flags=re.MULTILINE) if part.strip()]
        documents = list(filter(None, (load_yaml(part, _Loader, MAX_DEPTH) for part in parts)))
        if not documents or not all(isinstance(document, dict) for document in documents):
            raise
        different = {
            repr({key: value for key, value in document.items() if key != "header"}): document
            for document in documents
        }
        return _numbered(list(different.values()))


def _repair(text: str) -> str:
    """Make YAML of what OpenCV and oplab write: `%YAML:1.0`, `data:[1,2]`, `PointSize:2`,
    `extrinsics: rotation_matrix:` on one line.
    """
    text = re.sub(r"\A\s*%YAML.*\n(---.*\n)?", "", text)
    text = re.sub(r"^([ \t]*[A-Za-z_][\w.]*):(?=[-+.\d\[])", r"\1: ", text, flags=re.MULTILINE)
    indent = re.search(r"^( +)translation_vector:", text, re.MULTILINE)
    if indent:
        text = re.sub(
            r"^extrinsics: +rotation_matrix:",
            f"extrinsics:\n{indent[1]}rotation_matrix:",
            text,
            flags=re.MULTILINE,
        )
    return text


_JSON_COMMENTS = re.compile(r'("(?:\\.|[^"\\])*"?)|//[^\n]*|/\*.*?(?:\*/|\Z)', re.DOTALL)
"""A text or comment without an end goes to the end of the file, so that each byte is seen once."""


def _parse_json(text: str) -> Any:
    try:
        content = load_json(text, _once_each)
    except JSONDecodeError:
        plain = _JSON_COMMENTS.sub(lambda found: found[1] or "", text)
        return _parse_yaml(plain)  # a YAML flow mapping starts like JSON
    return content


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        twice, _ = max(Counter(key for key, _ in pairs).items(), key=itemgetter(1))
        raise CalibrationError(f"{twice!r} is given twice: keep one")
    return content


def _parse_xml(text: str) -> dict[str, Any]:
    root = load_xml(text)
    content = _xml_value(root)
    if not isinstance(content, dict):
        raise CalibrationError(f"is not a calibration: its XML holds nothing but <{root.tag}>")
    return content


def _xml_value(element: ElementTree.Element, depth: int = 0) -> Any:
    """Numbers or words; a mapping of the elements in it, or of its attributes."""
    if depth > MAX_DEPTH:
        raise CalibrationError(TOO_MUCH)
    tags = {child.tag for child in element}
    if len(element) and (tags == {"_"} or (len(tags) == 1 < len(element) and _are_rows(element))):
        return [_xml_value(child, depth + 1) for child in element]
    words = (element.text or "").split()
    own = {} if words else {key: value for key, value in element.items() if key != "type_id"}
    if len(element) or own:
        named = [
            (child.get("name") or child.get("id") or child.tag, _xml_value(child, depth + 1))
            for child in element
        ]
        return _once_each([*named, *own.items()])
    return words[0] if len(words) == 1 else words


def _are_rows(element: ElementTree.Element) -> bool:
    return not any(len(child) or child.attrib for child in element)


def _refuse_long_integers(content: Any) -> None:
    for value in values_of(content, MAX_DEPTH):
        if isinstance(value, int) and abs(value) > MAX_INTEGER:
            raise CalibrationError(
                "holds a whole number of more than 18 digits, which no calibration does"
            )


def _one_line(error: Exception) -> str:
    return " ".join(str(error).replace(' in "<unicode string>",', "").split())[:200]
