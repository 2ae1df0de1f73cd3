"""Tracks in JSON as tables of text, and tables below lines that are not part of them."""

import csv
import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.bounded_text import load_json
from calibration.formats.reading.section import flat
from stereo_seecolor.inputs.trajectories.columns import named
from stereo_seecolor.inputs.trajectories.table import Lines, is_number

MATRICES = (12, 16)
FIRST = ("name", "time")
_INTO_CAMERA = re.compile(
    r"w(orld)?_?(to|2)_?c|cam(era)?_from_world|T_?c(am(era)?)?_?w|extrinsic", re.IGNORECASE
)
"""In the name of a matrix from the world's axes to the camera's."""
MOST_LINES_ABOVE = 40
"""Of a table: titles and remarks of the program that wrote it."""


def below(lines: Lines) -> Iterator[Lines]:
    """The lines without the first, the first two, and so on, up to MOST_LINES_ABOVE; those that
    begin with a line of names, none of which is a number.
    """
    content = lines.content
    for above, line in enumerate(lines.all[:MOST_LINES_ABOVE], start=1):
        content = content[1:] if content and content[0][1] == line else content
        rest = replace(lines, all=lines.all[above:], content=content)
        if content and not any(map(is_number, re.split(r"[,;\t|]\s*|\s", rest.header))):
            yield rest


def of_json(lines: Lines) -> Lines | None:
    """A list of records, lines of them, lists by column, or GeoJSON as a table; else None."""
    try:
        content = load_json("\n".join(lines.all))
    except ValueError:
        try:
            content = [load_json(line) for line in lines.all]
        except ValueError:
            return None
    records = _records(content)
    if len(records) < 2:  # deeper, below what is of the file or of a device
        records = max(_lists_of_records(content), key=len, default=records)
    records = [_flat(record) for record in records]
    if len(matrices := [row for record in records if (row := _matrix_row(record))]) > 1:
        return Lines(lines.path, tuple(matrices), tuple(enumerate(matrices, start=1)))
    names = list(dict.fromkeys(name for record in records for name in record))
    if len(records) < 2 or not names:
        return None
    text = io.StringIO()
    table = csv.DictWriter(text, names, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(records)
    rows = text.getvalue().splitlines()
    return Lines(lines.path, tuple(rows), tuple(enumerate(rows, start=1)))


def _records(content: Any) -> list[Mapping[str, Any]]:
    if isinstance(content, Mapping) and isinstance(content.get("features"), list):
        return [
            {**(one.get("properties") or {}), **_place(one.get("geometry"))}
            for one in content["features"]
            if isinstance(one, Mapping)
        ]
    if isinstance(content, Mapping):
        lists = {
            key: value
            for key, value in content.items()
            if isinstance(value, list) and not any(isinstance(one, list) for one in value)
        }
        sizes = {len(value) for value in lists.values()}
        if len(lists) > 1 and len(sizes) == 1:
            return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
        if len(lists) == 1:
            return _records(next(iter(lists.values())))
        return [
            {"name": key, **(value if isinstance(value, Mapping) else {"pose": value})}
            for key, value in content.items()
            if isinstance(value, Mapping | list)
        ]
    return [one for one in content if isinstance(one, Mapping)] if isinstance(content, list) else []


def _lists_of_records(content: Any) -> Iterator[list[Mapping[str, Any]]]:
    if isinstance(content, list) and all(isinstance(one, Mapping) for one in content):
        yield content
    elif isinstance(content, Mapping | list):
        for one in content.values() if isinstance(content, Mapping) else content:
            yield from _lists_of_records(one)


def _place(geometry: Any) -> dict[str, Any]:
    point = geometry.get("coordinates") if isinstance(geometry, Mapping) else None
    if not isinstance(point, list) or len(point) < 2 or not isinstance(point[0], int | float):
        return {}
    return {"lon": point[0], "lat": point[1]}


def _flat(record: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in record.items():
        name = f"{before}{key}"
        if isinstance(value, Mapping):
            found |= _flat(value, f"{name}.")
        elif isinstance(value, list):
            numbers = [float(one) for one in flat(value) if isinstance(one, int | float)]
            axes = {3: "xyz", 4: "xyzw"}.get(len(numbers))
            if axes:
                found |= {f"{name}.{axis}": one for axis, one in zip(axes, numbers, strict=True)}
            elif len(numbers) in MATRICES:
                found[name] = numbers
        elif value is not None:
            found[name] = value
    return found


def _matrix_row(record: Mapping[str, Any]) -> str:
    """A name or time and the one matrix of a record as a row of numbers; "" for another record."""
    matrices = {name: value for name, value in record.items() if isinstance(value, list)}
    first = next((str(v) for n, v in record.items() if (own := named(n)) and own.role in FIRST), "")
    if len(matrices) != 1 or not re.search(r"\d|\.", first):  # left and right are a rig's
        return ""
    ((name, numbers),) = matrices.items()
    matrix = np.vstack([np.reshape(numbers, (-1, 4)), [0, 0, 0, 1]])[:4]
    if _INTO_CAMERA.search(name):
        matrix = np.linalg.inv(matrix)
    return " ".join([first.replace(" ", "_"), *map(repr, matrix.ravel().tolist())])
