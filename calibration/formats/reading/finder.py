"""What the numbers of a calibration file are: camera matrices, distortions, image sizes, rotations
and translations of two sides.

By their count and form (a camera matrix is [f s cx; 0 f cy; 0 0 1], a rotation is orthonormal), and
by the words of their keys.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from calibration.formats.reading.aliases import SIDES, words_for
from calibration.formats.reading.leaves import (
    LEAST_FOCAL_PX,
    Leaf,
    Numbers,
    leaves,
    side_marks,
    words,
)

Role = Literal["K", "D", "R", "T", "P", "pose", "place", "body", "size", "baseline", "angles"]
Side = Literal["left", "right", "both", "reversed", ""]
OF_CAMERA = ("camera matrix", "distortion", "projection", "size")
"""Parts that each camera has."""
OF_PLACE: set[Role] = {"R", "T", "pose", "place", "body", "angles"}
ORTHONORMAL = 0.01
"""Largest error of R R^T = I that numbers of three decimals leave."""


@dataclass(frozen=True, eq=False)
class Parts:
    """The leaves of a file by role and side. many: how many cameras it has, where these are more
    than two. doubts: that no name shows which camera is the left one.
    """

    table: Mapping[tuple[Role, Side], list[Leaf]]
    many: int = 0
    doubts: tuple[str, ...] = ()

    def get(self, role: Role, side: Side = "") -> Leaf | None:
        """The leaf of a role, of several one into a camera's axes, and the outermost; None without
        one.
        """
        return min(
            self.table.get((role, side), []),
            key=lambda leaf: (
                not _is_named(role, leaf),
                leads_from_camera(words(leaf.path[-1])),
                len(leaf.path),
                role == "R" and leaf.numbers.size == 3,  # a matrix before a vector
            ),
            default=None,
        )

    def pair(self, role: Role) -> tuple[Leaf, Leaf] | None:
        """The left and the right leaf of a role; None without either."""
        left, right = self.get(role, "left"), self.get(role, "right")
        return (left, right) if left and right else None


def find(content: Mapping[str, Any]) -> Parts:
    """The parts of a rig in a file's content."""
    found = [(role, leaf) for leaf in map(_lens_alone, leaves(content)) if (role := _role(leaf))]
    marks = {id(leaf): _marks(role, leaf) for role, leaf in found}
    found = [
        (role, leaf)
        for role, leaf in found
        if role not in OF_PLACE or not _is_of_sensor(leaf, bool(marks[id(leaf)]))
    ]
    lenses = [(leaf, marks[id(leaf)]) for role, leaf in found if role == "K"]
    numbers = sorted({mark for _, own in lenses for mark in own} & {"0", "1", "2"})
    sided = {"left", "right"} <= {mark for _, own in lenses for mark in own}
    first = int(numbers[0]) if len(numbers) == 2 else 1
    table: dict[tuple[Role, Side], list[Leaf]] = {}
    for role, leaf in found:
        alike = {marks[id(other)] for its, other in found if its == role}
        # lenses K1 and K2 beside poses of cam0 and cam1
        lowest = 0 if role in OF_PLACE and {("0",), ("1",)} <= alike else first
        table.setdefault((role, _side(marks[id(leaf)], lowest)), []).append(leaf)
    doubts: tuple[str, ...] = ()
    # cameras under two names that tell no side
    if len(lenses) == 2 and len(table.get(("K", ""), [])) == 2:
        own = _in_order([leaf for leaf, _ in lenses], found)
        table |= own
        if own:
            paths = [lens.path for lens, _ in lenses]
            left = ".".join(paths[0][: None if paths[0][:-1] == paths[1][:-1] else -1])
            doubts = (
                (f"no name identifies the left camera: the first, {left}, is used as the left one"),
            )
    return Parts(table, 0 if sided or len(numbers) < 3 else len(numbers), doubts)


COUNTS = {
    "a camera matrix has 9 (3x3), or 4": (("camera matrix",), {4, 9, 12, 16}),
    "a rotation has 9, 3 or 4 (quaternion)": (("rotation",), {3, 4, 9}),
    "a transform has 16 or 12, a translation 3": (("transform", "translation"), {3, 12, 16}),
}
"""What a part holds -> what it is, and its counts of numbers."""


def describe_miscount(content: Mapping[str, Any]) -> str:
    """The first key that names a lens or a place, with how many numbers it holds, where none has so
    many; "" without one.
    """
    for leaf in leaves(content):
        said = words(leaf.path[-1])
        if _names_matrix({*said}):
            said = ("k", *said)
        if words_for(said, "distortion", "size") or _role(leaf) or _is_of_sensor(leaf, False):
            continue
        for fact, (names, counts) in COUNTS.items():
            if words_for(said, *names) and leaf.numbers.size not in counts:
                key = ".".join(leaf.path)
                return f"{key} holds {leaf.numbers.size} numbers, and {fact}"
    return ""


