"""Rigs of any tool that writes matrices: found by the form of their numbers and by words
(``finder``), at any nesting.

OpenCV's M1 D1 M2 D2 R T in YAML, XML, JSON, .npz or .mat, VIAME's, ZED's and others' spellings, a
mapping or a file a camera, R and T or one transform, a pose for each camera, or R1 R2 P1 P2 of a
rectification. OpenCV's own files store no image size.
"""

import re
from pathlib import Path

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.cameras import make_camera
from calibration.formats.matlab import DOCUMENTED, TRANSPOSED
from calibration.formats.reading.aliases import words_for
from calibration.formats.reading.finder import Parts, Role, Side, describe_miscount, find
from calibration.formats.reading.leaves import keys, texts, words
from calibration.formats.reading.poses import Pose, has_pose, pose_in_meters
from calibration.formats.reading.section import Section, naming
from calibration.geometry import camera_matrix
from calibration.rig import Camera, CameraModel, StereoRig
from calibration.transforms import inverse, is_backward, rigid_transform

FOUR_PINHOLE = "4 coefficients as OpenCV's k1 k2 p1 p2"
FOUR_FISHEYE = "4 coefficients as OpenCV's fisheye"
FORWARD = "the transform maps left to right axes"
BACKWARD = "the transform maps right to left axes"
FROM_CAMERA = "the poses of the two cameras map from their axes"
INTO_CAMERA = "the poses of the two cameras map into their axes"
MATLABS_R = "RotationOfCamera2"
"""For row vectors, unless who wrote it outside MATLAB transposed it as the camera matrices."""
LEAST_SIDE_PX = 16
"""A size of less is of a board's corners."""
NEARER = 0.5
"""A size whose middle is nearer by this to the exchanged principal point is (rows, columns)."""
MIRROR = re.compile(r"xi(?:[ _.]?(?:[lr012]|left|right))?", re.IGNORECASE)
"""The parameter that only lenses of the omnidirectional model have."""
SAME = 1e-3
"""Relative difference of numbers that were printed twice, with other numbers of decimals."""
SIDES: tuple[Side, ...] = ("", "left", "right")
Size = tuple[int, int]


def is_rig(document: Section) -> bool:
    """Tell whether the file holds both camera matrices, and says where the second camera stands."""
    parts = find(document.content)
    return parts.pair("K") is not None and has_pose(document, parts)


def is_one_lens(document: Section) -> bool:
    """Tell whether the file holds a camera matrix of one camera alone."""
    parts = find(document.content)
    lenses = [side for side in SIDES if parts.get("K", side)]
    return len(lenses) == 1 and not (has_pose(document, parts) and lenses != [""])


