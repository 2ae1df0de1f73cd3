"""Patterns with ``*``, ``?`` and ``[``: for one folder's files, or folders (``DIVE/*/left``)."""

from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path

from stereo_seecolor.files.names import natural_key

_MARKS = "*?["


def split_pattern(source: Path) -> tuple[Path, tuple[str, ...]]:
    """The folder that a pattern is to be looked for in, and the parts below it, of which the first
    is a pattern; the source itself and no parts where it is none: where it holds no mark, or is the
    name of something that is there.
    """
    parts = source.parts
    for number, part in enumerate(parts):
        if is_marked(part) and not Path(*parts[: number + 1]).exists():
            return Path(*parts[:number]), parts[number:]
    return source, ()


def is_marked(part: str) -> bool:
    """Tell whether a name holds ``*``, ``?`` or ``[``."""
    return any(mark in part for mark in _MARKS)


def is_pattern(source: Path) -> bool:
    """Tell whether a path is a pattern, such as ``DIVE/left*.png`` and ``DIVE/*/left``."""
    return bool(split_pattern(source)[1])


def folder_of(source: Path) -> Path:
    """Find the folder of a source's files: the one that a pattern is to be matched in, else the
    source itself.
    """
    return split_pattern(source)[0]


def fits(name: str, pattern: str) -> bool:
    """Whether a pattern matches a name; case counts, and hidden names never match."""
    return not name.startswith(".") and (pattern == "*" or fnmatchcase(name, pattern))


def matched_folders(folder: Path, part: str) -> dict[str, Path]:
    """The folders directly in one that a part of a pattern stands for, in natural order, each by
    the name that was matched; by "" where the part is a name itself.
    """
    if not is_marked(part) or (folder / part).exists():
        return {"": folder / part} if (folder / part).is_dir() else {}
    found: list[Path] = []
    with suppress(OSError):  # nothing is matched in a folder that is missing, or cannot be read
        found = [path for path in folder.iterdir() if fits(path.name, part) and path.is_dir()]
    return {path.name: path for path in sorted(found, key=lambda path: natural_key(path.name))}