def is_rotation(numbers: Numbers) -> bool:
    """Tell whether nine numbers are a rotation, to three decimals."""
    R = numbers.reshape(3, 3)
    return bool(
        (np.abs(R) < 1.1).all()
        and np.abs(R @ R.T - np.eye(3)).max() < ORTHONORMAL
        and np.linalg.det(R) > 0
    )


def _in_order(
    lenses: list[Leaf], found: list[tuple[Role, Leaf]]
) -> dict[tuple[Role, Side], list[Leaf]]:
    above = [lens.path[:-1] for lens in lenses]
    names = [set(words(lens.path[-1])) for lens in lenses]
    beside = above[0] == above[1]
    if beside and not (
        names_lens(names[0] & names[1]) and names[0] - names[1] and names[1] - names[0]
    ):
        return {}
    own: dict[tuple[Role, Side], list[Leaf]] = {("K", ""): []}
    sides: tuple[Side, Side] = ("left", "right")
    for role, leaf in found:
        for side, place, name, other in zip(sides, above, names, names[::-1], strict=True):
            # K_top and dist_top
            if leaf.path[: len(place)] == place and (
                not beside or (name - other) & set(words(leaf.path[-1]))
            ):
                own.setdefault((role, side), []).append(leaf)
    return own


def _side(marks: tuple[str, ...], first: int) -> Side:
    sides = [
        "left" if mark in ("left", str(first)) else "right"
        for mark in marks
        if mark in ("left", "right") or int(mark) >= first
    ]
    if len(sides) == 2 and sides[0] != sides[1]:
        return "both" if sides[0] == "left" else "reversed"
    return "left" if sides == ["left"] else "right" if sides == ["right"] else ""


def _marks(role: Role, leaf: Leaf) -> tuple[str, ...]:
    """The sides that the innermost key with any names; the ``r`` of a rotation is none."""
    for key in reversed(leaf.path):
        said = list(words(key))
        if "cnm" in said:  # Kalibr's T_cn_cnm1, of the camera before
            continue
        if role == "R" and words_for(said, "rotation") == {"r"}:
            said.remove("r")
        if marks := side_marks(tuple(said)):
            return marks
    return ()


def _is_of_sensor(leaf: Leaf, sided: bool) -> bool:
    """Tell whether numbers are of the place of a sensor that is no camera: by the innermost key
    that names one or the other. One camera's place in a sensor's axes, as ``T_cam_imu``, is no
    transform between two cameras unless it is sided.
    """
    for key in reversed(leaf.path):
        said = words(key)
        sensors = words_for(said, "sensor")
        of_camera = any(word[:3] == "cam" or word == "c" for word in said)
        # the r of a rotation is no side
        of_side = bool({"left", "right"} & {*side_marks(tuple(w for w in said if len(w) > 1))})
        if sensors:
            return not (
                sided and (of_camera or (of_side and sensors == words_for(sensors, "body")))
            )
        if of_camera or of_side:
            return False
    return False


def _role(leaf: Leaf) -> Role | None:
    every = [words(key) for key in leaf.path]
    ignored = words_for({word for said in every for word in said}, "no part")
    if ignored and not (
        ignored <= {"sensor", *words_for(ignored, "body")}
        and (
            as_transform(leaf.numbers) is not None
            or (leaf.numbers.size in (3, 9) and len(set(_axes(every[-1]))) == 2)
        )
    ):
        return None
    naming = _naming(leaf)
    said = naming[0] if naming else set()
    if leaf.numbers.size in (12, 16) and leads_from_camera(every[-1]):
        return "body" if as_transform(leaf.numbers) is not None else None
    if (
        len(naming) > 1
        and not said - SIDES.keys() - words_for(said, "nothing")
        and words_for(naming[1], *OF_CAMERA)
    ):
        said = naming[1]  # ``dist_coeffs: {left: ..., right: ...}``
    if _names_matrix(set(every[-1])):
        said = {"k", *every[-1]}
    return _role_by(said, leaf.numbers)


def _naming(leaf: Leaf) -> list[set[str]]:
    """The words of the keys that name anything, the innermost first."""
    every = [set(words(key)) for key in reversed(leaf.path)]
    return [said for said in every if said - words_for(said, "nothing")]


