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
    SIDES,
    Leaf,
    Numbers,
    leaves,
    side_marks,
    words,
)

Role = Literal["K", "D", "R", "T", "P", "pose", "place", "body", "size", "baseline", "angles"]
Side = Literal["left", "right", "both", "reversed", ""]
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
    "row",
    "rows",
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
D_WORDS = {"d", "kc", "coeffs", "coeff", "coefs", "coef"}
R_WORDS = {"r", "rmat", "rvec", "om", "rstereo", "stereor", "rodrigues"}
T_WORDS = {"t", "tvec", "trns", "tstereo", "stereot"}
P_WORDS = {"p", "proj"}
POSE_WORDS = {"t", "rt", "extrinsic", "extrinsics", "pose", "stereo"}
QUATERNION_WORDS = {"q", "quat", "quaternion", "qvec", "xyzw", "wxyz"}
ANGLE_WORDS = {"euler", "rpy", "angles", "deg", "degrees", "roll", "pitch", "yaw"}
"""Of a rotation whose order of turns differs between tools."""
COMMON = {"world", "w", "map", "vehicle", "robot", "base", "rig", "body", "b", "imu", "i"}
"""Axes in which the poses of both cameras may be given."""
SENSORS = {
    "imu", "gyro", "gyroscope", "accel", "accelerometer", "acc", "mag", "magnetometer", "compass",
    "ahrs", "ins", "mru", "gnss", "gps", "rtk", "antenna", "dvl", "adcp", "usbl", "sbl", "lbl",
    "aps", "acoustic", "modem", "transponder", "transducer", "receiver", "beacon", "hydrophone",
    "sonar", "multibeam", "mbes", "fls", "sss", "echosounder", "altimeter", "lidar", "laser",
    "radar", "depth", "pressure", "baro", "barometer", "ctd", "thruster", "arm", "gripper",
    "manipulator", "light", "lamp", "strobe", "flash", "led",
}  # fmt: skip
"""Words of what stands on a vehicle beside its cameras."""
OF_PLACE: set[Role] = {"R", "T", "pose", "place", "body", "angles"}
OUT_OF_CAMERA = {"sc", "bs", "wc", "bc", "ic"}
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
    than two. doubts: that no name shows which camera is the left one.
    """

    table: Mapping[tuple[Role, Side], list[Leaf]]
    many: int = 0
    doubts: tuple[str, ...] = ()

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
        table.setdefault((role, _side(marks[id(leaf)], first)), []).append(leaf)
    doubts: tuple[str, ...] = ()
    # cameras under two names that tell no side
    if len(lenses) == 2 and len(table.get(("K", ""), [])) == 2:
        own = _in_order([leaf for leaf, _ in lenses], found)
        table |= own
        if own:
            left = ".".join(lenses[0][0].path[:-1])
            doubts = (f"no name shows which camera is the left one: the first, {left}, is taken",)
    return Parts(table, 0 if sided or len(numbers) < 3 else len(numbers), doubts)


COUNTS: dict[str, tuple[set[str], set[int]]] = {
    "a camera matrix has 9 (3x3), or 4": (K_WORDS, {4, 9, 12, 16}),
    "a rotation has 9, 3 or 4 (quaternion)": (R_WORDS, {3, 4, 9}),
    "a transform has 16 or 12, a translation 3": (POSE_WORDS | T_WORDS, {3, 12, 16}),
}
"""What a part holds -> words that name it, and its counts of numbers."""


def miscounted(content: Mapping[str, Any]) -> str:
    """The first key that names a lens or a place, with how many numbers it holds, where none has so
    many; "" without one.
    """
    for leaf in leaves(content):
        said = set(words(leaf.path[-1])) - DIGITS
        if (
            _is_of_distortion(said)
            or said & SIZE_WORDS
            or _role(leaf)
            or _is_of_sensor(leaf, False)
        ):
            continue
        for fact, (names, counts) in COUNTS.items():
            if said & names and leaf.numbers.size not in counts:
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
        if "cnm" in said:  # Kalibr's T_cn_cnm1, of the camera before
            continue
        if (
            role == "R"
            and "r" in said
            and not any(word.startswith("rot") or word in R_WORDS - {"r"} for word in said)
        ):
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
        sensors = set(said) & SENSORS
        of_camera = any(word[:3] == "cam" or word == "c" for word in said)
        # the r of a rotation is no side
        of_side = bool({"left", "right"} & {*side_marks(tuple(w for w in said if len(w) > 1))})
        if sensors:
            return not (sided and (of_camera or (of_side and sensors <= COMMON)))
        if of_camera or of_side:
            return False
    return False


def _role(leaf: Leaf) -> Role | None:
    every = [words(key) for key in leaf.path]
    ignored = {word for said in every for word in said} & IGNORED
    if ignored and not (
        ignored <= COMMON and leaf.numbers.size > 9 and as_transform(leaf.numbers) is not None
    ):
        return None
    naming = [set(said) for said in reversed(every) if set(said) - EMPTY - DIGITS]
    said = naming[0] if naming else set()
    if leaf.numbers.size in (12, 16) and _leads_from_camera(every[-1]):
        return "body" if as_transform(leaf.numbers) is not None else None
    if len(naming) > 1 and not said - SIDES.keys() - EMPTY and _is_of_camera(naming[1]):
        said = naming[1]  # ``dist_coeffs: {left: ..., right: ...}``
    if {"camera", "matrix"} <= set(every[-1]):
        said = {"k", *every[-1]}
    return _role_by(said - DIGITS, leaf.numbers)


def _role_by(said: set[str], numbers: Numbers) -> Role | None:
    count = numbers.size
    of_rotation = bool(said & R_WORDS) or _starts(said, "rot")
    if count > 3 and _is_of_distortion(said) and not said & OF_RECTIFIED:
        return "D"
    if count == 4 and (said & QUATERNION_WORDS or (of_rotation and _is_unit(numbers))):
        return "R"
    if count == 9:
        return _role_of_nine(said, numbers, of_rotation)
    if count == 3:
        return _role_of_three(said, of_rotation)
    if count == 12 and (said & P_WORDS or _starts(said, "projection")):
        return "P"
    if count in (12, 16):
        of_rig = said & (POSE_WORDS | COMMON) or _starts(said, "trans") or side_marks(tuple(said))
        return "pose" if of_rig and as_transform(numbers) is not None else None
    if count == 1:
        return "baseline" if _starts(said, "baseline") or "stereobaseline" in said else None
    if count == 2 and said & SIZE_WORDS:
        return "size"
    return "K" if count == 4 and said & K_WORDS and not said & D_WORDS else None


def _role_of_three(said: set[str], of_rotation: bool) -> Role | None:
    if "shape" in said:
        return "size"  # rows, columns, channels
    if said & PLACE_WORDS:
        return "place"
    if said & ANGLE_WORDS:
        return "angles"
    if of_rotation and not said & T_WORDS:
        return "R"
    return "T" if said & T_WORDS or _starts(said, "trans") else None


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
    said = {word for key in leaf.path[-1:] for word in words(key)}
    if bare and _is_lens(lens) and not said & P_WORDS and not _starts(said, "proj"):
        return Leaf(leaf.path, lens)
    return leaf


def _leads_from_camera(said: tuple[str, ...]) -> bool:
    """Tell whether a transform's key says from the camera's axes to those of a body or the world:
    ``T_body_cam``, ``cam_to_world``, ``T_BS``.
    """
    if set(said) & OUT_OF_CAMERA:
        return True
    axes = [
        "common" if word in COMMON else "camera"
        for word in said
        if word in COMMON or word[:3] == "cam" or word == "c"
    ]
    return axes == (["camera", "common"] if "to" in said else ["common", "camera"])


def _is_of_distortion(said: set[str]) -> bool:
    return bool(said & D_WORDS) or _starts(said, "dist")


def _is_of_camera(said: set[str]) -> bool:
    """Tell whether words name a part that each camera has."""
    return _is_of_distortion(said) or bool(said & (K_WORDS | P_WORDS | SIZE_WORDS))


def _is_unit(numbers: Numbers) -> bool:
    return abs(float(np.linalg.norm(np.clip(numbers, -2, 2))) - 1) < ORTHONORMAL


def _starts(said: set[str], stem: str) -> bool:
    return any(word.startswith(stem) for word in said)


def _is_lens(numbers: Numbers) -> bool:
    return (
        numbers.size == 9
        and bool(numbers[0] > LEAST_FOCAL_PX)
        and np.array_equal(numbers[[3, 6, 7, 8]], [0, 0, 0, 1])
    )
