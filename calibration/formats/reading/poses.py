"""The transforms between two cameras that the parts of a file give, in the file's unit, the most
usual way to write one first.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.reading.aliases import METERS, words_for
from calibration.formats.reading.finder import (
    Parts,
    Role,
    Side,
    as_transform,
    is_rotation,
    leads_from_camera,
    leads_into_camera,
)
from calibration.formats.reading.leaves import Leaf, texts, words
from calibration.formats.reading.section import Section
from calibration.formats.reading.units import to_meters
from calibration.formats.ros import transform_of_projections
from calibration.geometry import Array
from calibration.rig import MAX_BASELINE_M
from calibration.transforms import inverse, is_backward, rigid_transform, rotation_from_quaternion

LEAST_MM = 20.0
"""A baseline of this number or more cannot be in meters, centimeters or board squares:
stereoCalibrate was given millimeters.
"""
FARTHEST = 1e9
"""Of any unit: more is no length, and its square may be no number."""
OTHER_BASELINE = 0.01
"""Relative difference of baselines from which transforms in a file are of two calibrations."""
FULL_TURN = 2 * np.pi + 0.01
ROUNDED = 1e-6
"""Error of R R^T = I from which a rotation has been rounded when it was written."""


@dataclass(frozen=True, eq=False)
class Pose:
    """The transform (4, 4) from left to right axes, and the key of its translation. is_open: it may
    be the inverse. other: what it is where the poses of the two cameras lead from their axes
    (is_into) in place of into them, or the reverse.
    """

    key: str
    T: Array
    is_open: bool = False
    doubts: tuple[str, ...] = ()
    other: Array | None = None
    is_into: bool = False


def has_pose(document: Section, parts: Parts) -> bool:
    """Tell whether the file says where the second camera stands, rightly or not."""
    try:
        return next(_poses(document.where, parts), None) is not None
    except CalibrationError:
        return True


def pose_in_meters(document: Section, parts: Parts) -> Pose | None:
    """The transform between the cameras; None where the file holds none. Raises CalibrationError
    for one that is none.

    Its doubts name a unit that was guessed, and another transform in the file that disagrees.
    """
    found = _poses(document.where, parts)
    first = next(found, None)
    if first is None:
        return None
    # a place that is the axes' own origin, where another one is not
    first = (
        first if first.T[:3, 3].any() else next((one for one in found if one.T[:3, 3].any()), first)
    )
    pose = _in_meters(document, first, parts)
    others: list[str] = []
    with suppress(CalibrationError):
        for other in (one for one in found if one.T[:3, 3].any()):
            lengths_mm = [
                1000 * float(np.linalg.norm(one.T[:3, 3]))
                for one in (pose, _in_meters(document, other, parts))
            ]
            if abs(lengths_mm[1] - lengths_mm[0]) > OTHER_BASELINE * lengths_mm[0]:
                mine, its = (
                    f"{key} ({length_mm:.1f} mm)"
                    for key, length_mm in zip((pose.key, other.key), lengths_mm, strict=True)
                )
                others.append(f"contains two baselines, of {mine} and of {its}: {pose.key} is used")
    return replace(pose, doubts=(*pose.doubts, *parts.doubts, *others))


def _poses(where: str, parts: Parts) -> Iterator[Pose]:
    R, T, transform = (_one(parts, role) for role in ("R", "T", "pose"))
    between: list[tuple[bool, Pose]] = []
    if R and T:
        matrix = rigid_transform(_rotation(where, R[0]), T[0].finite(where))
        pose = _with_sense(Pose(_name(T[0]), matrix, T[1] != ""), T[1])
        between.append((_is_between(*T), pose))
    if transform:
        pose = Pose(_name(transform[0]), _square(where, transform[0]), True)
        between.append((_is_between(*transform), _with_sense(pose, transform[1])))
    yield from (pose for is_between, pose in between if is_between)
    # the cameras' own poses outrank a transform that does not name what it is between
    yield from _of_cameras(where, parts)
    yield from (pose for is_between, pose in between if not is_between)
    turns, projections = parts.pair("R"), parts.pair("P")
    if projections and (turns or not parts.pair("K")):
        rotations = [_rotation(where, turn) for turn in turns] if turns else [np.eye(3), np.eye(3)]
        Ps = [leaf.finite(where).reshape(3, 4) for leaf in projections]
        yield Pose(_name(projections[1]), transform_of_projections(rotations, Ps))
    if not (R or turns):
        sides: tuple[Side, ...] = ("", "both", "right")
        for angles in filter(None, (parts.get("angles", side) for side in sides)):
            raise CalibrationError(
                f"{where}: {_name(angles)}: rotation angles are ambiguous, because their order "
                "differs between tools: give R as a matrix, a quaternion, or a rotation "
                "vector in radians"
            )


def _is_between(leaf: Leaf, side: Side) -> bool:
    """Tell whether a transform's keys name what it is between, or there is but one key."""
    said = {word for key in leaf.path for word in words(key)}
    return side != "" or len(leaf.path) == 1 or bool(words_for(said, "both cameras"))


def _of_cameras(where: str, parts: Parts) -> Iterator[Pose]:
    """By the poses of both cameras: R and T, or a matrix, into them or from them."""
    Rs, Ts, places = parts.pair("R"), parts.pair("T"), parts.pair("place")
    rotations = [_rotation(where, R) for R in Rs] if Rs and (Ts or places) else []
    if rotations and Ts:
        own = [rigid_transform(R, T.finite(where)) for R, T in zip(rotations, Ts, strict=True)]
        is_into = not any(leads_from_camera(words(key)) for key in Ts[1].path)
        yield _of_own_poses(Ts[1], own, is_into)
    if rotations and places:
        centers = [place.finite(where) for place in places]
        both = [
            _between([inverse(rigid_transform(R, c)) for R, c in zip(turns, centers, strict=True)])
            for turns in (rotations, [R.T for R in rotations])
        ]
        yield _likelier(Pose(_name(places[1]), both[0], other=both[1]))
    transforms: tuple[tuple[Role, bool], ...] = (("pose", True), ("body", False))
    for role, is_into in transforms:
        if pair := parts.pair(role):
            yield _of_own_poses(pair[1], [_square(where, leaf) for leaf in pair], is_into)


