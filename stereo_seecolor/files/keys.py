"""Hashes that tell whether a result is up to date."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import fields, is_dataclass

import numpy as np


def content_key(*parts: object) -> str:
    """A hash of all that an output depends on; equal parts give equal keys, on any machine."""
    return content_key_of(parts)


def content_key_of(parts: Iterable[object]) -> str:
    """Hash parts as ``content_key`` does, without holding all of them in memory."""
    key = ContentKey()
    for part in parts:
        key.add(part)
    return key.value


class ContentKey:
    """The hash of ``content_key``, of parts that come one by one."""

    def __init__(self) -> None:
        self._digest = hashlib.sha256()

    def add(self, part: object) -> None:
        """Add one part."""
        content = (
            part
            if isinstance(part, bytes)
            else json.dumps(part, sort_keys=True, default=_plain).encode()
        )
        self._digest.update(len(content).to_bytes(8, "little") + content)

    @property
    def value(self) -> str:
        """The hash of the parts so far."""
        return self._digest.hexdigest()


def _plain(value: object) -> object:
    """What JSON cannot hold, as content: how numpy prints arrays is a setting of the process, and
    long ones are cut.
    """
    if isinstance(value, np.ndarray):
        return [
            str(value.dtype),
            value.shape,
            hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest(),
        ]
    if isinstance(value, np.generic):
        return value.item()
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return str(value)
