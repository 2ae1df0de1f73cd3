"""Records that this program keeps as JSON, read back: typed as they were written, else refused."""

from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter

from calibration.bounded_text import load_json
from stereo_seecolor.files.whole_files import regular_bytes

Record = TypeVar("Record")


def load_object(path: Path) -> dict[str, Any]:
    """The object of a JSON file. Raises OSError, and ValueError where it holds something else."""
    content = load_json(regular_bytes(path))
    if not isinstance(content, dict):
        raise ValueError(f"contains no object, but {type(content).__name__}")
    return content


def as_record(kind: type[Record], content: Any) -> Record:
    """``content`` as a dataclass, its members checked against their types. Raises ValueError."""
    record: Record = _adapter(kind).validate_python(content)  # type: ignore[arg-type]
    return record


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
