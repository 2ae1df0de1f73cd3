"""Notations of calibrations that are lines of numbers: ``P0: 718.8 0 ...``, ``cam0=[...]``, tables,
sections, and numbers that are written as text.
"""

import configparser
import re
import tomllib
from collections.abc import Iterator
from typing import Any

from calibration.bounded_text import load_toml
from calibration.errors import CalibrationError
from calibration.formats import colmap
from calibration.formats.reading.leaves import MAX_NUMBERS, side_marks, words

LEAST_FOCAL_PX = 10  # tells a projection from a pose, whose numbers are cosines
LEAST_NAMED = 2  # matrices, or
LEAST_NUMBERS = 8  # numbers that a text for people names: two lenses have as many
OST_KEYS = {
    "camera matrix": "camera_matrix",
    "distortion": "distortion_coefficients",
    "rectification": "rectification_matrix",
    "projection": "projection_matrix",
}
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eEdD][-+]?\d+)?")
_BETWEEN = re.compile(r"[\s\[\](){},;]+")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?")
_AROUND = re.compile(
    r"(?:np\.|numpy\.)?\b(?:array|matrix|single|double)\(|(?:,\s*)?\bdtype\s*=\s*[\w.]+"
)
"""What NumPy and MATLAB write around numbers."""
_FACTOR = re.compile(r"\s*(\d(?:\.\d*)?e[-+]?\d+)[ \t]*\*\s")
"""Of a matrix as MATLAB's window displays it: ``1.0e+03 *`` above its rows."""
_ERROR = re.compile(r"(?:±|\+/-|\+-)[^\n]*")
"""The standard error behind a number or a vector."""
_LABELED = re.compile(
    r"^[A-Za-z][^\n:=\[]*:[ \t]+(\w+)[ \t]*=[ \t]*(\[[^\]\n]*\])[^\n]*", re.MULTILINE
)
"""As Bouguet's toolbox prints a result: ``Focal Length: fc_left = [ 767.5 764.2 ] ± [ 1.1 1.1 ]``,
in any encoding of the sign.
"""
_RULE = re.compile(r"^\s*([=*~-])\1+|([=*~-])\2+\s*$")
"""Around a heading: ``=== LEFT CAMERA ===``."""
_COMMENT = re.compile(r"%|#|//|\.\.\.\s*$")


def read(text: str) -> dict[str, Any] | None:
    """Keys and values of a text in one of these notations; None if it is in none."""
    if re.search(r"^(cam0|\w*IntrinsicMatrix\w*)\s*=\s*\[", text, re.MULTILINE):
        return _parse_lines(
            re.sub(r"\[[^\[\]]*\]", lambda matrix: " ".join(matrix[0].split()), text), "="
        )
    if re.search(r"^P(_rect_0)?[0-3]:[ \t]*[-+.\d]", text, re.MULTILINE):
        return _parse_lines(text, ":")
    if printed := _LABELED.findall(text):  # of results before and after optimization the last
        return {name: numbers_of_text(body) for name, body in printed}
    if text.startswith("# oST version"):
        return _parse_ost(text)
    if re.search(r"^\d+ [A-Z_]+ \d+ \d+ [-\d.]", text, re.MULTILINE):
        return {colmap.CAMERAS: _table(text)}
    if re.search(r"^\d+ \d+ CAMERA \d+", text, re.MULTILINE):
        return {colmap.RIGS: _table(text)}
    if re.search(r"^\[[\w ]+\]\s*$", text, re.MULTILINE):
        return _parse_toml(text)
    if (rows := _rows_of_twelve(text)) is not None:
        return {f"P{camera}": row for camera, row in enumerate(rows)}
    return _matrices(text) or _cells(text)


def numbers_of_text(text: str, one: bool = False) -> list[float] | None:
    """The numbers of a text that holds nothing else, with commas, semicolons, spaces or brackets
    between them; None for other text.

    one: ``0,5`` is one number, as it is everywhere where others stand beside it without a point.
    """
    if factor := _FACTOR.match(text):
        scaled = numbers_of_text(text[factor.end() :])
        return None if scaled is None else [float(factor[1]) * number for number in scaled]
    body = _AROUND.sub(" ", _ERROR.sub(" ", text))
    parts = re.sub(r"[\[\](){}]", " ", body.replace(";", " ")).split()
    if (
        "," in body
        and (one or len(parts) > 1)
        and all(_DECIMAL_COMMA.fullmatch(part) for part in parts)
    ):
        return [float(part.replace(",", ".")) for part in parts]
    numbers = [part for part in _BETWEEN.split(body) if part]
    if not numbers or not all(map(_NUMBER.fullmatch, numbers)):
        return None
    return [float(re.sub("[dD]", "e", number)) for number in numbers]


