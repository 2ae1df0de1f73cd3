"""The image files of a folder, or those of them that a pattern names."""

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from calibration.wording import counted
from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key, product_name, sort_naturally, stem_of
from stereo_seecolor.files.reading import entry_problem

EXTENSIONS = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg"})
UNREAD = frozenset(
    {".bmp", ".webp", ".pgm", ".ppm", ".jp2", ".dng", ".arw", ".cr2", ".cr3", ".gpr", ".nef", ".orf", ".raf", ".raw", ".heic"}
)
"""Images that are not read."""


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
    if not names:
        named = f" named {pattern}" if is_pattern(source) else ""
        hint = unread_hint([*others, *(file.path.name for file in problems)])
        raise InputError(f"{folder}: holds no {what}{named} ({', '.join(sorted(EXTENSIONS))}){hint}")
    sort_naturally(names)
    problems.sort(key=lambda file: natural_key(file.path.name))
    return Listing(FolderFiles(folder, names), tuple(problems))


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