def matches(document: Section) -> bool:
    """True if one file holds the whole rig, or half of it."""
    parts = find(document.content)
    return bool(parts.many or parts.pair("K")) or has_pose(document, parts)


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig of one file, or of several merged. image_size: for files that store none. Raises
    CalibrationError.
    """
    document = _of_one_rig(document)
    _named_models(document)
    parts = find(document.content)
    if parts.many:
        raise CalibrationError(
            f"{document.where}: holds {parts.many} cameras: keep the two of the stereo pair"
        )
    if not (parts.pair("K") or parts.pair("P")):
        _refuse_miscounted(document)
        if one := _alone(parts, "K"):
            raise CalibrationError(
                f"{document.where}: contains only one camera matrix, {one}: the matrix of the "
                "other camera is missing"
            )
        raise CalibrationError(
            f"{document.where}: contains no camera matrices (K1, K2): also give the intrinsics "
            "file, separated by a comma"
        )
    pose = pose_in_meters(document, parts)
    if pose is None:
        _refuse_miscounted(document)
    if pose is None and bool(R := _alone(parts, "R")) != bool(T := _alone(parts, "T")):
        raise CalibrationError(
            f"{document.where}: holds {R or T} and no {'T' if R else 'R'}: both are needed "
            "between the cameras"
        )
    if pose is None:
        raise CalibrationError(
            f"{document.where}: contains no R and T between the cameras: also give the extrinsics "
            "file, separated by a comma (two single-camera calibrations contain no stereo geometry)"
        )
    return _read_all_ways(document, parts, pose, image_size)


def _read_all_ways(
    document: Section, parts: Parts, pose: Pose, image_size: Size | None
) -> StereoRig:
    """The rig of the likeliest reading, with those of the others: a reading that no rig can be is
    none. Raises CalibrationError if none is a rig.
    """
    rms_px = document.number("rms_error_stereo") if document.has("rms_error_stereo") else None
    doubts = (*pose.doubts, *_contradictions(parts, pose))
    rigs: list[StereoRig] = []
    refused: list[CalibrationError] = []
    for text, model in _models(document, parts, pose):
        cameras = _cameras(document, parts, model, image_size)
        for reading, T_right_left in _senses(pose, parts):
            said = ", ".join(filter(None, (text, reading)))
            try:
                with naming(document.where):
                    rig = StereoRig(
                        *cameras, T_right_left, rms_px=rms_px, doubts=doubts, reading=said
                    )
                rigs.append(rig)
            except CalibrationError as error:
                refused.append(error)
    if not rigs:
        raise refused[0]
    return rigs[0].with_alternatives(rigs[1:])


def _of_one_rig(document: Section) -> Section:
    """The document, without a rig of rectified images beside the raw one. Raises CalibrationError
    for more than one rig.
    """
    mappings = {str(key): value for key, value in document.content.items()}
    for key, value in document.content.items():
        if isinstance(value, list) and all(isinstance(one, dict) for one in value):
            mappings |= {f"{key}.{i}": one for i, one in enumerate(value)}
    rigs = [
        key
        for key, value in mappings.items()
        if isinstance(value, dict) and is_rig(Section(document.where, value))
    ]
    raw = [key for key in rigs if not words_for(words(key), "rectified images")]
    if len(raw) > 1:
        raise CalibrationError(
            f"{document.where}: holds {len(raw)} rigs, {', '.join(raw[:-1])} and {raw[-1]}: keep "
            "the one of the images"
        )
    if not raw:
        return document
    rig = _of_one_rig(Section(document.where, mappings[raw[0]]))
    kept = {key: value for key, value in document.content.items() if key not in rigs}
    # first, so that nothing of another rig, half given, comes before it
    return Section(document.where, {raw[0]: rig.content} | kept)


def _refuse_miscounted(document: Section) -> None:
    """Raise CalibrationError for a part whose numbers are too few or too many."""
    if said := describe_miscount(document.content):
        raise CalibrationError(f"{document.where}: {said}: compare it with the file of the tool")


def _contradictions(parts: Parts, pose: Pose) -> list[str]:
    """Name each part that the file gives twice, with other numbers."""
    of_camera: dict[Role, str] = {"K": "camera matrices", "D": "distortions"}
    roles = [
        (role, side, f"{what} of the {side} camera")
        for role, what in of_camera.items()
        for side in SIDES[1:]
    ]
    if (T := parts.get("T")) and pose.key == ".".join(T.path):
        roles.append(("R", "", "rotations"))
    found = []
    for role, side, what in roles:
        used = parts.get(role, side)
        for other in parts.table.get((role, side), []):
            if used and not _alike(role, used.numbers, other.numbers):
                names = [".".join(leaf.path) for leaf in (used, other)]
                found.append(f"contains two {what}, {names[0]} and {names[1]}: {names[0]} is used")
    counts = [leaf.numbers.size for leaf in parts.pair("D") or ()]
    if len({*counts}) > 1:
        found.append(
            f"contains {counts[0]} coefficients of distortion for the left camera and {counts[1]} "
            "for the right one: is one missing?"
        )
    return found


def _alike(role: Role, numbers: np.ndarray, others: np.ndarray) -> bool:
    """Tell whether the numbers of two leaves are the same part, printed twice."""
    if role == "R":
        if 4 in (numbers.size, others.size):
            return True
        both = [cv2.Rodrigues(one)[0] if one.size == 3 else one for one in (numbers, others)]
    elif role == "K":
        both = [_matrix(one) for one in (numbers, others)]
    else:
        size = max(numbers.size, others.size)
        both = [np.pad(one, (0, size - one.size)) for one in (numbers, others)]
    return bool(np.allclose(both[0].ravel(), both[1].ravel(), rtol=SAME, atol=SAME))


def _alone(parts: Parts, role: Role) -> str:
    """The key of the one leaf of a role; "" for none, and for one on either side."""
    found = [leaf for side in SIDES if (leaf := parts.get(role, side))]
    return ".".join(found[0].path) if len(found) == 1 else ""


def _senses(pose: Pose, parts: Parts) -> list[tuple[str, np.ndarray]]:
    """The transform, and where its sense is open the other one, before it where the first would put
    the right camera to the left.
    """
    if pose.other is not None:
        senses = [(INTO_CAMERA if pose.is_into else FROM_CAMERA, pose.T)]
        return [*senses, (FROM_CAMERA if pose.is_into else INTO_CAMERA, pose.other)]
    R = parts.get("R") or parts.get("R", "right")
    if R is not None and R.path[-1] == MATLABS_R:
        documented = rigid_transform(pose.T[:3, :3].T, pose.T[:3, 3])
        return [(TRANSPOSED, pose.T), (DOCUMENTED, documented)]
    if pose.is_open and is_backward(pose.T):
        return [(BACKWARD, inverse(pose.T)), (FORWARD, pose.T)]
    return [("", pose.T)]


def write(rig: StereoRig, path: Path) -> None:
    """Write one FileStorage, in the notation of the extension: .yml, .yaml, .xml or .json."""
    if path.suffix not in (".yml", ".yaml", ".xml", ".json"):
        raise CalibrationError(
            "OpenCV writes .yml, .xml or .json; the extension selects the notation"
        )
    if rig.left.image_size != rig.right.image_size or rig.left.model != rig.right.model:
        raise CalibrationError(
            "an OpenCV file has one image size and one model for both cameras, but this rig has "
            "two: write native"
        )
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    if not storage.isOpened():
        raise CalibrationError("the calibration cannot be written as OpenCV's FileStorage")
    width, height = rig.left.image_size
    for key, value in (
        ("image_width", width),
        ("image_height", height),
        ("camera_model", rig.left.model),
    ):
        storage.write(key, value)
    for side, camera in ((1, rig.left), (2, rig.right)):
        storage.write(f"K{side}", camera.K)
        storage.write(
            f"D{side}", camera.distortion[None] if camera.distortion.size else np.zeros((1, 5))
        )
    storage.write("R", np.ascontiguousarray(rig.R))
    storage.write("T", np.ascontiguousarray(rig.T_right_left[:3, 3:]))
    storage.release()


def size_of(
    document: Section, parts: Parts, side: Side, K: np.ndarray, image_size: Size | None
) -> Size:
    """Of the camera, of both, or as given. Exchanged where it is (rows, columns), which the
    principal point tells.
    """
    for leaf in (parts.get("size", one) for one in (side, "", "left")):
        if leaf is None or leaf.numbers[:2].min() < LEAST_SIDE_PX:
            continue
        numbers = leaf.finite(document.where)[:2]
        if (numbers != np.round(numbers)).any():
            raise CalibrationError(
                f"{document.where}: {'.'.join(leaf.path)}: expected whole numbers of pixels, got "
                f"{numbers.tolist()}"
            )
        off_px = [float(np.abs(size / 2 - K[:2, 2]).sum()) for size in (numbers, numbers[::-1])]
        width, height = numbers[::-1] if off_px[1] < NEARER * off_px[0] else numbers
        return int(width), int(height)
    return document.needed_size(image_size)


def _named_models(document: Section) -> set[str]:
    """The lens models that the file names, without underscores. Raises CalibrationError for one
    that OpenCV has not.
    """
    named = {
        str(text).lower().replace("_", "").replace("-", "")
        for said, text in texts(document.content)
        if {"model", "type"} & set(said)
    }
    others = words_for(named, "other lens")
    if any(map(MIRROR.fullmatch, keys(document.content))):
        others |= {"omni"}
    if others:
        raise CalibrationError(
            f"{document.where}: the lens model {min(others)!r} is not supported: calibrate with "
            "OpenCV's pinhole or fisheye"
        )
    return named


def _models(document: Section, parts: Parts, pose: Pose) -> list[tuple[str, CameraModel]]:
    """The models that the file can mean: four coefficients alone are k1 k2 p1 p2 or a fisheye's."""
    named = _named_models(document)
    distortions = parts.pair("D") if parts.pair("K") else None
    if distortions is None:
        if parts.pair("K") and not np.array_equal(pose.T[:3, :3], np.eye(3)):
            one = _alone(parts, "D")
            what = (
                f"contains only one distortion, {one}"
                if one
                else "no 'D1' and 'D2' (nor distCoeffs1 ...)"
            )
            raise CalibrationError(
                f"{document.where}: {what}: the file is incomplete or of another kind"
            )
        return [("", "pinhole")]
    said_so = any(text is True and "fisheye" in said for said, text in texts(document.content))
    if (
        words_for(named, "fisheye")
        or said_so
        or any("fe" in words(leaf.path[-1]) for leaf in distortions)
    ):
        return [("", "fisheye")]
    is_open = not words_for(named, "pinhole") and all(
        leaf.numbers.size == 4 and leaf.numbers.any() for leaf in distortions
    )
    return [(FOUR_PINHOLE, "pinhole"), (FOUR_FISHEYE, "fisheye")] if is_open else [("", "pinhole")]


def _cameras(
    document: Section, parts: Parts, model: CameraModel, image_size: Size | None
) -> tuple[Camera, Camera]:
    lenses = parts.pair("K") or parts.pair("P")
    distortions = parts.pair("D") if parts.pair("K") else None
    assert lenses  # parse has looked
    cameras = []
    sides: tuple[Side, Side] = ("left", "right")
    for i, side in enumerate(sides):
        K = _matrix(lenses[i].finite(document.where))
        distortion = distortions[i].finite(document.where) if distortions else np.zeros(0)
        where = f"{document.where}: {'.'.join(lenses[i].path)}"
        cameras.append(
            make_camera(where, K, distortion, size_of(document, parts, side, K, image_size), model)
        )
    return cameras[0], cameras[1]


def _matrix(numbers: np.ndarray) -> np.ndarray:
    """K (3, 3) of nine numbers, of fx fy cx cy, or of a projection (3, 4)."""
    if numbers.size == 4:
        return camera_matrix(*numbers)
    return numbers.reshape(3, -1)[:, :3].copy()
