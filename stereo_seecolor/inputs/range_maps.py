"""Range maps of other programs: kinds of files, recognized by their content, and units."""

import io
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.formats.reading.binary import read_arrays
from calibration.quiet import ignored_warnings
from stereo_seecolor.errors import InputError, library_for
from stereo_seecolor.files.camera_images import decode_raw
from stereo_seecolor.files.image_headers import (
    MAX_PIXELS,
    TIFF_COMPRESSION,
    TIFF_SIGNATURES,
    TIFF_UNCOMPRESSED,
    refuse_large,
    tiff_numbers,
)
from stereo_seecolor.files.raw_arrays import PARSING
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.records import Map, Mask

FARTHEST_SCENE_M, NEAREST_SCENE_M = 100.0, 0.03
"""No camera sees farther than this under water, or has a scene nearer."""

PFM = re.compile(rb"P([fF])\s+(\d+)\s+(\d+)\s+(\S+?)\s")
EXR_SIGNATURE = b"\x76\x2f\x31\x01"
_RANGE_WORDS = re.compile("range|depth|dist|dep|(^|_)z($|_)", re.IGNORECASE)
_HALF_FLOAT, _NO_DATA, _BITS = 16, 42113, 258  # bits; tags of GDAL and of TIFF 6.0
_READ_BY_OPENCV = (TIFF_UNCOMPRESSED, 5, 7, 8, 32773, 32946)
"""LZW, JPEG, deflate, PackBits, deflate."""
_BIG_TIFF = (b"II+\x00", b"MM\x00+")
_TOPS = (1.0, 255.0, 65535.0)
"""The largest values of maps that were normalized to their own least and largest one."""
_SET_UNITS = (
    "set input.range_units_per_m to the number of its units in a meter (1000 for millimeters)"
)


def decode_range_map(content: bytes, path: Path, units_per_m: float | None) -> Map:
    """Decode a file's content to meters, as ``read_range_map``; ``path`` is for messages."""
    values = _plane(_decoded(content, path), path)
    stored = values.dtype
    if stored.kind not in "fiu" or (stored.itemsize == 1 and units_per_m is None):
        raise InputError(
            f"{path}: holds {stored} pixels, but a range map is meters in floating point or "
            "millimeters in 16 bits or more; 8-bit maps, as monocular depth networks write "
            "them (near is bright: inverse depth), have no scale"
        )
    known = np.isfinite(values) & (values > 0)
    if not known.any() and len(np.unique(values[values < 0])) > 1:
        raise InputError(
            f"{path}: holds only negative values: give ranges as positive numbers, 0 or NaN "
            "where unknown"
        )
    if units_per_m is None:
        known &= _below_top(values, known, path)
        units_per_m = 1.0 if stored.kind == "f" else 1000.0
    elif stored.kind != "f":
        known &= values < np.iinfo(stored).max
    with np.errstate(invalid="ignore", over="ignore"):
        range_m = np.where(known, values / np.float64(units_per_m), np.nan).astype(np.float32)
    return _plausible(range_m, path, units_per_m)


def holds_floats(path: Path) -> bool:
    """Whether a file holds one channel of floating-point numbers, as range maps do."""
    try:
        values = _plane(_decoded(read_bytes(path), path), path)
    except InputError:
        return False
    return values.dtype.kind == "f"


def _decoded(content: bytes, path: Path) -> NDArray[Any]:
    """The values as they are stored, of one channel or several."""
    try:
        with PARSING:
            arrays = read_arrays(content, 8 * MAX_PIXELS)
    except CalibrationError as error:
        raise InputError(f"{path}: {error}") from error
    if arrays is not None:
        return _range_array(arrays, path)
    if header := PFM.match(content):
        return _pfm(content, header, path)
    if content.startswith(EXR_SIGNATURE):
        return _range_array(_exr_channels(content, path), path)
    if content.startswith(_BIG_TIFF) or (
        content.startswith(TIFF_SIGNATURES) and _needs_library(content)
    ):
        return _tiff(content, path)
    return decode_raw(content, path, cv2.IMREAD_UNCHANGED)


def _plane(values: NDArray[Any], path: Path) -> NDArray[Any]:
    """The values as (H, W); of channels that are all the same, as gray in color, the first."""
    if values.ndim == 3 and 1 in values.shape:
        values = values.squeeze(values.shape.index(1))
    if values.ndim == 3 and values.shape[2] in (3, 4):
        first, *others = np.moveaxis(values[..., :3], -1, 0)
        if all(np.array_equal(first, other, equal_nan=first.dtype.kind == "f") for other in others):
            return np.asarray(first)
    if values.ndim != 2:
        raise _not_one_channel(
            path, f"{values.shape[2]} channels" if values.ndim == 3 else f"{values.ndim} dimensions"
        )
    return values


def _not_one_channel(path: Path, what: str) -> InputError:
    return InputError(
        f"{path}: has {what}, but a range map has one: give the distance of each point from the "
        "camera"
    )


