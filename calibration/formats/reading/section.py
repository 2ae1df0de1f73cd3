"""Access to the keys of a calibration file, each with its type; errors name file and key."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.errors import SIZE_MISSING, CalibrationError, SizeMissingError


@contextmanager
def naming(where: str) -> Iterator[None]:
    """Put ``where`` (a file, a key) before the message of a CalibrationError without it."""
    try:
        yield
    except CalibrationError as error:
        if str(error).startswith(where):
            raise
        raise type(error)(f"{where}: {error}") from error


@dataclass(frozen=True, eq=False)
class Section:
    """A mapping in a calibration file. where: the file and the keys to it, for messages."""

    where: str
    content: Mapping[str, Any]

    def has(self, *keys: str) -> bool:
        """Tell whether every key is there."""
        return all(key in self.content for key in keys)

    def size(self, key: str) -> int:
        """Count the numbers under ``key``; 0 for words and mappings that are not a matrix."""
        value = self.content[key]
        if isinstance(value, np.ndarray):
            return value.size
        try:
            return (
                self.numbers(key).size if not isinstance(value, Mapping) or "data" in value else 0
            )
        except CalibrationError:
            return 0

    def first(self, *keys: str) -> str:
        """The first of these names that the file uses; CalibrationError if it uses none."""
        for key in keys:
            if key in self.content:
                return key
        others = f" (nor {', '.join(keys[1:])})" if len(keys) > 1 else ""
        raise CalibrationError(
            f"{self.where}: no {keys[0]!r}{others}: the file is incomplete or of another kind"
        )

    def section(self, key: str) -> "Section":
        """The mapping under ``key``."""
        value = self._value(key)
        if not isinstance(value, Mapping):
            raise CalibrationError(
                f"{self.where}: {key}: expected keys and values, got {_shown(value)}"
            )
        return Section(f"{self.where}: {key}", {str(name): inner for name, inner in value.items()})

    def listed(self, key: str, *wanted: str) -> list["Section"]:
        """The mappings in the list under ``key``; none where one lacks all of the wanted keys, if
        there are any.
        """
        entries = self.content.get(key)
        if not isinstance(entries, list) or not all(
            isinstance(one, Mapping) and (not wanted or any(name in one for name in wanted))
            for one in entries
        ):
            return []
        return [Section(f"{self.where}: {key}: {i}", entry) for i, entry in enumerate(entries)]

    def text(self, key: str) -> str:
        """The word under ``key``."""
        value = self._value(key)
        if not isinstance(value, str):
            raise CalibrationError(f"{self.where}: {key}: expected a word, got {_shown(value)}")
        return value.strip()

    def number(self, key: str, default: float | None = None) -> float:
        """The one finite number under ``key``; the default, if there is one, where it is absent."""
        if default is not None and not self.has(key):
            return default
        return float(self.numbers(key, 1)[0])

    def image_size(self, *keys: str) -> tuple[int, int]:
        """Read (width, height), whole numbers, from two keys or from one that holds both."""
        values = np.concatenate([self.numbers(key, 2 // len(keys)) for key in keys])
        if (values != np.round(values)).any():
            raise CalibrationError(
                f"{self.where}: {' '.join(keys)}: expected whole numbers of pixels, got "
                f"{values.tolist()}"
            )
        return int(values[0]), int(values[1])

    def needed_size(self, image_size: tuple[int, int] | None) -> tuple[int, int]:
        """The given image size, of a file that stores none. Raises SizeMissingError without it."""
        if image_size is None:
            raise SizeMissingError(f"{self.where}: {SIZE_MISSING}")
        return image_size

    def numbers(self, key: str, *counts: int) -> NDArray[np.float64]:
        """Read (n,) finite numbers under ``key``: a number, list, rows, or matrix with ``data``.

        counts: the lengths allowed; any if none is given. The length of the data counts, not the
        ``rows`` and ``cols`` written beside it (several tools write those wrong).
        """
        value = self._value(key)
        if isinstance(value, Mapping):
            if "data" not in value:
                raise CalibrationError(f"{self.where}: {key}: a matrix without 'data'")
            value = value["data"]
        if isinstance(value, np.ndarray) and counts and value.size not in counts:
            raise CalibrationError(
                f"{self.where}: {key}: expected {_any_of(counts)} numbers, got an array of shape "
                f"{value.shape}"
            )
        numbers = np.array([self._finite(key, item) for item in flat(value)], dtype=np.float64)
        if counts and numbers.size not in counts:
            raise CalibrationError(
                f"{self.where}: {key}: expected {_any_of(counts)} numbers, got {numbers.size}"
            )
        return numbers

    def matrix(self, key: str, rows: int, columns: int) -> NDArray[np.float64]:
        """Read (rows, columns) finite numbers under ``key``."""
        return self.numbers(key, rows * columns).reshape(rows, columns)

    def _value(self, key: str) -> Any:
        return self.content[self.first(key)]

    def _finite(self, key: str, item: Any) -> float:
        try:
            number = float("bool") if isinstance(item, bool) else float(item)
        except (TypeError, ValueError, OverflowError):
            raise CalibrationError(
                f"{self.where}: {key}: expected a number, got {_shown(item)}"
            ) from None
        if not np.isfinite(number):
            raise CalibrationError(f"{self.where}: {key}: {number} is not a finite number")
        return number


def _any_of(counts: tuple[int, ...]) -> str:
    return " or ".join(str(count) for count in counts)


def flat(value: Any) -> Iterator[Any]:
    """The items of a list or an array, at any depth; of anything else the value itself."""
    if isinstance(value, np.ndarray):
        value = value.ravel().tolist()
    if isinstance(value, (list, tuple)):
        for item in value:
            yield from flat(item)
    else:
        yield value


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, (Mapping, list)):
        return f"a {'mapping' if isinstance(value, Mapping) else 'list'} of {len(value)}"
    return repr(value)[:60]
