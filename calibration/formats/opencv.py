"""OpenCV's names for a rig, M1 D1 M2 D2 and R T, in YAML, XML, JSON or .npz, in one file or several; R a matrix or a vector.

ZED's custom calibration (K_LEFT, D_LEFT, Size, T in mm) and VIAME's .npz (cameraMatrixL, distCoeffsL, mm or meters) belong here.
OpenCV's stereo_calib sample stores no image size; files written here do, and name the camera model.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.ros import make_camera, rectified_rig, rig_from_projections
from calibration.formats.scalars import spelling, with_matrices
from calibration.formats.section import Section, naming
from calibration.formats.units import to_meters
from calibration.rig import MAX_BASELINE_M, Camera, CameraModel, StereoRig
from calibration.transforms import rigid

K_NAMES = (
    "k", "m", "cameramatrix", "cammatrix", "cameramatrixcoefficients", "intrinsicmatrix", "intrinsics", "intrinsic", "cm", "mtx",
    "a",
)  # fmt: skip
D_NAMES = (
    "d", "distcoeffs", "distcoeff", "distortioncoefficients", "distortioncoeffs", "distortion", "distcoefs", "dist", "kc",
)  # fmt: skip
SIDES = (
    ("1", "2"), ("l", "r"), ("left", "right"), ("cam1", "cam2"), ("cam0", "cam1"), ("camera1", "camera2"), ("camera0", "camera1"),
    ("leftcamera", "rightcamera"), ("cameraleft", "cameraright"), ("0", "1"),
)  # fmt: skip
FISHEYE_NAMES = ("fisheye", "equidistant", "kannala_brandt", "KannalaBrandt8")
TO_OPENCV = "rotationofcamera2"  # what MATLAB's stereoParametersToOpenCV returns, with the rows of the images before the columns
R_NAMES = ("r", "rotationmatrix", "rotation", "rstereo", "stereor", "rot", "rmat", "rotationvector", "rvec", "om", TO_OPENCV)
T_NAMES = ("t", "translationvector", "translation", "tstereo", "stereot", "trans", "tvec", "trns", "translationofcamera2")
TRANSFORMS = ("t", "transform", "transformation", "transformationmatrix", "extrinsics", "extrinsic", "extrinsicmatrix")
"""Of R and T in one matrix (4, 4), x2 = T x1; of the inverse, images tell (``mistakes``)."""
GROUPS = ("extrinsics", "extrinsic", "stereo", "intrinsics")
"""Mappings that some tools put matrices into, which others write at the top."""
MATRIX, COEFFICIENTS, ROTATION, TRANSLATION = (9,), (4, 5, 8, 12, 14), (9, 3), (3,)
"""How many numbers each has: K1 of a camera matrix is not k1 of a lens."""
UNITS = ("unit", "units", "worldunits", "tunit", "tunits", "translationunit", "translationunits", "baselineunit")
SIZE_KEYS = ("width", "height", "image_width", "image_height", "resolution")
ZED_FISHEYE = ("D_LEFT_FE", "D_RIGHT_FE")
FOUR_PINHOLE = "4 coefficients as OpenCV's k1 k2 p1 p2"
FOUR_FISHEYE = "4 coefficients as OpenCV's fisheye"
LEAST_MM = 20.0
"""A baseline of this number or more cannot be in meters, centimeters or board squares: stereoCalibrate was given millimeters."""
Size = tuple[int, int]


def has_intrinsics(document: Section) -> bool:
    """Tell whether the file holds both camera matrices."""
    return keys_of(document, K_NAMES, MATRIX) is not None


def keys_of(document: Section, names: tuple[str, ...], counts: tuple[int, ...]) -> tuple[str, str] | None:
    """The keys, left and right, that the file spells one of these names with: K1 and K2, cameraMatrixL and Camera_Matrix_R ..."""
    known = _spelled(document, counts)
    for (left, right), name in product(SIDES, names):
        for keys in ((name + left, name + right), (left + name, right + name)):
            if all(key in known for key in keys):
                return known[keys[0]], known[keys[1]]
    return None


def _spelled(document: Section, counts: tuple[int, ...]) -> dict[str, str]:
    """Spelling -> key of all that hold as many numbers as one of ``counts``."""
    return {spelling(key): key for key in document.content if document.size(key) in counts}


def _pose_keys(document: Section) -> tuple[str, str] | None:
    """The keys of rotation and translation between the cameras."""
    rotations, translations = _spelled(document, ROTATION), _spelled(document, TRANSLATION)
    R = next((rotations[name] for name in R_NAMES if name in rotations), None)
    T = next((translations[name] for name in T_NAMES if name in translations), None)
    return (R, T) if R and T else None


def has_extrinsics(document: Section) -> bool:
    """Tell whether the file says where the second camera stands."""
    return _has_pose(document) or document.has("R1", "R2", "P1", "P2")


def is_rectified(document: Section) -> bool:
    """Tell whether the file holds the projections of rectified images alone, and nothing of the cameras before."""
    return document.has("P1", "P2") and not document.has("R1") and not has_intrinsics(document)


def matches(document: Section) -> bool:
    """True if one file holds the whole rig, or half of it."""
    document = sides_apart(document)
    return has_intrinsics(document) or has_extrinsics(document) or is_rectified(document)


def sides_apart(document: Section) -> Section:
    """A file with a mapping a camera (``left: {K: ..., D: ...}``), or one for R and T, as one whose keys name their sides.

    Others as they are. Where the right camera holds R and T, these are from the left one to it.
    """
    content = dict(document.content)
    inner = {spelling(key): value for key, value in content.items() if isinstance(value, dict) and "data" not in value}
    for name in GROUPS:
        content = {str(key): value for key, value in inner.get(name, {}).items()} | content
    for left, right in SIDES:
        if left in inner and right in inner:
            cameras = [with_matrices(inner[side]) for side in (left, right)]
            sided = [{f"{key}{n}": value for key, value in camera.items()} for n, camera in enumerate(cameras, 1)]
            pose = {str(key): value for key, value in inner[right].items() if spelling(str(key)) in (*R_NAMES, *T_NAMES)}
            size = {str(key): value for key, value in inner[left].items() if "size" in str(key).lower() or str(key) in SIZE_KEYS}
            content = sided[0] | sided[1] | size | ({} if _has_pose(document) else pose) | content
            break
    return _with_R_and_T(Section(document.where, content))


def _with_R_and_T(document: Section) -> Section:
    """A file whose R and T are one matrix, as one of both; others as they are."""
    key = next((key for name, key in _spelled(document, (16,)).items() if name in TRANSFORMS), None)
    if key is None or _has_pose(document):
        return document
    T = document.numbers(key, 16).reshape(4, 4)
    if not np.array_equal(T[3], [0, 0, 0, 1]):
        return document
    others = {other: value for other, value in document.content.items() if other != key}
    return Section(document.where, others | {"R": T[:3, :3].tolist(), "T": T[:3, 3].tolist()})


def _has_pose(document: Section) -> bool:
    return _pose_keys(document) is not None


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig of one file, or of intrinsics and extrinsics merged. image_size: for files that store none."""
    document = sides_apart(document)
    if is_rectified(document):
        projections = [document.matrix(key, 3, 4) for key in ("P1", "P2")]
        return rectified_rig(document.where, projections, _size(document, image_size))
    if not has_intrinsics(document):
        raise CalibrationError(
            f"{document.where}: holds no camera matrices (K1, K2): give the intrinsics file too, with a comma between"
        )
    if not has_extrinsics(document):
        raise CalibrationError(
            f"{document.where}: holds no R and T between the cameras: give the extrinsics file too, with a comma between "
            "(two single-camera calibrations hold no stereo geometry)"
        )
    size = _size(document, image_size)
    rigs = [_rig(document, *_parse_cameras(document, size, model)) for model in _models(document)]
    if len(rigs) == 1:
        return rigs[0]
    return replace(rigs[0], reading=FOUR_PINHOLE).with_alternatives([replace(rigs[1], reading=FOUR_FISHEYE)])


