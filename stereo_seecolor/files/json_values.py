"""Values as JSON holds them."""

import dataclasses
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

PIECE = 1 << 16
"""Characters that are written at once."""


class Streamed(dict[str, Any]):
    """An object of JSON whose members are made while it is written: those of a million frames are not held in memory."""

    def __init__(self, members: Callable[[], Iterable[tuple[str, Any]]]) -> None:
        super().__init__()
        self._members = members

    def __bool__(self) -> bool:
        return any(True for _ in self._members())

    def items(self) -> Any:
        """The members, made now."""
        return self._members()


class StreamedList(list[Any]):
    """A list of JSON whose items are made while it is written."""

    def __init__(self, items: Callable[[], Iterable[Any]]) -> None:
        super().__init__()
        self._items = items

    def __bool__(self) -> bool:
        return any(True for _ in self._items())

    def __iter__(self) -> Iterator[Any]:
        return iter(self._items())


@dataclasses.dataclass(frozen=True, eq=False)
class JsonText:
    """The text of ``content`` in UTF-8 with a line feed at its end, piece by piece as often as it is asked for.

    What is Streamed in it is never whole.
    """

    content: Mapping[str, Any]
    indent: int | None = None

    def __iter__(self) -> Iterator[bytes]:
        text = io.StringIO()
        for piece in json.JSONEncoder(indent=self.indent, allow_nan=False).iterencode(self.content):
            text.write(piece)
            if text.tell() > PIECE:
                yield text.getvalue().encode()
                text = io.StringIO()
        yield text.getvalue().encode() + b"\n"


def plain(value: Any) -> Any:
    """A value as JSON holds it: dataclasses are objects, arrays and tuples lists, NaN and infinity null, all else its text."""
    if value is None or isinstance(value, (str, bool, int, Streamed, StreamedList)):
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
