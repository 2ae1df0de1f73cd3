"""Files of text that people write, read within bounds; each error is one line with the file's
name.
"""

from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter

from calibration.files import YAML_ERRORS, decode_text, load_json, load_yaml
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import read_bytes, regular_bytes


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
        raise InputError(f"{path}: is not YAML: {' '.join(str(error).split())}") from error


def read_json(path: Path) -> Any:
    """The content of a JSON file. Raises InputError."""
    try:
        return load_json(decode_text(read_bytes(path)))
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from error


# Records that this program keeps as JSON, read back: typed as they were written, else refused.

Record = TypeVar("Record")


def load_object(path: Path) -> dict[str, Any]:
    """The object of a JSON file. Raises OSError, and ValueError where it holds something else."""
    content = load_json(regular_bytes(path))
    if not isinstance(content, dict):
        raise ValueError(f"holds no object, but {type(content).__name__}")
    return content


def as_record(kind: type[Record], content: Any) -> Record:
    """``content`` as a dataclass, its members checked against their types. Raises ValueError."""
    record: Record = _adapter(kind).validate_python(content)  # type: ignore[arg-type]
    return record


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