def _range_array(arrays: Mapping[str, Any], path: Path) -> NDArray[Any]:
    """The one array that can be an image, else the one of these that is called after range or
    depth, else that of the channels of a gray picture.
    """
    images = {
        name: array
        for name, array in arrays.items()
        if isinstance(array, np.ndarray) and _is_map(array)
    }
    called = {name: array for name, array in images.items() if _RANGE_WORDS.search(name)}
    gray = [images[channel] for channel in "RGB" if channel in images]
    same = len(gray) == 3 and all(np.array_equal(gray[0], one, equal_nan=True) for one in gray)
    for found in (images, called, {"R": gray[0]} if same else {}):
        if len(found) == 1:
            return next(iter(found.values()))
    held = (
        f"several maps ({', '.join(images)})"
        if images
        else f"no map, but {', '.join(arrays) or 'nothing'}"
    )
    raise InputError(
        f"{path}: holds {held}: save the ranges as one array (height, width), called range_m"
    )


def _is_map(array: NDArray[Any]) -> bool:
    return array.dtype.kind in "fiu" and array.ndim in (2, 3) and sorted(array.shape)[-2] > 4


def _pfm(content: bytes, header: re.Match[bytes], path: Path) -> NDArray[np.float32]:
    """Rows from the bottom up, (H, W) or (H, W, 3); the sign of the third number is the order of
    bytes, and its size is not a unit.
    """
    width, height = int(header[2]), int(header[3])
    shape = (height, width) if header[1] == b"f" else (height, width, 3)
    try:
        order = "<" if float(header[4]) < 0 else ">"
        count = int(np.prod(shape, dtype=np.int64))
        values = np.frombuffer(content, f"{order}f4", count, header.end()).reshape(shape)
    except ValueError as error:
        raise InputError(
            f"{path}: is truncated or damaged (the PFM ends before its last row)"
        ) from error
    return values[::-1].astype(np.float32)


def _exr_channels(content: bytes, path: Path) -> dict[str, Any]:
    with library_for(f"{path}: OpenEXR", "exr", InputError):
        import OpenEXR
    try:
        with OpenEXR.File(io.BytesIO(content), separate_channels=True, header_only=True) as file:
            first, last = file.header()["dataWindow"]
            width, height = (int(b) - int(a) + 1 for a, b in zip(first, last, strict=True))
            count = len(file.header()["channels"])
        refuse_large(path, width, height, count)
        with OpenEXR.File(io.BytesIO(content), separate_channels=True) as file:
            return {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: is damaged: {' '.join(str(error).split())[:200]}") from error


def _needs_library(content: bytes) -> bool:
    """True for what OpenCV does not read: half floats, compressions, no-data. False if cut."""
    try:
        tags = tiff_numbers(content)
    except struct.error:
        return False
    compressed = tags.get(TIFF_COMPRESSION, TIFF_UNCOMPRESSED) not in _READ_BY_OPENCV
    return tags.get(_BITS) == _HALF_FLOAT or _NO_DATA in tags or compressed


def _tiff(content: bytes, path: Path) -> NDArray[Any]:
    """By GDAL; a value that the file declares as unknown becomes 0."""
    with library_for(f"{path}: a TIFF of this kind", "geo", InputError):
        import rasterio
        from rasterio.errors import NotGeoreferencedWarning, RasterioError
    try:
        with rasterio.MemoryFile(content) as memory:
            with ignored_warnings(NotGeoreferencedWarning):
                file = memory.open(driver="GTiff")
            with file:
                refuse_large(path, file.width, file.height, file.count)
                if file.count > 4:
                    raise _not_one_channel(path, f"{file.count} channels")
                values: NDArray[Any] = np.moveaxis(file.read(), 0, -1)
                unknown = file.nodata
    except RasterioError as error:
        raise InputError(
            f"{path}: is truncated or damaged: "
            f"{' '.join(str(error.__cause__ or error).split())[:200]}"
        ) from error
    if unknown is not None:
        values = np.where(values == unknown, 0, values)
    return values


def _below_top(values: NDArray[Any], known: Mask, path: Path) -> Mask:
    """Where values do not mark what is unknown: the largest that 16 bits hold, far above all
    others.

    Raises InputError for a map that was normalized: it reaches the largest value, and others lie
    right below.
    """
    if not known.any():
        return known
    largest, least, whole = values[known].max(), values[known].min(), values.dtype.kind != "f"
    below = known & (values < largest)
    tops = (*_TOPS[1:], np.iinfo(values.dtype).max) if whole else _TOPS
    if not np.isclose(float(largest), tops, rtol=2e-5).any() or not below.any():
        return known
    if whole and values[below].max() < 0.9 * largest:
        return np.asarray(below)
    if least > 0.02 * largest and not whole:
        return known
    raise InputError(
        f"{path}: its values end at {largest:g}, the largest possible value: a map without "
        "scale, as monocular depth networks write it (if near is bright: inverse depth), or "
        f"clipped: give ranges in meters, or {_SET_UNITS}"
    )


def _plausible(range_m: Map, path: Path, units_per_m: float) -> Map:
    """``range_m`` with values that no range under water has unknown. Raises InputError where these
    are the most.
    """
    known = np.isfinite(range_m)
    if not known.any():
        return range_m
    middle = float(np.median(range_m[known]))
    if not NEAREST_SCENE_M <= middle <= FARTHEST_SCENE_M:
        read_as = (
            "meters"
            if units_per_m == 1
            else "millimeters"
            if units_per_m == 1000
            else f"1/{units_per_m:g} m"
        )
        raise InputError(
            f"{path}: its median is {middle:.4g} m, read as {read_as}, an impossible range under "
            f"water: {_SET_UNITS}; convert disparities or inverse depths first"
        )
    with np.errstate(invalid="ignore"):
        return np.where(range_m <= FARTHEST_SCENE_M, range_m, np.float32(np.nan))
