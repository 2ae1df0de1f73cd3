"""water.json: the fitted water with its standard errors; another run takes it with --water."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stereo_seecolor.compute.names import ByName
from stereo_seecolor.errors import ColorError, InputError
from stereo_seecolor.files.json_values import JsonText, Streamed
from stereo_seecolor.water.model import Water, read_water_document, water_document


def waters_content(waters: Mapping[str, Water], light: Mapping[str, Any] | None = None) -> JsonText:
    """Make the content of a water.json: one water if all frames share it, else each frame's under
    its name.

    light: what was divided out of the frames before.
    """
    contents = {
        id(water): water.content()
        for water in {id(water): water for water in waters.values()}.values()
    }
    first = next(iter(contents.values()), None)
    shared = first is not None and all(content == first for content in contents.values())
    frames = Streamed(lambda: ((name, contents[id(water)]) for name, water in waters.items()))
    body: dict[str, Any] = {"water": first} if shared else {"frames": frames}
    return water_document(body | ({"light": light} if light else {}))


def read_waters(path: Path, names: Iterable[str]) -> Mapping[str, Water]:
    """Read the water of each of ``names``: the file's one water, or each frame's own.

    Raises InputError if the file is not a water.json, or holds waters of single frames and one of
    ``names`` is not among them.
    """
    content = read_water_document(path)
    if "water" in content:
        shared = _water(content["water"], path)
        return ByName((name, shared) for name in names)
    frames = content.get("frames")
    frames = frames if isinstance(frames, dict) else {}
    found, read = ByName[Water](), dict[str, Water]()
    for name in names:
        if name not in frames:
            raise InputError(
                f"{path}: contains separate water parameters for each frame, and none for "
                f"{name!r}: fit them with color.lock=survey"
            )
        text = repr(frames[name])
        if text not in read:
            read[text] = _water(frames[name], path)
        found.put(name, read[text])
    return found


def read_known_waters(path: Path, names: Sequence[str]) -> Mapping[str, Water]:
    """Read the waters of those of ``names`` that the file holds one for. Raises InputError."""
    frames = read_water_document(path).get("frames")
    known = [name for name in names if name in frames] if isinstance(frames, dict) else names
    return read_waters(path, known)


def _water(content: Any, path: Path) -> Water:
    try:
        return Water.from_content(content)
    except ColorError as error:
        raise InputError(f"{path}: {error}") from error