def named_numbers(text: str) -> dict[str, Any] | None:
    """A text for people or of a program: names with numbers after or below them, under headings or
    not; None for a text that names too few.
    """
    content: dict[str, Any] = {}
    sizes = []
    heading = twice = ""
    for name, body in _named(text):
        if not body.strip():
            heading = name
            continue
        numbers = numbers_of_text(body)
        sizes += [len(numbers)] if numbers else []
        own = content
        if heading:
            twice = twice or (heading if isinstance(content.get(heading), list) else "")
            # a text of the same name, as ``left: GoPro 7``, is no number of the rig
            own = content[heading] if isinstance(content.get(heading), dict) else {}
            content[heading] = own
        twice = twice or (name if name in own and numbers else "")
        own[name] = body.strip() if numbers is None else numbers
    if not (sum(size > 2 for size in sizes) >= LEAST_NAMED or sum(sizes) >= LEAST_NUMBERS):
        return None
    if twice:
        raise CalibrationError(f"{twice!r} is given twice: keep one")
    return content


def _named(text: str) -> Iterator[tuple[str, str]]:
    """Names, and the text after each up to the next."""
    name, body = "", ""
    for line in text.splitlines():
        plain = _RULE.sub("", _COMMENT.split(line)[0]).strip()
        marked = re.match(r"[\"']?([A-Za-z](?:[^:=\[]|\[[A-Za-z]+\])*)[:=]\s*(.*)", plain)
        bare = re.match(r"([A-Za-z]\w*)[\s,;]+(?=[-+.\d\[(])(.*)", plain) or re.match(
            r"([A-Za-z][^,;\[\]]*)()$", plain
        )
        if (found := marked or bare) and not _AROUND.match(plain):
            if name:
                yield name, body
            name, body = found[1].strip("\"' \t").removeprefix("self."), found[2]
        else:
            body += f"\n{plain}"
    if name:
        yield name, body


def _cells(text: str) -> dict[str, Any] | None:
    """A table with a row a parameter and a column a camera, or the reverse; None for other text."""
    rows = [_cells_of(line) for line in text.splitlines() if line.strip()]
    header = rows[0]
    if len(rows) < 3 or len(header) < 3 or any(len(row) != len(header) for row in rows):
        return None
    if any(numbers_of_text(cell) for cell in header[1:]):
        return None
    columns = {
        name: {row[0]: row[i] for row in rows[1:] if numbers_of_text(row[i])}
        for i, name in enumerate(header)
        if i
    }
    if not any(columns.values()):
        return None
    if any(side_marks(words(name)) for name in header[1:]):
        return columns
    return {
        row[0]: {name: own.get(row[0], "") for name, own in columns.items()} for row in rows[1:]
    }


def _cells_of(line: str) -> list[str]:
    mark = next((mark for mark in ";\t" if mark in line), ",")
    cells = [cell.strip() for cell in line.strip(" \r\n").split(mark)]
    decimals = [mark != "," and _DECIMAL_COMMA.fullmatch(cell) for cell in cells]
    return [
        cell.replace(",", ".") if decimal else cell
        for cell, decimal in zip(cells, decimals, strict=True)
    ]


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
    """A matrix alone, as numpy.savetxt writes it, also below names of its columns, or K, R, t and
    distortion with blank lines between (KRTD).
    """
    lines = text.strip().splitlines()
    cells = _cells_of(lines[0])
    if len(lines) > 1 < len(cells) and not any(re.match(r"\d|$|.*\s", cell) for cell in cells):
        lines = lines[1:] if not numbers_of_text(lines[0]) and numbers_of_text(lines[1]) else lines
    parts = re.split(r"\n\s*\n", "\n".join(lines))
    blocks = [numbers for part in parts if (numbers := numbers_of_text(part))]
    if len(blocks) < len(parts):
        return None
    if [len(block) for block in blocks[:3]] == [9, 9, 3]:
        return dict(zip("KRTD", blocks, strict=False))
    return (
        {"matrix": blocks[0]} if len(blocks) == 1 and 2 <= len(blocks[0]) <= MAX_NUMBERS else None
    )


def _parse_ini(text: str) -> dict[str, Any]:
    parser = configparser.RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        # its own pattern takes the square of a row of spaces
        parser.read_string(re.sub(r"[ \t]+", " ", text))
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
