"""Paths that records in OUT name: believed only where they lie in OUT, whoever wrote the records.

An OUT may come by mail or from a share. What its records name is deleted, replaced, read, and
linked into other folders; so ``manifest`` and ``campaign_table`` check every name here, where
records are read, before anything else sees it.
"""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from stereo_seecolor.errors import OutputError
from stereo_seecolor.run_folder.layout import (
    DIVE_FILES,
    INDEX,
    MANIFEST,
    MAP,
    ORIGINAL,
    PAGE,
    PAGE_PRODUCTS,
    PRODUCTS,
    SET_ASIDE,
    STATE,
    state,
)

_FOLDERS = frozenset((*PRODUCTS, *PAGE_PRODUCTS))
OWN_FOLDERS = (
    *dict.fromkeys(
        name.partition("/")[0] for name in (*PRODUCTS, ORIGINAL, MAP, PAGE, STATE, SET_ASIDE)
    ),
)


class ForeignPathError(ValueError):
    """A record that names what does not lie in OUT."""


def check_own_paths(paths: Iterable[object]) -> None:
    """Raise ForeignPathError for a name that is not a plain path of a file below OUT, in the form
    in which this program writes it.
    """
    for path in paths:
        if not isinstance(path, str) or not _is_plain(path):
            raise ForeignPathError(f"it names {path!r}, which is not in this folder")


def check_product_paths(paths: Iterable[object]) -> None:
    """Raise ForeignPathError for a name that is not a file in a product's folder."""
    paths = list(paths)
    check_own_paths(paths)
    for path in paths:
        if not any(str(path).startswith(f"{folder}/") for folder in _FOLDERS):
            raise ForeignPathError(f"it names {path!r}, which is not in a folder of products")


def is_plain_name(name: object) -> bool:
    """Tell whether ``name`` is one part of a path: no folder before it, no way up."""
    return isinstance(name, str) and _is_plain(name) and "/" not in name


def _is_plain(path: str) -> bool:
    native = Path(path)
    parts = path.split("/")
    if "\0" in path or native.is_absolute() or native.drive or native.root:
        return False
    return all(part not in ("", ".", "..") for part in parts) and (
        os.sep == "/" or os.sep not in path
    )


def refuse_links(root: Path) -> None:
    """Raise OutputError where a folder that the program writes into is a link: it would lead out of
    OUT; files of products that are links are replaced as such, never what they lead to.
    """
    for name in OWN_FOLDERS:
        for path in (root / name, *_links_below(root / name)):
            if path.is_symlink() and (path.is_dir() or name == STATE):
                raise OutputError(
                    f"{path}: is a link, and nothing is written outside of {root}: remove it, or "
                    "choose another --out"
                )


def refuse_own_place(*paths: Path) -> None:
    """Raise OutputError for a file or folder to be written into a folder of products of a run,
    which the next command of that run would replace or refuse.
    """
    for path in paths:
        place = path.resolve()
        for root in place.parents:
            name = place.relative_to(root).parts[0]
            if name in OWN_FOLDERS and state(root, MANIFEST).is_file():
                raise OutputError(
                    f"{path}: is in {name} of the run {root}, which contains only files of the "
                    "program: choose another folder"
                )


def refuse_links_out(root: Path) -> None:
    """Raise OutputError where a file or folder to be read is a link that leads out of OUT.

    What was set aside is never read, and may hold a link of the user's.
    """
    inside, folders = root.resolve(), [name for name in OWN_FOLDERS if name != SET_ASIDE]
    top = (root / name for name in (*folders, *DIVE_FILES, INDEX))
    for path in (*top, *(path for name in folders for path in _links_below(root / name))):
        if path.is_symlink() and not path.resolve().is_relative_to(inside):
            raise OutputError(
                f"{path}: is a link that leads out of {root}: put the file itself in its place"
            )


def _links_below(folder: Path) -> Iterator[Path]:
    """All links below a folder, none followed; the system says what is one as it lists a folder."""
    if folder.is_symlink() or not folder.is_dir():
        return
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_symlink():
                yield Path(entry.path)
            elif entry.is_dir(follow_symlinks=False):
                yield from _links_below(Path(entry.path))
