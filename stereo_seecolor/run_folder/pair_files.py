"""The files of one pair as content: range map; corrected frame and cloud; rectified images."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.config import OutputConfig
from stereo_seecolor.files.atomic import Content
from stereo_seecolor.files.encode import (
    ImageFormat,
    encode_confidence,
    encode_image,
    encode_map,
    rounded,
)
from stereo_seecolor.files.ply import encode_cloud
from stereo_seecolor.files.png import encode_codes
from stereo_seecolor.records import Correction, Image, RangeMap
from stereo_seecolor.run_folder.layout import original_path, product_path

MASK_CODES = {"good": 0, "range unknown": 1, "range filled in": 2, "color not recoverable": 3}

FORMAT_OF_SUFFIX: dict[str, ImageFormat] = {
    ".png": "png",
    ".jpg": "jpg",
    ".jpeg": "jpg",
    ".tif": "tiff",
    ".tiff": "tiff",
}

Files = dict[str, tuple[str, Content]]
"""Product -> path relative to OUT, content. Content is encoded when it is written, so that one file
at a time is in memory.

The largest come first: the disk is waited for while the next are encoded.
"""
Encoders = dict[str, Callable[[], bytes | memoryview]]


def range_files(name: str, range_map: RangeMap, config: OutputConfig) -> Files:
    """Give the files of a range map: OUT/range, OUT/range_std and OUT/confidence."""
    std_m = rounded(range_map.range_std_m) if config.preset == "lean" else range_map.range_std_m
    contents: Encoders = {
        "range": lambda: encode_map(range_map.range_m, config.deflated_maps),
        "range_std": lambda: encode_map(std_m, config.deflated_maps),
        "confidence": lambda: encode_confidence(range_map.confidence),
    }
    return _files(contents, partial(product_path, name=name, image_format=config.image_format))


def correction_files(
    name: str,
    correction: Correction,
    range_map: RangeMap,
    geometry: RectifiedPair | None,
    config: OutputConfig,
    exif: bytes,
) -> Files:
    """Give the files of a corrected frame: OUT/corrected, OUT/mask and, if wanted and the camera is
    known, OUT/clouds. exif: the left image's, or b"".
    """
    pixels = correction.image if correction.linear is None else correction.linear
    contents: Encoders = {}
    if config.with_clouds and geometry is not None:
        rays = geometry.rays
        contents["clouds"] = lambda: encode_cloud(range_map.measured_m, rays, correction.image)
    contents["corrected"] = lambda: encode_image(pixels, config.image_format, exif)
    contents["mask"] = lambda: encode_codes(mask_codes(correction, range_map))
    return _files(contents, partial(product_path, name=name, image_format=config.image_format))


def original_files(left: Path, correction: Correction, range_map: RangeMap, exif: bytes) -> Files:
    """The files of OUT/original: a corrected frame in the raw pixels and format of ``left``."""
    image_format = FORMAT_OF_SUFFIX[left.suffix.lower()]
    contents: Encoders = {
        "original/corrected": lambda: encode_image(correction.image, image_format, exif),
        "original/range": lambda: encode_map(range_map.range_m),
        "original/mask": lambda: encode_codes(mask_codes(correction, range_map)),
    }
    return _files(contents, partial(original_path, left=left))


def rectified_files(name: str, left: Image, right: Image) -> Files:
    """The rectified images of one pair, OUT/rectified_left and OUT/rectified_right, always PNG."""
    contents: Encoders = {
        "rectified_left": lambda: encode_image(left, "png"),
        "rectified_right": lambda: encode_image(right, "png"),
    }
    return _files(contents, partial(product_path, name=name, image_format="png"))


def _files(contents: Encoders, path_of: Callable[[str], str]) -> Files:
    return {product: (path_of(product), _encoded(encode)) for product, encode in contents.items()}


def _encoded(encode: Callable[[], bytes | memoryview]) -> Iterator[bytes | memoryview]:
    yield encode()


def mask_codes(correction: Correction, range_map: RangeMap) -> NDArray[np.uint8]:
    """Compute the MASK_CODES of a corrected frame: (H, W) uint8."""
    mask = np.zeros(correction.unknown.shape, np.uint8)
    mask[correction.unrecoverable] = MASK_CODES["color not recoverable"]
    mask[range_map.filled] = MASK_CODES["range filled in"]
    mask[correction.unknown] = MASK_CODES["range unknown"]
    return mask
