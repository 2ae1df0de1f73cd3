"""Files of text that people write, read within bounds; each error is one line with the file's
name.
"""

from pathlib import Path
from typing import Any

from calibration.files import YAML_ERRORS, load_json, load_yaml
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import read_bytes


def read_text(path: Path) -> str:
    """The text of a UTF-8 file. Raises InputError."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not UTF-8 text ({error.reason} at byte {error.start})"
        ) from error


def read_yaml(path: Path) -> Any:
    """The content of a YAML file. Raises InputError."""
    text = read_text(path)
    try:
        return load_yaml(text)
    except YAML_ERRORS as error:
        raise InputError(f"{path}: is not YAML: {' '.join(str(error).split())}") from error


def read_json(path: Path) -> Any:
    """The content of a JSON file. Raises InputError."""
    try:
        return load_json(read_bytes(path).removeprefix(b"\xef\xbb\xbf"))
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from error
