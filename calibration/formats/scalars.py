"""Lenses written number by number (``fx: 1200``, ``cx``, ``cy``, ``k1`` ...), converted to the matrices K and D."""

import re
from collections.abc import Mapping
from typing import Any

FOCAL_X, FOCAL_Y = ("fx", "focalx", "focallengthx", "f", "focal", "focallength", "focallengthpx"), ("fy", "focaly", "focallengthy")
CENTER_X, CENTER_Y = ("cx", "u0", "ppx", "centerx", "principalpointx"), ("cy", "v0", "ppy", "centery", "principalpointy")
PINHOLE, FISHEYE = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), ("k1", "k2", "k3", "k4")


def spelling(key: str) -> str:
    """A key as all its spellings have it: without case, blanks and underscores."""
    return re.sub(r"[^a-z0-9]", "", key.lower())


def numbers_of(camera: Mapping[str, Any]) -> dict[str, float]:
    """Spelling -> number of all single numbers in a mapping, and in the mappings directly in it (``intrinsics: {fx: ...}``)."""
    inner = [value for value in camera.values() if isinstance(value, Mapping)]
    items = [item for mapping in (*inner, camera) for item in mapping.items()]
    return {spelling(str(key)): number for key, value in items if (number := _number(value)) is not None}


def with_matrices(camera: Mapping[str, Any]) -> dict[str, Any]:
    """A camera's keys with K and D beside its numbers, where it has no matrices; k1 to k4 without p1 are those of a fisheye."""
    numbers = numbers_of(camera)
    content = {str(key): value for key, value in camera.items()}
    fx, cx, cy = (first(numbers, names) for names in (FOCAL_X, CENTER_X, CENTER_Y))
    four = content.get("intrinsics")
    if fx is not None and cx is not None and cy is not None:
        content.setdefault("K", [fx, 0, cx, 0, first(numbers, FOCAL_Y) or fx, cy, 0, 0, 1])
    elif isinstance(four, list) and len(four) == 4 and None not in map(_number, four):
        del content["intrinsics"]
        content.setdefault("K", [four[0], 0, four[2], 0, four[1], four[3], 0, 0, 1])
    if "k1" in numbers and "k2" in numbers:
        names = FISHEYE if "k4" in numbers and "p1" not in numbers else PINHOLE if "k4" in numbers else PINHOLE[:5]
        content.setdefault("D", [numbers.get(name, 0.0) for name in names])
    return content


def first(numbers: Mapping[str, float], names: tuple[str, ...]) -> float | None:
    """The number under the first of these names that is there."""
    return next((numbers[name] for name in names if name in numbers), None)


def _number(value: Any) -> float | None:
    try:
        return None if isinstance(value, (bool, list, Mapping)) or value is None else float(value)
    except (TypeError, ValueError):
        return None
