"""Values as JSON holds them."""

import dataclasses
import json
import math
from collections.abc import Mapping
from typing import Any


def plain(value: Any) -> Any:
    """A value as JSON holds it: dataclasses are objects, arrays and tuples lists, NaN and infinity null, all else its text."""
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy arrays and numbers, which this module does not import
        return plain(value.tolist())
    return str(value)


def json_line(content: Mapping[str, Any]) -> str:
    """One object on one line of ASCII text."""
    return json.dumps(plain(content), allow_nan=False) + "\n"
