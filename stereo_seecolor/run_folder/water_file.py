"""water.json: the water that was fitted, with its standard errors; can be given back to another run with --water."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stereo_seecolor.errors import ColorError, InputError
from stereo_seecolor.water import Water, read_water_document, water_document


def waters_content(waters: Mapping[str, Water], light: Mapping[str, Any] | None = None) -> bytes:
    """The content of a water.json: one water for all frames if they share it, else each frame's under its name.

    light: what was divided out of the frames before.
    """
    first = next(iter(waters.values())).content() if waters else None
    shared = first is not None and all(water.content() == first for water in set(waters.values()))
    body = {"water": first} if shared else {"frames": {name: water.content() for name, water in waters.items()}}
    return water_document(body | ({"light": light} if light else {}))


def read_waters(path: Path, names: Sequence[str]) -> dict[str, Water]:
    """The water of each of ``names``: the file's one water, or each frame's own.

    Raises InputError if the file is no water.json, or holds waters of single frames and one of ``names`` is not among them.
    """
    content = read_water_document(path)
    if "water" in content:
        return dict.fromkeys(names, _water(content["water"], path))
    frames = content.get("frames")
    frames = frames if isinstance(frames, dict) else {}
    missing = [name for name in names if name not in frames]
    if missing:
        raise InputError(f"{path}: holds each frame's own water, and none for {missing[0]!r}: fit it with color.lock=survey")
    return {name: _water(frames[name], path) for name in names}


def read_known_waters(path: Path, names: Sequence[str]) -> dict[str, Water]:
    """As ``read_waters``, without those of ``names`` that the file holds none for. Raises InputError."""
    frames = read_water_document(path).get("frames")
    known = [name for name in names if name in frames] if isinstance(frames, dict) else names
    return read_waters(path, known)


def _water(content: Any, path: Path) -> Water:
    try:
        return Water.from_content(content)
    except ColorError as error:
        raise InputError(f"{path}: {error}") from error
