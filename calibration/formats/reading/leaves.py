"""The numbers of a calibration file as leaves of one tree, whatever its notation and nesting; each
has its keys, split into words.

Numbers that are written one by one become what they are of: fx fy cx cy a camera matrix, k1 k2 p1
p2 a distortion, width and height an image size, x y z a vector.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.formats.reading.aliases import (
    METERS,
    NUMBERS,
    PAIRS,
    SHORT_PAIRS,
    SIDES,
    TWO_SIDES,
    words_for,
)
from calibration.formats.reading.section import flat
from calibration.transforms import rotation_from_quaternion

Numbers = NDArray[np.float64]
MAX_NUMBERS = 16
"""A transform (4, 4) is the largest that a rig is made of."""
LEAST_FOCAL_PX = 10.0
"""A focal length of less is in millimeters, or no focal length."""
RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
_COEFFICIENT = re.compile("(radial|tangential)_distortion_([1-6])")
"""As OpenICC writes coefficients of distortion."""
SIZES = (("width", "height"), ("cols", "rows"), ("columns", "rows"))
FISHEYE, PINHOLE = ("k1", "k2", "k3", "k4"), ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


@dataclass(frozen=True, eq=False)
class Leaf:
    """Numbers (n,), which may be NaN, and the keys that lead to them."""

    path: tuple[str, ...]
    numbers: Numbers

    def finite(self, where: str) -> Numbers:
        """The numbers. Raises CalibrationError, naming the key, if one is not finite."""
        for number in self.numbers[~np.isfinite(self.numbers)]:
            raise CalibrationError(
                f"{where}: {'.'.join(self.path)}: {number} is not a finite number"
            )
        return self.numbers


def words(key: str) -> tuple[str, ...]:
    """``cameraMatrixL`` as camera, matrix, l; ``K_2`` as k, 2; ``KL`` as k, l."""
    key = re.sub(
        r"(?<![A-Za-z])(\w|cam|camera|left|right|world|body|imu)2(?=[a-z])", r"\1_to_", key
    )
    return tuple(
        word.lower()
        for word in re.findall(
            r"\b(?:[KMDRTP](?=[LRlr]\b)|[kmd](?=[lr]\b))|[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", key
        )
    )


def side_marks(said: tuple[str, ...]) -> tuple[str, ...]:
    """The sides, in order, that a key's words name; camera numbers where they name none."""
    said = tuple(mark for word in said for mark in TWO_SIDES.get(word, (word,)))
    marks = [SIDES.get(word) or _joined_side(word) for word in said]
    sides = tuple(dict.fromkeys(mark for mark in marks if mark in ("left", "right")))
    return sides or tuple(dict.fromkeys(mark for mark in marks if mark))


def leaves(content: Mapping[Any, Any], path: tuple[str, ...] = ()) -> Iterator[Leaf]:
    """All leaves of 2 to 16 numbers in a mapping, its baselines, those of inner mappings too, and
    what its single numbers make.
    """
    names = (
        str(value)
        for key, value in content.items()
        if isinstance(value, (str, int)) and _holds_name(words(str(key)))
    )
    if name := next((name for name in names if _says_which(words(name))), ""):
        path = (*path, name)
    few: dict[str, Numbers] = {}
    for key, value in _nested(content).items():
        here = (*path, str(key))
        if isinstance(value, Mapping) and "data" not in value:
            yield from leaves(value, here)
        elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            yield from leaves({str(i): one for i, one in enumerate(value)}, here)
        elif _is_stacked(value):
            yield from leaves({"0": value[0], "1": value[1]}, here)
        elif (
            numbers := _numbers(value["data"] if isinstance(value, Mapping) else value)
        ) is not None:
            if numbers.size <= len(RADIAL):
                few[str(key)] = numbers
            if numbers.size >= 2:
                yield Leaf(here, numbers)
    yield from _assembled(few, path)


def _holds_name(said: tuple[str, ...]) -> bool:
    """Tell whether a key leads to a camera's name: ``camera_id``, but not ``nb_camera`` or
    ``board_id``.
    """
    naming = words_for(said, "name of a camera")
    return bool(naming) and (
        said == ("camera",)
        or (naming != {"camera"} and not ({*said} - naming - {"cam", "sensor", "frame", "device"}))
    )


def _says_which(said: tuple[str, ...]) -> bool:
    """Tell whether a name says the side of a camera, or that it is of another sensor."""
    return bool(side_marks(said) or words_for(said, "sensor"))


def keys(content: Mapping[Any, Any]) -> Iterator[str]:
    """All keys of a mapping, at any depth."""
    for key, value in content.items():
        yield str(key)
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, Mapping):
                yield from keys(inner)


