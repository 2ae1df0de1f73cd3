"""Conversion of values to JSON."""

import dataclasses
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from typing import Any

PIECE = 1 << 16
"""Characters that are written at once."""


class Streamed(dict[str, Any]):
    """An object of JSON whose members are made while it is written, to save memory."""

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
    """The text of ``content`` in UTF-8 with a line feed at its end, piece by piece as often as it
    is asked for.

    What is Streamed in it is never whole; with an indent, each member of it is one line.
    """

    content: Mapping[str, Any]
    indent: int | None = None

    def __iter__(self) -> Iterator[bytes]:
        text = io.StringIO()
        for piece in _pieces(self.content, self.indent, 0):
            text.write(piece)
            if text.tell() > PIECE:
                yield text.getvalue().encode()
                text = io.StringIO()
        yield text.getvalue().encode() + b"\n"


_line = json.JSONEncoder(allow_nan=False).encode
"""A value on one line."""


def _pieces(value: Any, indent: int | None, depth: int) -> Iterator[str]:
    """The text of a value ``depth`` objects deep, in the layout of ``json.dumps``."""
    margin = "" if indent is None else "\n" + " " * indent * depth
    if isinstance(value, Streamed):
        yield from _enclosed(
            "{}", ([f"{_line(key)}: {_line(item)}"] for key, item in value.items()), indent, margin
        )
    elif isinstance(value, StreamedList):
        yield from _enclosed("[]", ([_line(item)] for item in value), indent, margin)
    elif isinstance(value, Mapping):
        members = (
            chain([f"{_line(key)}: "], _pieces(item, indent, depth + 1))
            for key, item in value.items()
        )
        yield from _enclosed("{}", members, indent, margin)
    else:
        yield json.dumps(value, indent=indent, allow_nan=False).replace("\n", margin)


def _enclosed(
    brackets: str, members: Iterable[Iterable[str]], indent: int | None, margin: str
) -> Iterator[str]:
    """An object or a list of members that come in pieces."""
    inner = "" if indent is None else margin + " " * indent
    before = brackets[0] + inner
    for member in members:
        yield before
        yield from member
        before = "," + (inner or " ")
    yield brackets if before[0] == brackets[0] else margin + brackets[1]


def plain(value: Any) -> Any:
    """A value as JSON holds it: dataclasses are objects without their functions, arrays and tuples
    lists, NaN and infinity null, all else its text.
    """
    if value is None or isinstance(value, (str, bool, int, Streamed, StreamedList)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        members = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {name: plain(item) for name, item in members if not callable(item)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy arrays and numbers, which this module does not import
        return plain(value.tolist())
    return str(value)


def json_line(content: Mapping[str, Any]) -> str:
    """Write one object as one line of ASCII text."""
    return json.dumps(plain(content), allow_nan=False) + "\n"