def _of_own_poses(leaf: Leaf, own: list[Array], is_into: bool) -> Pose:
    """Of transforms between both cameras and common axes, with the other sense of both."""
    readings = [_between(own), _between(list(map(inverse, own)))]
    T, other = readings if is_into else readings[::-1]
    return _likelier(Pose(_name(leaf), T, other=other, is_into=is_into))


def _likelier(pose: Pose) -> Pose:
    """The pose, or the other one where only that puts the right camera to the right."""
    assert pose.other is not None
    if _direction(pose.other) < _direction(pose.T):
        return replace(pose, T=pose.other, other=pose.T, is_into=not pose.is_into)
    return pose


def _direction(T: Array) -> int:
    """0 for a right camera to the right of the left one, 1 above or below it, 2 to its left."""
    return 2 if is_backward(T) else 0 if is_backward(inverse(T)) else 1


def _between(into: list[Array]) -> Array:
    """The transform from left to right axes, of transforms into both cameras."""
    return np.asarray(into[1] @ inverse(into[0]))


def _one(parts: Parts, role: Role) -> tuple[Leaf, Side] | None:
    """The one leaf of a role, by the sides that it names; None for none, one on either side, and
    the left one's alone, or one into a camera's axes from those of a body.
    """
    if parts.pair(role) and not parts.get(role):
        return next(
            ((leaf, side) for side in ("both", "reversed") if (leaf := parts.get(role, side))), None
        )
    # the left camera's own place is not a transform to the right one
    sides: tuple[Side, ...] = ("", "both", "reversed", "right")
    found = next(((leaf, side) for side in sides if (leaf := parts.get(role, side))), None)
    if found and leads_into_camera(words(found[0].path[-1])):
        return None
    return (found[0], "") if found and found[1] == "right" else found


def _with_sense(pose: Pose, side: Side) -> Pose:
    return Pose(pose.key, inverse(pose.T), pose.is_open) if side == "reversed" else pose


def _rotation(where: str, leaf: Leaf) -> Array:
    """(3, 3) of a matrix or a rotation vector; the nearest rotation where it was rounded."""
    numbers = leaf.finite(where)
    if numbers.size == 4:
        return _of_quaternion(leaf)
    if numbers.size == 3:
        if (turn := float(np.linalg.norm(np.clip(numbers, -1e9, 1e9)))) > FULL_TURN:
            raise CalibrationError(
                f"{where}: {_name(leaf)}: a rotation vector of {turn:.4g} is "
                "longer than a full turn: give it in radians, or R as a matrix"
            )
        return np.asarray(cv2.Rodrigues(numbers)[0], dtype=np.float64)
    R = numbers.reshape(3, 3)
    if is_rotation(numbers) and np.abs(R @ R.T - np.eye(3)).max() > ROUNDED:
        U, _, Vt = np.linalg.svd(R)
        return np.asarray(U @ Vt, dtype=np.float64)
    return R


def _of_quaternion(leaf: Leaf) -> Array:
    """w first where a word says so or, as cameras are turned little, where it is largest."""
    said = {word for key in leaf.path for word in words(key)}
    numbers = leaf.numbers / np.linalg.norm(leaf.numbers)
    first = "wxyz" in said or ("xyzw" not in said and abs(numbers[0]) > abs(numbers[3]))
    return rotation_from_quaternion(np.roll(numbers, -1) if first else numbers)


def _square(where: str, leaf: Leaf) -> Array:
    numbers = as_transform(leaf.finite(where))
    assert numbers is not None  # its role says so
    return rigid_transform(_rotation(where, Leaf(leaf.path, numbers[:, :3].ravel())), numbers[:, 3])


def _in_meters(document: Section, pose: Pose, parts: Parts) -> Pose:
    stated = next(
        (word for word in words(pose.key.split(".")[-1]) if word in METERS), None
    ) or _stated_unit(document)
    numbered = (leaf := parts.get("K", "left")) is None or any(
        one in words(key) for key in leaf.path[-1:] for one in ("0", "1")
    )
    length = float(np.linalg.norm(np.clip(pose.T[:3, 3], -FARTHEST, FARTHEST)))
    if not 0 < length < FARTHEST:
        return pose
    if not stated and numbered and not LEAST_MM <= length <= MAX_BASELINE_M * 1000:
        return pose
    shift, doubts = to_meters(pose.T[:3, 3], stated)
    other = pose.other
    if other is not None:
        other = rigid_transform(
            other[:3, :3], other[:3, 3] * (float(np.linalg.norm(shift)) / length)
        )
    return replace(pose, T=rigid_transform(pose.T[:3, :3], shift), doubts=doubts, other=other)


def _stated_unit(document: Section) -> str | None:
    """The unit that the file names; millimeters for VIAME's and ZED's own spellings."""
    if document.has("square_size_mm") or document.has("K_LEFT"):
        return "millimeters"
    named = (str(text) for said, text in texts(document.content) if {"unit", "units"} & set(said))
    return next((text for text in named if text.strip().lower() in METERS), None)


def _name(leaf: Leaf) -> str:
    return ".".join(leaf.path)