def texts(content: Mapping[Any, Any]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The words of a key, and the text or truth value under it, at any depth."""
    for key, value in content.items():
        if isinstance(value, (str, bool)):
            yield words(str(key)), value
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, Mapping):
                yield from texts(inner)


def _is_stacked(value: Any) -> bool:
    """Tell whether a list or array holds the matrices of two cameras, one after the other."""
    if isinstance(value, np.ndarray):
        return (
            value.ndim > 1 and len(value) == 2 and value[0].size > 3 and value.dtype.kind in "fiu"
        )
    return (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(one, list) and len(list(islice(flat(one), 4))) > 3 for one in value)
    )


def _nested(content: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """With ``left.fx: 500`` and ``left/fx: 500`` as ``left: {fx: 500}``."""
    nested: dict[Any, Any] = {}
    for key, value in content.items():
        outer, mark, inner = re.sub("/", ".", str(key)).partition(".")
        if (
            mark
            and outer
            and inner
            and not isinstance(value, Mapping)
            and isinstance(nested.setdefault(outer, {}), dict)
        ):
            nested[outer][inner] = value
        else:
            nested[key] = value
    return nested


def _joined_side(word: str) -> str | None:
    """Of ``leftcamera`` and ``cammatrixleft``, but not of ``upright``."""
    found = re.fullmatch(
        r"(left|right)\w{3,}|\w*(?:camera|cam|matrix|coeffs?|size|dist)(left|right)", word
    )
    return found[1] or found[2] if found else None


def _numbers(value: Any) -> Numbers | None:
    """(n,) of a number, text of a number, lists or an array; None for all else, and for more than a
    matrix (4, 4).
    """
    if isinstance(value, np.ndarray):
        fits = value.dtype.kind in "fiu" and 1 <= value.size <= MAX_NUMBERS
        return value.ravel().astype(np.float64) if fits else None
    if isinstance(value, str) and (
        size := re.fullmatch(r"(\d{2,5})\s*[x×]\s*(\d{2,5})", value.strip())
    ):
        value = [size[1], size[2]]
    try:
        items = [
            float("nan" if item is None else "bool" if isinstance(item, bool) else item)
            for item in islice(flat(value), MAX_NUMBERS + 1)
        ]
    except (TypeError, ValueError, OverflowError):
        return None
    return np.array(items) if 1 <= len(items) <= MAX_NUMBERS else None


def _assembled(few: Mapping[str, Numbers], path: tuple[str, ...]) -> Iterator[Leaf]:
    """What the single numbers of one mapping make, for each side that their keys name: ``fx_left``
    is of the left camera.
    """
    groups: dict[tuple[str, ...], dict[str, float]] = {}
    for key, numbers in few.items():
        one = _COEFFICIENT.fullmatch(key) if numbers.size == 1 else None
        side, name = ((), f"{one[1][0]}{one[2]}") if one else _side_and_name(key)
        name = name.replace("r", "k").replace("t", "p") if one else name
        own = groups.setdefault((*path, *side), {})
        if numbers.size == 1:
            own[NUMBERS.get(name.replace("_", ""), name)] = float(numbers[0])
        elif "radial" in name:
            own.update(zip(RADIAL, numbers.tolist(), strict=False))
        elif numbers.size == 2 and (
            pair := next(
                (pair for word, pair in PAIRS.items() if word in SHORT_PAIRS.get(name, name)), None
            )
        ):
            own.update(zip(pair, numbers.tolist(), strict=True))
    for place, own in groups.items():
        yield from (Leaf((*place, key), np.array(numbers)) for key, numbers in _of_numbers(own))


def _side_and_name(key: str) -> tuple[tuple[str, ...], str]:
    parts = [part.lower() for part in re.findall(r"[A-Z]+(?![a-z])\d*|[A-Z]?[a-z]+\d*|\d+", key)]
    side = tuple(
        part
        for part in parts
        if re.fullmatch(r"left|right|l|r|port|starboard|(cam|camera)?[012]", part)
    )
    rest = [part for part in parts if part not in side]
    if rest[-1:] in (["px"], ["pix"], ["pixel"], ["pixels"]) and len(rest) > 1:
        rest.pop()
    name = "".join(rest)
    if name[-1:] in ("0", "1", "2") and (
        (name not in NUMBERS and name[:-1] in NUMBERS) or "radial" in name or "tangential" in name
    ):
        return (name[-1],), name[:-1]  # fx1
    return side, "_".join(rest)


def _of_numbers(own: Mapping[str, float]) -> Iterator[tuple[str, list[float]]]:
    if {"fx", "cx", "cy"} <= own.keys() and not abs(own["fx"]) < LEAST_FOCAL_PX:
        yield (
            "K",
            [
                own["fx"],
                own.get("skew", 0.0),
                own["cx"],
                0,
                own.get("fy", own["fx"] * own.get("aspect_ratio", 1.0)),
                own["cy"],
                0,
                0,
                1,
            ],
        )
    if {"k1", "k2"} <= own.keys():
        names = (
            FISHEYE if "k4" in own and "p1" not in own else PINHOLE if "k4" in own else PINHOLE[:5]
        )
        yield "D", [own.get(name, 0.0) for name in names]
    if turn := next(
        (
            turn
            for turn in (("qx", "qy", "qz", "qw"), ("x", "y", "z", "w"))
            if own.keys() >= set(turn)
        ),
        None,
    ):
        yield "R", rotation_from_quaternion(np.array([own[name] for name in turn])).ravel().tolist()
    units = (f"_{unit}" for unit in METERS)
    translations = (
        (f"T{unit}", tuple(f"t{axis}{unit}" for axis in "xyz")) for unit in ("", *units)
    )
    for key, three in (
        *translations,
        ("R", ("rx", "ry", "rz")),
        ("angles", ("roll", "pitch", "yaw")),
        ("vector", ("x", "y", "z")),
    ):
        if own.keys() >= set(three) and not (key == "vector" and "w" in own):
            yield key, [own[name] for name in three]
    yield from ((name, [number]) for name, number in own.items() if "baseline" in name)
    for width in own:
        end = re.sub(r"(^|_)w$", r"\1h", width)
        heights = [{"nx": "ny"}.get(width, end), *(width.replace(*pair) for pair in SIZES)]
        for height in [one for one in heights if one != width and one in own][:1]:
            yield f"size_{width}", [own[width], own[height]]
