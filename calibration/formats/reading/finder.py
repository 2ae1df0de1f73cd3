"""What the numbers of a calibration file are: camera matrices, distortions, image sizes, rotations
and translations of two sides.

By their count and form (a camera matrix is [f s cx; 0 f cy; 0 0 1], a rotation is orthonormal), and
by the words of their keys.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from calibration.formats.reading.leaves import (
    LEAST_FOCAL_PX,
    Leaf,
    Numbers,
    leaves,
    side_marks,
    words,
)

Role = Literal["K", "D", "R", "T", "P", "pose", "place", "body", "size", "baseline"]
Side = Literal["left", "right", "both", "reversed", ""]
DISTORTIONS = (4, 5, 8, 12, 14)
EMPTY = {
    "matrix",
    "mat",
    "data",
    "value",
    "values",
    "val",
    "array",
    "vector",
    "cam",
    "camera",
    "coefficients",
}
"""Words that say nothing without another: the key above is asked."""
IGNORED = {
    "board", "boards", "chessboard", "checkerboard", "charuco", "aruco", "pattern", "square",
    "squares", "target", "grid", "marker",
    "markers", "views", "frames", "rvecs", "tvecs", "points", "corners", "roi", "imu", "std",
    "stds", "stdev", "error", "errors",
    "err", "covariance", "sigma", "uncertainty", "guess", "initial", "sensor", "pixel", "cell",
    "world", "map", "vehicle", "robot",
}  # fmt: skip
"""Words of what is not part of the rig: the target, its poses, the errors of the numbers."""
OF_RECTIFIED = {"new", "optimal", "opt", "rectified", "undistorted", "ideal", "rect"}
K_WORDS = {
    "k",
    "m",
    "a",
    "cm",
    "mtx",
    "intrinsic",
    "intrinsics",
    "intrinsicmatrix",
    "cameramatrix",
    "cammatrix",
}
D_WORDS = {"d", "kc", "coeffs", "coeff"}
R_WORDS = {"r", "rmat", "rvec", "om", "rstereo", "stereor", "rodrigues"}
T_WORDS = {"t", "tvec", "trns", "tstereo", "stereot"}
P_WORDS = {"p", "proj"}
POSE_WORDS = {"t", "extrinsic", "extrinsics", "pose", "stereo"}
BODY_WORDS = {"sc", "bs", "body"}
PLACE_WORDS = {"position", "center", "centre", "place"}
SIZE_WORDS = {
    "wh",
    "shape",
    "dimension",
    "dimensions",
    "imsize",
    "imgsize",
    "imagesize",
    "resolution",
    "size",
    "sz",
}
DIGITS = {"0", "1", "2"}
ORTHONORMAL = 0.01
"""Largest error of R R^T = I that numbers of three decimals leave."""


@dataclass(frozen=True, eq=False)
class Parts:
    """The leaves of a file by role and side. many: how many cameras it has, where these are more
    than two.
    """

    table: Mapping[tuple[Role, Side], list[Leaf]]
    many: int = 0

    def get(self, role: Role, side: Side = "") -> Leaf | None:
        """The leaf of a role, where there are more one that is named so, the outermost; None
        without one.
        """
        return min(
            self.table.get((role, side), []),
            key=lambda leaf: (not _is_named(role, leaf), len(leaf.path)),
            default=None,
        )

    def pair(self, role: Role) -> tuple[Leaf, Leaf] | None:
        """The left and the right leaf of a role; None without either."""
        left, right = self.get(role, "left"), self.get(role, "right")
        return (left, right) if left and right else None


def find(content: Mapping[str, Any]) -> Parts:
    """The parts of a rig in a file's content."""
    found = [(role, leaf) for leaf in leaves(content) if (role := _role(leaf))]
    marks = {id(leaf): _marks(role, leaf) for role, leaf in found}
    lenses = [(leaf, marks[id(leaf)]) for role, leaf in found if role == "K"]
    numbers = sorted({mark for _, own in lenses for mark in own} & {"0", "1", "2"})
    sided = {"left", "right"} <= {mark for _, own in lenses for mark in own}
    first = int(numbers[0]) if len(numbers) == 2 else 1
    table: dict[tuple[Role, Side], list[Leaf]] = {}
    for role, leaf in found:
        table.setdefault((role, _side(marks[id(leaf)], first)), []).append(leaf)
    if (
        len(lenses) == 2 and len(table.get(("K", ""), [])) == 2
    ):  # cameras under two names that tell no side
        table |= _in_order([leaf for leaf, _ in lenses], found)
    return Parts(table, 0 if sided or len(numbers) < 3 else len(numbers))


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
    if above[0] == above[1]:
        return {}
    own: dict[tuple[Role, Side], list[Leaf]] = {("K", ""): []}
    sides: tuple[Side, Side] = ("left", "right")
    for role, leaf in found:
        for side, place in zip(sides, above, strict=True):
            if leaf.path[: len(place)] == place:
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
        if (
            role == "R"
            and "r" in said
            and not any(word.startswith("rot") or word in R_WORDS - {"r"} for word in said)
        ):
            said.remove("r")
        if marks := side_marks(tuple(said)):
            return marks
    return ()


