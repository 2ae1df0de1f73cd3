"""The image files of a folder, of several, or those that a pattern names."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from calibration.errors import counted
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key, product_name, sort_naturally, stem_of
from stereo_seecolor.files.whole_files import entry_problem
from stereo_seecolor.inputs.name_keys import side_of
from stereo_seecolor.inputs.patterns import (
    fits,
    folder_of,
    is_marked,
    is_pattern,
    matched_folders,
    split_pattern,
)

EXTENSIONS = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm"})
RANGE_EXTENSIONS = EXTENSIONS | {".pfm", ".exr", ".npy", ".npz", ".mat"}
"""Of range maps."""
_COMPRESSED = {".webp", ".jp2", ".j2k", ".jxl", ".avif", ".heic", ".heif", ".gif", ".exr"}
_RAW = {
    ".dng", ".arw", ".cr2", ".cr3", ".gpr", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2",
    ".srw", ".3fr", ".iiq",
}  # fmt: skip
UNREAD = frozenset(_COMPRESSED | _RAW)
"""Images that are not read: of other compressions, and of cameras as they are."""

DEEPER = 2
"""Levels of folders that hold nothing but the one below, above those of images, as on a card."""
BAG = re.compile(r"\.(bag|mcap|db3)(\.active)?(\.(zstd?|gz|lz4|bz2|xz|zip))?\Z", re.IGNORECASE)
"""Names of files of ROS bags, and of such that were compressed as a whole."""


@dataclass(frozen=True)
class Unpaired:
    """A file that no partner was found for, and why."""

    path: Path
    reason: str

    @property
    def name(self) -> str:
        """The name of its row in frames.csv."""
        return product_name(self.path.stem)


@dataclass(frozen=True)
class FolderFiles(Lazy[Path]):
    """Files of one folder, kept by their names: a million paths take ten times as much memory."""

    folder: Path
    names: Sequence[str]

    def __len__(self) -> int:
        return len(self.names)

    def item(self, number: int) -> Path:
        """The path of the file of this number."""
        return self.folder / self.names[number]


@dataclass(frozen=True)
class Listing:
    """The files of a source. files: regular files in natural order of their names. unreadable:
    named like images, but a folder, a pipe or a broken link.
    """

    files: Sequence[Path]
    unreadable: tuple[Unpaired, ...] = ()


def list_images(source: Path, what: str, kinds: frozenset[str] = EXTENSIONS) -> Listing:
    """List the files of a source that have the extension of an image, or another of ``kinds``;
    hidden files are left out.

    source: a folder, one image, or a folder and a pattern for the names in it, for rigs whose sides
    share one: ``DIVE/*_L.png``; or several folders, see ``folder_parts``.
    Raises InputError if the folder is missing, cannot be read, or holds no such image.
    """
    if source.is_file() and _is_image(source.name, "*", kinds):
        return Listing((source,))
    parts = folder_parts(source, kinds)
    return (
        _together([list_images(one, what, kinds) for one in parts.values()])
        if parts
        else _in_folder(source, what, kinds)
    )


def folder_parts(source: Path, kinds: frozenset[str] = EXTENSIONS) -> dict[str, Path]:
    """The folders (or patterns for one folder's files) of a source, in natural order, by the part
    of the name in which they differ.

    Those that a pattern matches (``10h`` and ``11h`` for ``DIVE/*/left``). Those in a folder that
    holds no image itself: cameras begin a new one every so many images, or every hour. None for one
    folder, one image, or a pattern for the names in one folder. Raises InputError for a pattern
    that matches folders of both sides, or of several parts and nothing.
    """
    folder, parts = split_pattern(source)
    if not parts:
        return (
            {}
            if holds_images(folder, kinds)
            else {path.name: path for path in inner_folders(folder, kinds)}
        )
    matched = _matched(folder, parts, kinds)
    found = {
        key: one
        for key, one in matched
        if is_pattern(one) or one.is_file() or holds_images(one, kinds) or inner_folders(one, kinds)
    }
    if len({side_of(key) for key in found} - {None}) > 1:
        raise InputError(
            f"{source}: matches folders of both sides ({', '.join(found)}): write one side's name "
            "into the pattern"
        )
    if not found and len(parts) > 1:
        raise InputError(
            f"{source}: no folder of images, and no image, in {folder} fits this pattern"
        )
    return {} if list(found.values()) == [source] else found


def folders_of(source: Path, kinds: frozenset[str] = EXTENSIONS) -> tuple[Path, ...]:
    """Every folder (or the one image) that a source's files lie in. Raises as ``folder_parts``."""
    return tuple(map(folder_of, folder_parts(source, kinds).values() or (source,)))


