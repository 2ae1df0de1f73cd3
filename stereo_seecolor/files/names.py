"""File names: their natural order, and the names of frames and outputs that are made from them."""

import hashlib
import os
import re
from pathlib import Path, PurePath

from stereo_seecolor.errors import printable

MAX_NAME_BYTES = 180
"""File systems take 255 bytes; a suffix (5) and a temporary prefix (40) must fit too."""

_HASH_DIGITS = 8  # hexadecimal: two names of a dive share them by chance in one of 400 million


_DIGITS = re.compile("[0-9]+")
_ALIKE = str.maketrans("123456789", "000000000")


def natural_key(name: str) -> str:
    """Make a sort key that reads runs of digits as numbers, so that frame2 comes before frame10;
    ties are broken by the name itself.

    A number is written as a character that sorts before all others, how many digits it has, and
    these. One text and no tuple: a folder may hold a million names.
    """
    return f"{_DIGITS.sub(_number_key, name.casefold())}\0\0{name}"


def sort_naturally(names: list[str]) -> None:
    """Sort by ``natural_key``; names that differ in digits alone ten times faster."""
    shape = names[0].translate(_ALIKE) if names else ""
    alike = all(name.translate(_ALIKE) == shape for name in names)
    names.sort(key=None if alike else natural_key)


def stem_of(name: str) -> str:
    """A file's name without suffix; ``Path.stem`` takes 20 s for a million names."""
    return os.path.splitext(name)[0]  # noqa: PTH122


def _number_key(digits: re.Match[str]) -> str:
    number = digits[0].lstrip("0")
    return f"\0{chr(len(number) + 1)}{number}"


def product_name(stem: str) -> str:
    """The name that outputs get from an input's stem: valid UTF-8, on one line, of at most
    MAX_NAME_BYTES bytes.

    Bytes that are not UTF-8 and control characters are written as %XX. A longer name is cut, and a
    hash of the whole appended.
    """
    name = printable(stem)
    encoded = name.encode()
    if len(encoded) <= MAX_NAME_BYTES:
        return name
    return (
        f"{encoded[: MAX_NAME_BYTES - _HASH_DIGITS - 1].decode(errors='ignore')}~{short_hash(stem)}"
    )


def short_hash(text: str) -> str:
    """Eight hexadecimal digits that differ between texts; these need not be valid UTF-8."""
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:_HASH_DIGITS]


def stem_of_path(name: str) -> str:
    """The name of a file without folders, of either system, and suffix; "" where there is none."""
    return PurePath(name.replace("\\", "/")).stem


def folder_keys(name: str) -> list[str]:
    """Name frames whose file names begin anew in each folder: ``10h_0001`` and ``left_0001`` of
    ``10h/left/0001.png``.
    """
    path = PurePath(name.replace("\\", "/"))
    return [f"{folder}_{path.stem}" for folder in dict.fromkeys(path.parts[:-1])]


FORM = "%(asctime)s %(levelname)s %(name)s: %(message)s"
"""Form of a line of the log, by which ``is_log`` recognizes a file as a log of this program."""
_LINE = re.compile(
    rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} [A-Z]+ (stereo_seecolor|calibration)[.:]"
)


def is_log(path: Path) -> bool:
    """Tell whether a file begins as a log of this program does."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return bool(_LINE.match(file.read(200)))
