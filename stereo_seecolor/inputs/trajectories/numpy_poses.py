"""Poses in NumPy's files as rows of text."""

from pathlib import Path

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.reading.numpy_files import read_npz, read_one
from stereo_seecolor.errors import InputError

MAX_ARRAY_BYTES = 1 << 28
POSE_NUMBERS = (7, 8, 12, 13, 16)
"""Of a row of TartanAir, TUM, KITTI, KITTI after a time, and of a matrix (4, 4)."""


def is_numpy(path: Path, raw: bytes) -> bool:
    """Tell whether these are bytes of a .npy or .npz."""
    return raw.startswith(b"\x93NUMPY") or (path.suffix.lower() == ".npz" and raw[:2] == b"PK")


def of_numpy(path: Path, raw: bytes) -> str:
    """The rows of a NumPy file as text: an array of poses, after the times of a .npz.

    Raises InputError where it holds no array of poses.
    """
    try:
        arrays = (
            read_npz(raw, MAX_ARRAY_BYTES)
            if raw.startswith(b"PK")
            else read_one(raw, MAX_ARRAY_BYTES)
        )
    except CalibrationError as error:
        raise InputError(f"{path}: {error}") from error
    poses = [
        array.reshape(len(array), -1)
        for array in arrays.values()
        if array.ndim > 1 and array.dtype.kind in "fiu" and array[0].size in POSE_NUMBERS
    ]
    if len(poses) != 1:
        raise InputError(
            f"{path}: holds {len(poses)} arrays of poses among {', '.join(arrays)[:100]}: give one "
            "of (N, 4, 4), (N, 3, 4), or rows as of TUM or KITTI"
        )
    times = [
        array.reshape(-1, 1)
        for array in arrays.values()
        if array.ndim < 3 and array.size == len(poses[0]) and array.dtype.kind in "fiu"
    ]
    rows = np.hstack([*times[:1], poses[0].astype(np.float64)])
    return "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