def _rig(document: Section, left: Camera, right: Camera) -> StereoRig:
    if not _has_pose(document):
        rotations = [document.matrix(key, 3, 3) for key in ("R1", "R2")]
        return rig_from_projections(left, right, rotations, [document.matrix(key, 3, 4) for key in ("P1", "P2")])
    keys = _pose_keys(document)
    assert keys
    R, T = document.numbers(keys[0], *ROTATION), document.numbers(keys[1], *TRANSLATION)
    doubts: tuple[str, ...] = ()
    unit = next(
        (document.text(key) for key in document.content if spelling(key) in UNITS and isinstance(document.content[key], str)), None
    )
    if unit or not has_numbered_sides(document) or LEAST_MM <= np.linalg.norm(T) <= MAX_BASELINE_M * 1000:
        T, doubts = to_meters(T, "millimeters" if document.has("K_LEFT") else unit)
    with naming(document.where):
        return StereoRig(left, right, rigid(R.reshape(3, 3) if R.size == 9 else cv2.Rodrigues(R)[0], T), doubts=doubts)


def has_numbered_sides(document: Section) -> bool:
    """True for OpenCV's own spelling (K1, M2): meters then. VIAME's and ZED's name their sides, and write millimeters or meters."""
    keys = keys_of(document, K_NAMES, MATRIX)
    return keys is not None and ("1" in keys[0] or "0" in keys[0])


