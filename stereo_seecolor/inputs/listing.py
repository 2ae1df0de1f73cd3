"""The image files of a folder, or those of them that a pattern names."""

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from calibration.wording import counted
from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key, product_name, sort_naturally, stem_of
from stereo_seecolor.files.reading import entry_problem
from stereo_seecolor.inputs.name_keys import side_of

EXTENSIONS = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm"})
_COMPRESSED = {".webp", ".jp2", ".j2k", ".jxl", ".avif", ".heic", ".heif", ".gif", ".exr"}
_RAW = {".dng", ".arw", ".cr2", ".cr3", ".gpr", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".srw", ".3fr", ".iiq"}
UNREAD = frozenset(_COMPRESSED | _RAW)
"""Images that are not read: of other compressions, and of cameras as they are."""


@dataclass(frozen=True)
class Unpaired:
    """A file that no partner was found for, and why."""

    path: Path
    reason: str

    @property
    def name(self) -> str:
        """What its row in frames.csv is called."""
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
    """files: regular files in natural order of their names. unreadable: named like images, but a folder, a pipe or a lost link."""

    files: Sequence[Path]
    unreadable: tuple[Unpaired, ...] = ()


def is_pattern(source: Path) -> bool:
    """True for ``DIVE/left*.png``: a last part that holds ``*``, ``?`` or ``[``, and is not the name of something that is there."""
    return any(mark in source.name for mark in "*?[") and not source.exists()


def folder_of(source: Path) -> Path:
    """What a source's files lie in: the folder that a pattern is to be looked for in, else the source itself."""
    return source.parent if is_pattern(source) else source


def list_images(source: Path, what: str) -> Listing:
    """The files directly in a folder with the extension of an image; hidden files are none of them.

    source: a folder, one image, or a folder and a pattern for the names in it, for rigs whose sides share one: ``DIVE/*_L.png``.
    A folder that holds no image itself stands for those in it: cameras begin a new one every so many images, or every hour.
    Raises InputError if the folder is missing, cannot be read, or holds no such image.
    """
    if source.is_file() and _is_image(source.name, "*"):
        return Listing((source,))
    folder, pattern = folder_of(source), source.name if is_pattern(source) else "*"
    names, others, problems = [], [], []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if not _is_image(entry.name, pattern):
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
        raise InputError(f"{folder}: the folder of {what} cannot be read: {error.strerror}") from error
    if not names and (inner := inner_folders(folder)) and not is_pattern(source):
        return _together([list_images(one, what) for one in inner])
    if not names:
        named = f" named {pattern}" if is_pattern(source) else ""
        hint = unread_hint([*others, *(file.path.name for file in problems)])
        raise InputError(f"{folder}: holds no {what}{named} ({', '.join(sorted(EXTENSIONS))}){hint}")
    sort_naturally(names)
    problems.sort(key=lambda file: natural_key(file.path.name))
    return Listing(FolderFiles(folder, names), tuple(problems))


def inner_folders(folder: Path) -> list[Path]:
    """The folders directly in one that hold images, in natural order; none where their names are those of both sides."""
    inner = []
    with suppress(OSError):  # said of the folder itself
        inner = [path for path in folder.iterdir() if path.is_dir() and not path.is_symlink() and not path.name.startswith(".")]
        inner = [path for path in inner if any(_is_image(file.name, "*") for file in path.iterdir())]
    sides = {side_of(path.name) for path in inner} - {None}
    return [] if len(sides) > 1 else sorted(inner, key=lambda path: natural_key(path.name))


def _together(listings: Sequence[Listing]) -> Listing:
    files = tuple(file for listing in listings for file in listing.files)
    return Listing(files, tuple(file for listing in listings for file in listing.unreadable))


def unread_hint(names: Iterable[str]) -> str:
    """What to do with images of kinds that are not read, to end a message with; "" where there are none."""
    kinds = Counter(suffix for name in names if (suffix := Path(name).suffix.lower()) in UNREAD)
    if not kinds:
        return ""
    (suffix, count), *_ = kinds.most_common(1)
    what = f"{counted(count, 'file')} of a kind that is not read ({suffix})"
    return f"; {what}: convert them to PNG, or to TIFF if they are deeper than 8 bits"


def _is_image(name: str, pattern: str) -> bool:
    suffix = name[len(stem_of(name)) :]
    return suffix.lower() in EXTENSIONS and not name.startswith(".") and (pattern == "*" or fnmatchcase(name, pattern))