def _role(leaf: Leaf) -> Role | None:
    every = [words(key) for key in leaf.path]
    if any(word in IGNORED for said in every for word in said):
        return None
    said = next((set(said) for said in reversed(every) if set(said) - EMPTY - DIGITS), set())
    if {"camera", "matrix"} <= set(every[-1]):
        said = {"k", *every[-1]}
    return _role_by(said - DIGITS, leaf.numbers)


def _role_by(said: set[str], numbers: Numbers) -> Role | None:
    count = numbers.size
    of_rotation = bool(said & R_WORDS) or _starts(said, "rot")
    if count in DISTORTIONS and (said & D_WORDS or _starts(said, "dist")):
        return "D"
    if count == 9:
        return _role_of_nine(said, numbers, of_rotation)
    if count == 3:
        if said & PLACE_WORDS or "shape" in said:
            return "size" if "shape" in said else "place"  # rows, columns, channels
        return (
            "R"
            if of_rotation and not said & T_WORDS
            else "T"
            if said & T_WORDS or _starts(said, "trans")
            else None
        )
    if count == 12 and (said & P_WORDS or _starts(said, "projection")):
        return "P"
    if count in (12, 16) and _is_transform(numbers):
        of_rig = said & POSE_WORDS or _starts(said, "trans") or side_marks(tuple(said))
        return "body" if said & BODY_WORDS else "pose" if of_rig else None
    if count == 1:
        return "baseline" if _starts(said, "baseline") or "stereobaseline" in said else None
    if count == 2 and said & SIZE_WORDS:
        return "size"
    return "K" if count == 4 and said & K_WORDS and not said & D_WORDS else None


def _is_named(role: Role, leaf: Leaf) -> bool:
    """Tell whether a word says that a leaf is a rotation; true for other roles."""
    said = {word for key in leaf.path for word in words(key)}
    return role != "R" or bool(said & R_WORDS) or _starts(said, "rot")


def _role_of_nine(said: set[str], numbers: Numbers, of_rotation: bool) -> Role | None:
    if _starts(said, "rect") and not _is_lens(numbers):
        return "R"
    if said & OF_RECTIFIED:
        return None
    if _is_lens(numbers):
        return "K"
    if is_rotation(numbers):
        return "R"
    return "K" if said & K_WORDS or {"camera", "matrix"} <= said else "R" if of_rotation else None


def _is_transform(numbers: Numbers) -> bool:
    return is_rotation(numbers[:12].reshape(3, 4)[:, :3].ravel()) and np.array_equal(
        numbers[12:], [0, 0, 0, 1][: numbers.size - 12]
    )


def _starts(said: set[str], stem: str) -> bool:
    return any(word.startswith(stem) for word in said)


def _is_lens(numbers: Numbers) -> bool:
    return (
        numbers.size == 9
        and bool(numbers[0] > LEAST_FOCAL_PX)
        and np.array_equal(numbers[[3, 6, 7, 8]], [0, 0, 0, 1])
    )