def write(rig: StereoRig, path: Path) -> None:
    """Write one FileStorage, in the notation of the path's extension: .yml, .yaml, .xml or .json."""
    if path.suffix not in (".yml", ".yaml", ".xml", ".json"):
        raise CalibrationError("OpenCV writes .yml, .xml or .json, and takes the notation from the extension")
    if rig.left.image_size != rig.right.image_size or rig.left.model != rig.right.model:
        raise CalibrationError(
            "OpenCV's file has one image size and one model for both cameras, and this rig has two: write native"
        )
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    if not storage.isOpened():
        raise CalibrationError("the calibration cannot be written as OpenCV's FileStorage")
    width, height = rig.left.image_size
    for key, value in (("image_width", width), ("image_height", height), ("camera_model", rig.left.model)):
        storage.write(key, value)
    for side, camera in ((1, rig.left), (2, rig.right)):
        storage.write(f"K{side}", camera.K)
        storage.write(f"D{side}", camera.distortion[None] if camera.distortion.size else np.zeros((1, 5)))
    storage.write("R", np.ascontiguousarray(rig.R))
    storage.write("T", np.ascontiguousarray(rig.T_right_left[:3, 3:]))
    storage.release()


def _size(document: Section, image_size: Size | None) -> Size:
    size = _stored_size(document) or image_size
    if size is None:
        raise CalibrationError(
            f"{document.where}: stores no image size (OpenCV's format has none): give the size of the images, "
            "or add the keys image_width and image_height"
        )
    return size


def _stored_size(document: Section) -> Size | None:
    one, two = _spelled(document, (1,)), _spelled(document, (2,))
    for width, height in (("imagewidth", "imageheight"), ("width", "height"), ("imagesizewidth", "imagesizeheight")):
        if width in one and height in one:
            return document.image_size(one[width], one[height])
    for name in ("imagesize", "size", "imgsize", "resolution", "imagesize1", "resolution1"):
        if name in two:
            size = document.image_size(two[name])
            return size[::-1] if TO_OPENCV in _spelled(document, ROTATION) else size
    return None


def _distortion_keys(document: Section) -> tuple[str, str] | None:
    """None for cameras of images that were rectified: not turned to each other, and without distortion."""
    keys = ZED_FISHEYE if document.has(*ZED_FISHEYE) else keys_of(document, D_NAMES, COEFFICIENTS)
    pose = _pose_keys(document)
    turned = pose is None or not np.array_equal(document.numbers(pose[0]), np.eye(3).ravel())
    if keys is None and turned:
        raise CalibrationError(
            f"{document.where}: no 'D1' and 'D2' (nor distCoeffs1 ...): the file is incomplete or of another kind"
        )
    return keys


def _models(document: Section) -> tuple[CameraModel, ...]:
    """The camera models that the file can mean: four coefficients without a model's name are k1 k2 p1 p2 or a fisheye's."""
    named = next((name for name in ("camera_model", "distortion_model", "model") if document.has(name)), None)
    if named:
        return ("fisheye",) if document.text(named) in FISHEYE_NAMES else ("pinhole",)
    keys = _distortion_keys(document)
    if keys is None or keys == ZED_FISHEYE:
        return ("fisheye",) if keys else ("pinhole",)
    distortion = [document.numbers(key) for key in keys]
    open_to_both = all(coefficients.size == 4 and coefficients.any() for coefficients in distortion)
    return ("pinhole", "fisheye") if open_to_both else ("pinhole",)


def _parse_cameras(document: Section, size: Size, model: CameraModel) -> tuple[Camera, Camera]:
    K_keys, D_keys = keys_of(document, K_NAMES, MATRIX), _distortion_keys(document)
    assert K_keys  # parse has looked
    distortion = [document.numbers(key) for key in D_keys] if D_keys else [np.zeros(0), np.zeros(0)]
    left, right = (
        make_camera(f"{document.where}: {key}", document.matrix(key, 3, 3), own, size, model)
        for key, own in zip(K_keys, distortion, strict=True)
    )
    return left, right
