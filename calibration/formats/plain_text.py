"""Notations of calibrations that are lines of numbers: ``P0: 718.8 0 ...``, ``cam0=[...]``, tables, sections."""

import configparser
import re
import tomllib
from typing import Any

from calibration.bounded_text import load_toml
from calibration.errors import CalibrationError
from calibration.formats import calib_filter, colmap
from calibration.formats.leaves import MAX_NUMBERS

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
        return _parse_lines(re.sub(r"\[[^\]]*\]", lambda matrix: " ".join(matrix[0].split()), text), "=")
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
    """Middlebury's and MATLAB's ``cam0=[1733.74 0 792.27; 0 1733.74 541.89; 0 0 1]``, KITTI's ``P0: 718.8 0 607.1 ...``."""
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
    """A matrix alone, as numpy.savetxt writes it, or K, R, t and distortion with blank lines between (KRTD)."""
    try:
        blocks = [[float(word) for word in re.split(r"[\s,;]+", block.strip())] for block in re.split(r"\n\s*\n", text.strip())]
    except ValueError:
        return None
    if [len(block) for block in blocks[:3]] == [9, 9, 3]:
        return dict(zip("KRTD", blocks, strict=False))
    return {"matrix": blocks[0]} if len(blocks) == 1 and 2 <= len(blocks[0]) <= MAX_NUMBERS else None


def _report(text: str) -> dict[str, Any] | None:
    """A text for people: lines that end with a matrix as NumPy prints it, or stand above one; None without two of them."""
    found = re.findall(r"^[ \t]*([A-Za-z][^\n:=\[]*?)[ \t]*[:=]?\s*(\[[-+.\deE\s\[\]]*\])\s*$", text, re.MULTILINE)
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
    """ost.txt, which ROS's calibrator packs beside its YAML: a section a camera, a line that names each matrix before its rows."""
    cameras: dict[str, Any] = {}
    size: dict[str, Any] = {}
    for name, body in re.findall(r"^\[(.+)\]\s*$([^\[]*)", text, re.MULTILINE):
        found = re.findall(r"^([a-z][a-z ]*)$([^a-z]*)", body, re.MULTILINE)
        values = {key.strip(): numbers.split() for key, numbers in found}
        if name == "image":
            size = {f"image_{key}": value for key, value in values.items()}
        else:
            cameras[name] = {OST_KEYS.get(key, key): value for key, value in values.items()} | {"camera_name": name}
    return {name: camera | size for name, camera in cameras.items()}


def _rows_of_twelve(text: str) -> list[list[str]] | None:
    """KITTI's projections without their names: two or four lines of twelve numbers, the first three a focal length in pixels."""
    rows = [line.split() for line in text.splitlines() if line.strip()]
    if len(rows) not in (2, 4) or any(len(row) != 12 for row in rows):
        return None
    try:
        focal = all(float(row[0]) > LEAST_FOCAL_PX and float(row[10]) == 1 for row in rows)
    except ValueError:
        return None
    return rows if focal else None
