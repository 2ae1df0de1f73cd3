"""Text of any encoding, JSON, YAML, XML and TOML, read within bounds: no file of a few kilobytes
takes minutes or gigabytes, and no nesting overflows a stack.

Every reader of both packages uses these functions, whoever wrote the file.
"""

import json
import re
import tomllib
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import yaml

from calibration.errors import CalibrationError

MAX_DEPTH = 50
"""Levels of nesting: files of rigs, dives and records have less than ten."""
MAX_VALUES = 50_000
"""Values of a YAML file: a rig of 300 views with every pose has some thousands."""
MAX_YAML_BYTES = 1 << 20
"""Of a YAML file; JSON, which holds long dives too, is read in a time linear in its size."""

_MANY_DIGITS = re.compile("[0-9]{300}")
"""A whole number beyond what a float holds, which would end as an OverflowError somewhere later."""

_LONG_KEY = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]+[ \t]*\.[ \t]*){{{MAX_DEPTH}}}")
"""A dotted key of TOML of so many levels: its parser's time grows with their square."""

YAML_ERRORS = (yaml.YAMLError, ValueError, RecursionError)
"""What ``load_yaml`` raises beside ``TooMuchError``; a date such as 2026-13-45 is a ValueError."""


_WIDE = ((b"\xff\xfe\0\0", "utf-32"), (b"\0\0\xfe\xff", "utf-32"), (b"\xff\xfe", "utf-16"),
         (b"\xfe\xff", "utf-16"))  # fmt: skip
"""Byte order marks, and what they mark."""


def decode_text(raw: bytes) -> str:
    """The text of a file in any encoding that programs write: UTF-8, UTF-16 and UTF-32, with byte
    order mark or without, else Windows's (cp1252) where no byte is a control character.

    Raises UnicodeDecodeError for what is not text.
    """
    if encoding := next((name for mark, name in _WIDE if raw.startswith(mark)), ""):
        return raw.decode(encoding).rstrip("\0")
    if len(raw) % 2 == 0 and raw[:1] != b"\0" and not raw[1:64:2].strip(b"\0"):
        return raw.decode("utf-16-le").rstrip("\0")
    if len(raw) % 2 == 0 and raw[1:2] != b"\0" and not raw[:64:2].strip(b"\0"):
        return raw.decode("utf-16-be").rstrip("\0")
    try:
        return raw.rstrip(b"\0").decode("utf-8-sig")
    except UnicodeDecodeError:
        if re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", raw):
            raise
        return raw.decode("cp1252", errors="replace")


class TooMuchError(ValueError):
    """A text of more values, levels or bytes than any file of its kind has."""


def load_json(
    text: str | bytes, once_each: Callable[[list[tuple[str, Any]]], Any] | None = None
) -> Any:
    """The content of JSON text. once_each: makes an object of its pairs, in place of ``dict``.

    Raises ValueError, its kinds UnicodeDecodeError and TooMuchError included.
    """
    text = text.decode() if isinstance(text, bytes) else text
    if _MANY_DIGITS.search(text):
        raise TooMuchError("holds a number of more than 300 digits")
    try:
        content = json.loads(text, object_pairs_hook=once_each)
    except RecursionError as error:
        raise TooMuchError(f"is nested more than {MAX_DEPTH} levels deep") from error
    _check_depth(content)
    return content


class SingleKeys(yaml.SafeLoader):
    """PyYAML's safe loader; refuses a key that is given twice, of which it takes the last."""

    def compose_mapping_node(self, anchor: dict[Any, yaml.Node]) -> yaml.MappingNode:
        """Keys as they are written, before those of ``<<`` join them."""
        node = super().compose_mapping_node(anchor)
        known = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in known:
                raise yaml.MarkedYAMLError(
                    problem=f"{key.value!r} is given twice, keep one:", problem_mark=key.start_mark
                )
            known.add(key.value)
        return node


def load_yaml(text: str, loader: Any = SingleKeys, max_depth: int = MAX_DEPTH) -> Any:
    """The content of YAML text. loader: a safe one.

    Its events are looked at first: composing deep nesting overflows the stack of the C loader.
    Raises YAML_ERRORS.
    """
    if len(text) > MAX_YAML_BYTES:
        raise TooMuchError(f"is larger than {MAX_YAML_BYTES >> 10} kB")
    if _MANY_DIGITS.search(text):
        raise TooMuchError("holds a number of more than 300 digits")
    depth = 0
    for count, event in enumerate(yaml.parse(text, Loader=loader)):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(
            event, yaml.CollectionEndEvent
        )
        if depth > max_depth or count > MAX_VALUES:
            raise _too_much(max_depth)
    content = yaml.load(text, Loader=loader)
    for _ in values_of(content, max_depth):
        pass
    return content


def load_xml(text: str) -> ElementTree.Element:
    """The root of XML text. Raises ElementTree.ParseError; CalibrationError for entities, which
    could grow without bound.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CalibrationError(
            "its XML declares entities, which no calibration needs: remove the DOCTYPE"
        )
    return ElementTree.fromstring(text.strip().encode())


def load_toml(text: str) -> dict[str, Any]:
    """The content of TOML text. Raises TooMuchError, RecursionError, ValueError and its kind
    tomllib.TOMLDecodeError.
    """
    if _LONG_KEY.search(text):
        raise TooMuchError(f"is nested more than {MAX_DEPTH} levels deep")
    return tomllib.loads(text)


def values_of(content: Any, max_depth: int) -> Iterator[Any]:
    """All values, as a reader walks them: following aliases, which make gigabytes of a few lines.
    Raises TooMuchError at the bound.
    """
    pending, seen = [(content, 0)], 0
    while pending:
        value, depth = pending.pop()
        seen += 1
        if seen > MAX_VALUES or depth > max_depth:
            raise _too_much(max_depth)
        yield value
        pending.extend((child, depth + 1) for child in _children(value))


def _check_depth(content: Any) -> None:
    level = [content]
    for _ in range(MAX_DEPTH):
        level = [
            child for value in level for child in _children(value) if isinstance(child, dict | list)
        ]
        if not level:
            return
    raise TooMuchError(f"is nested more than {MAX_DEPTH} levels deep")


def _children(value: Any) -> Any:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def _too_much(max_depth: int) -> TooMuchError:
    return TooMuchError(f"holds more than {MAX_VALUES} values or {max_depth} levels")
