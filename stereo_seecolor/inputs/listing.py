"""The image files of a folder."""

import os
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key, product_name
from stereo_seecolor.files.reading import entry_problem

EXTENSIONS = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg"})


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
class Listing:
    """files: regular files in natural order of their names. unreadable: named like images, but a folder, a pipe or a lost link."""

    files: tuple[Path, ...]
    unreadable: tuple[Unpaired, ...] = ()


def list_images(folder: Path, what: str) -> Listing:
    """The files directly in ``folder`` with the extension of an image; hidden files are none of them.

    Raises InputError if the folder is missing, cannot be read, or holds no image.
    """
    try:
        with os.scandir(folder) as entries:
            problems = {entry.name: entry_problem(entry) for entry in entries if _is_named_like_an_image(entry.name)}
    except FileNotFoundError as error:
        raise InputError(f"{folder}: the folder of {what} does not exist") from error
    except NotADirectoryError as error:
        raise InputError(f"{folder}: is a file; give the folder of {what}") from error
    except OSError as error:
        raise InputError(f"{folder}: the folder of {what} cannot be read: {error.strerror}") from error
    names = sorted(problems, key=natural_key)
    files = tuple(folder / name for name in names if not problems[name])
    if not files:
        raise InputError(f"{folder}: holds no {what} ({', '.join(sorted(EXTENSIONS))})")
    return Listing(files, tuple(Unpaired(folder / name, problems[name]) for name in names if problems[name]))


def _is_named_like_an_image(name: str) -> bool:
    return Path(name).suffix.lower() in EXTENSIONS and not name.startswith(".")