def _role_by(said: set[str], numbers: Numbers) -> Role | None:
    count = numbers.size
    of_rotation = bool(words_for(said, "rotation"))
    if count > 3 and words_for(said, "distortion") and not words_for(said, "rectified images"):
        return "D"
    if count == 4 and (words_for(said, "quaternion") or (of_rotation and _is_unit(numbers))):
        return "R"
    if count == 9:
        return _role_of_nine(said, numbers, of_rotation)
    if count == 3:
        return _role_of_three(said, of_rotation)
    if count == 12 and words_for(said, "projection"):
        return "P"
    if count in (12, 16):
        of_rig = words_for(said, "transform", "body") or side_marks(tuple(said))
        return "pose" if of_rig and as_transform(numbers) is not None else None
    if count == 1:
        return "baseline" if words_for(said, "baseline") else None
    if count == 2 and words_for(said, "size"):
        return "size"
    of_lens = words_for(said, "camera matrix") and not words_for(said, "distortion")
    return "K" if count == 4 and of_lens else None


def _role_of_three(said: set[str], of_rotation: bool) -> Role | None:
    if "shape" in said:
        return "size"  # rows, columns, channels
    if words_for(said, "place"):
        return "place"
    if words_for(said, "angles"):
        return "angles"
    of_translation = words_for(said, "translation")
    return "R" if of_rotation and not of_translation else "T" if of_translation else None


def names_lens(said: set[str]) -> bool:
    """Tell whether words name a camera matrix."""
    return bool(words_for(said, "camera matrix")) or _names_matrix(said)


def _names_matrix(said: set[str]) -> bool:
    return bool({"camera", "cam"} & said and {"matrix", "mat"} & said)


def _is_named(role: Role, leaf: Leaf) -> bool:
    """Tell whether a word says that a leaf is a rotation; true for other roles."""
    said = {word for key in leaf.path for word in words(key)}
    return role != "R" or bool(words_for(said, "rotation"))


def _role_of_nine(said: set[str], numbers: Numbers, of_rotation: bool) -> Role | None:
    if any(word.startswith("rect") for word in said) and not _is_lens(numbers):
        return "R"
    if words_for(said, "rectified images"):
        return None
    if _is_lens(numbers):
        return "K"
    if is_rotation(numbers):
        return "R"
    return "K" if names_lens(said) else "R" if of_rotation else None


def as_transform(numbers: Numbers) -> Numbers | None:
    """Twelve or sixteen numbers as [R t] (3, 4), row by row or column by column, as programs of row
    vectors write it; None where they are not a transform.
    """
    if numbers.size not in (12, 16):
        return None
    if numbers.size == 16:
        matrix = numbers.reshape(4, 4)
        matrix = matrix if np.array_equal(matrix[3], [0, 0, 0, 1]) else matrix.T
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            return None
        forms = [matrix[:3]]
    else:
        forms = [numbers.reshape(3, 4), numbers.reshape(4, 3).T]
    return next((form for form in forms if is_rotation(form[:, :3].ravel())), None)


def _lens_alone(leaf: Leaf) -> Leaf:
    """A camera matrix without the column of zeros, and the row, that make a projection of it."""
    if leaf.numbers.size not in (12, 16):
        return leaf
    matrix = leaf.numbers.reshape(-1, 4)
    lens = matrix[:3, :3].ravel()
    bare = not matrix[:3, 3].any() and matrix[3:].ravel().tolist() in ([], [0, 0, 0, 1])
    said = _naming(leaf)[:1]
    if bare and _is_lens(lens) and not (said and words_for(said[0], "projection")):
        return Leaf(leaf.path, lens)
    return leaf


def leads_from_camera(said: tuple[str, ...]) -> bool:
    """Tell whether a transform's key says from the camera's axes to those of a body or the world:
    ``T_body_cam``, ``T_body_sensor``, ``cam_to_world``, ``T_BS``, ``to_body``.
    """
    if words_for(said, "transform from a camera"):
        return True
    axes = _axes(said)
    if "to" in said:
        return axes == ["camera", "common"] or (axes == ["common"] and said[0] == "to")
    return axes == ["common", "camera"]


def leads_into_camera(said: tuple[str, ...]) -> bool:
    """Tell whether a transform's key says from the axes of a body or the world to the camera's:
    ``T_cam_body``, ``world_to_cam``.
    """
    return _axes(said) == (["common", "camera"] if "to" in said else ["camera", "common"])


def _axes(said: tuple[str, ...]) -> list[str]:
    return [
        "common" if words_for([word], "body") else "camera"
        for word in said
        if words_for([word], "body") or word[:3] == "cam" or word in ("c", "sensor")
    ]


def _is_unit(numbers: Numbers) -> bool:
    return abs(float(np.linalg.norm(np.clip(numbers, -2, 2))) - 1) < ORTHONORMAL


def _is_lens(numbers: Numbers) -> bool:
    return (
        numbers.size == 9
        and bool(numbers[0] > LEAST_FOCAL_PX)
        and np.array_equal(numbers[[3, 6, 7, 8]], [0, 0, 0, 1])
    )