def _matched(
    folder: Path, parts: Sequence[str], kinds: frozenset[str]
) -> Iterator[tuple[str, Path]]:
    """Sources below a folder that the parts of a pattern stand for, each with the names that its
    marks were matched by.
    """
    part, *rest = parts
    if not rest and (
        (folder / part).is_file() or (is_marked(part) and holds_images(folder, kinds, part))
    ):
        yield "", folder / part
        return
    for name, inner in matched_folders(folder, part).items():
        for key, one in _matched(inner, rest, kinds) if rest else [("", inner)]:
            yield "_".join(filter(None, (name, key))), one


def holds_images(folder: Path, kinds: frozenset[str] = EXTENSIONS, pattern: str = "*") -> bool:
    """Tell whether an image lies directly in a folder."""
    try:
        with os.scandir(folder) as entries:
            return any(_is_image(entry.name, pattern, kinds) for entry in entries)
    except OSError:
        return False  # said of the folder itself


def inner_folders(
    folder: Path, kinds: frozenset[str] = EXTENSIONS, deeper: int = DEEPER
) -> list[Path]:
    """The folders directly in one that hold images, or in the only one that holds such folders
    (``DCIM``), in natural order; none where their names are those of both sides.
    """
    below: list[Path] = []
    with suppress(OSError):  # said of the folder itself
        below = [
            path
            for path in folder.iterdir()
            if path.is_dir() and not path.is_symlink() and not path.name.startswith(".")
        ]
    inner = [path for path in below if holds_images(path, kinds)]
    if not inner and deeper:
        found = [own for path in below if (own := inner_folders(path, kinds, deeper - 1))]
        return found[0] if len(found) == 1 else []
    sides = {side_of(path.name) for path in inner} - {None}
    return [] if len(sides) > 1 else sorted(inner, key=lambda path: natural_key(path.name))


def _together(listings: Sequence[Listing]) -> Listing:
    files = tuple(file for listing in listings for file in listing.files)
    return Listing(files, tuple(file for listing in listings for file in listing.unreadable))


def _in_folder(source: Path, what: str, kinds: frozenset[str]) -> Listing:
    """The images directly in a folder, or those of them that a pattern names."""
    folder, pattern = (source.parent, source.name) if is_pattern(source) else (source, "*")
    names, others, problems = [], [], []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if not _is_image(entry.name, pattern, kinds):
                    others.append(entry.name)
                elif problem := entry_problem(entry):
                    problems.append(Unpaired(folder / entry.name, problem))
                else:
                    names.append(entry.name)
    except FileNotFoundError as error:
        raise InputError(f"{folder}: the folder of {what} does not exist") from error
    except NotADirectoryError as error:
        raise InputError(f"{folder}: is a file; give the folder of {what}") from error
    except OSError as error:
        raise InputError(
            f"{folder}: the folder of {what} cannot be read: {error.strerror}"
        ) from error
    if not names:
        named = f" named {pattern}" if is_pattern(source) else ""
        seen = [*others, *(file.path.name for file in problems)]
        hint = unread_hint(seen) or _other_hint(seen, kinds)
        raise InputError(f"{folder}: holds no {what}{named} ({', '.join(sorted(kinds))}){hint}")
    sort_naturally(names)
    problems.sort(key=lambda file: natural_key(file.path.name))
    return Listing(FolderFiles(folder, names), tuple(problems))


def unread_hint(names: Iterable[str]) -> str:
    """Say what to do with bags, and with images of kinds that are not read, to end a message with;
    "" where there are none.
    """
    names = list(names)
    bag = next((name for name in names if BAG.search(name)), None)
    if bag:
        return f"; {bag} is a ROS bag: see what it holds with stereo-seecolor bag-info {quote(bag)}"
    kinds = Counter(suffix for name in names if (suffix := Path(name).suffix.lower()) in UNREAD)
    if not kinds:
        return ""
    (suffix, count), *_ = kinds.most_common(1)
    what = f"{counted(count, 'file')} of a kind that is not read ({suffix})"
    return f"; {what}: convert them to PNG, or to TIFF if they are deeper than 8 bits"


def _other_hint(names: Sequence[str], kinds: frozenset[str]) -> str:
    """Name the kind that most files of a folder are of, where none is read; "" without files."""
    suffixes = Counter(suffix for name in names if (suffix := Path(name).suffix.lower()))
    if not suffixes:
        return ""
    (suffix, count), *_ = suffixes.most_common(1)
    what = (
        ": save them as .npy or TIFF, meters along the ray of each pixel" if ".npy" in kinds else ""
    )
    return f"; {counted(count, 'file')} of another kind ({suffix}){what}"


def _is_image(name: str, pattern: str, kinds: frozenset[str]) -> bool:
    suffix = name[len(stem_of(name)) :]
    return suffix.lower() in kinds and fits(name, pattern)
