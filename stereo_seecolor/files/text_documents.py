"""Files of text that people write, read within bounds: text, YAML, JSON; errors are one line."""

from pathlib import Path
from typing import Any

from calibration.bounded_text import YAML_ERRORS, decode_text, load_json, load_yaml
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.whole_files import read_bytes

NOT_YAML = {
    "unknown escape character": "write paths of Windows with /, or without quotes",
    "but found '<scalar>'": "write a section as section: and its settings below it, indented, as "
    "key: value",
    r"character '\t'": "indent by spaces, not by tabs",
}
"""Words of the parser at usual mistakes (paths in quotes, TOML and INI, tabs) -> what to do."""


def yaml_problem(error: Exception) -> str:
    """What the parser of YAML says, in one line, and what to do."""
    said = " ".join(str(error).split())
    return (
        f"is not YAML: {said}{next((f': {do}' for at, do in NOT_YAML.items() if at in said), '')}"
    )


def read_text(path: Path) -> str:
    """The text of a file in any usual encoding. Raises InputError."""
    try:
        return decode_text(read_bytes(path))
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text ({error.reason} at byte {error.start})") from error


def read_yaml(path: Path) -> Any:
    """The content of a YAML file. Raises InputError."""
    text = read_text(path)
    try:
        return load_yaml(text)
    except YAML_ERRORS as error:
        raise InputError(f"{path}: {yaml_problem(error)}") from error


def read_json(path: Path) -> Any:
    """The content of a JSON file. Raises InputError."""
    try:
        return load_json(decode_text(read_bytes(path)))
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from error
