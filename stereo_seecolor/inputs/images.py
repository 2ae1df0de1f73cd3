"""Reading of image files as RGB arrays at the camera's own bit depth."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.camera_images import decoded
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.inputs.opened_paths import open_around
from stereo_seecolor.records import Image, Map

BAYER_CODES = {
    "rggb": cv2.COLOR_BayerRGGB2RGB,
    "bggr": cv2.COLOR_BayerBGGR2RGB,
    "gbrg": cv2.COLOR_BayerGBRG2RGB,
    "grbg": cv2.COLOR_BayerGRBG2RGB,
}


def read_image(path: str | Path, config: InputConfig | None = None) -> Image:
    """Read a PNG, TIFF, JPEG, BMP, PGM or PPM of 8 or 16 bits as (H, W, 3) RGB; gray is repeated,
    alpha dropped, EXIF applied.

    Raises InputError for a file without an intact image of 8 or 16 bits.
    """
    path = Path(path)
    content = read_image_bytes(path)
    return decode_image(content, path, config or InputConfig())


def as_image(values: Any, what: str) -> Image:
    """An array, or lists of numbers, as (H, W, 3) RGB of 8 or 16 bits.

    Gray is repeated, alpha dropped. Floating point is a fraction of full scale, 0..1, and becomes
    16 bits; other integers become 8 bits where all are below 256, else 16. what: names the image in
    errors. Raises InputError.
    """
    array: Any = np.asarray(values)
    if array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 1):
        array = np.repeat(array.reshape(*array.shape[:2], 1), 3, axis=2)
    if array.ndim != 3 or array.shape[2] not in (3, 4) or not array.size:
        raise InputError(f"{what}: is an array of shape {array.shape}: needs (H, W, 3) RGB")
    array = array[..., :3]
    if array.dtype in (np.uint8, np.uint16):
        same: Image = np.ascontiguousarray(array)
        return same
    if array.dtype.kind not in "iuf":
        raise InputError(f"{what}: holds {array.dtype}: needs numbers, 8 or 16 bits or 0..1")
    most = 1.0 if array.dtype.kind == "f" else 65535
    if array.dtype == np.float16:  # which holds no 65535
        array = array.astype(np.float32)
    if not np.isfinite(array).all():
        raise InputError(f"{what}: contains NaN or infinity: needs numbers for all pixels")
    if array.min() < 0 or array.max() > most:
        raise InputError(
            f"{what}: holds {array.dtype} from {array.min():g} to {array.max():g}: needs 0..1 for "
            "floating point, 0..255 or 0..65535 for integers"
        )
    depth: Any = np.uint8 if array.dtype.kind != "f" and array.max() < 256 else np.uint16
    found: Image = np.rint(65535 * array if array.dtype.kind == "f" else array).astype(depth)
    return found


def read_image_bytes(path: Path) -> bytes:
    """Read a file's content. Raises InputError if it cannot be read or is empty."""
    open_around(path)
    content = read_bytes(path)
    if not content:
        raise InputError(f"{path}: is empty: copy it again from the vehicle, or leave it out")
    return content


def decode_image(content: bytes, path: Path, config: InputConfig) -> Image:
    """Decode a file's content as ``read_image`` does; ``path`` is for the messages."""
    pixels, is_rgb = decoded(content, path, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{path}: holds {pixels.dtype} pixels, an image needs 8 or 16 bits a channel: save it "
            "as a 16-bit PNG or TIFF (values of 0 to 1 times 65535), and for linear light add "
            "--set color.input_encoding=linear"
        )
    if isinstance(config.significant_bits, int):
        pixels = _scale_to_full(pixels, config.significant_bits, path)
    if config.bayer in BAYER_CODES:
        if pixels.ndim != 2:
            raise InputError(
                f"{path}: has {pixels.shape[2]} channels, but input.bayer={config.bayer} needs a "
                "single-channel raw image"
            )
        code = BAYER_CODES[config.bayer]
    elif is_rgb:
        return np.asarray(_ordered(pixels, config), np.uint8)
    else:
        code = cv2.COLOR_GRAY2RGB if pixels.ndim == 2 else cv2.COLOR_BGR2RGB
    return _ordered(cv2.cvtColor(pixels, code), config)


def _ordered(rgb: NDArray[Any], config: InputConfig) -> NDArray[Any]:
    return np.ascontiguousarray(rgb[..., ::-1]) if config.channels == "bgr" else rgb


def read_range_map(path: str | Path, units_per_m: float | None = None) -> Map:
    """Read a range map in meters along the ray, (H, W) float32: TIFF, PNG, PGM, PFM, OpenEXR,
    NumPy's or MATLAB's arrays.

    units_per_m: how many of its units are a meter; None: 1 for floating point, 1000 for integers.
    Zero, negative and non-finite ranges are unknown: NaN. Raises InputError if the file is not such
    a map.
    """
    from stereo_seecolor.inputs.range_maps import decode_range_map

    path = Path(path)
    return decode_range_map(read_image_bytes(path), path, units_per_m)


def _scale_to_full(
    pixels: NDArray[np.generic], significant_bits: int, path: Path
) -> NDArray[np.uint16]:
    """Bring e.g. 12-bit values in a 16-bit file to full scale: 1.0 is the sensor's white."""
    if pixels.dtype != np.uint16:
        raise InputError(
            f"{path}: has 8 bits a channel, but input.significant_bits={significant_bits} needs a "
            "16-bit file"
        )
    top = (1 << significant_bits) - 1
    if int(pixels.max(initial=0)) > top:
        raise InputError(
            f"{path}: holds {int(pixels.max())}, more than "
            f"input.significant_bits={significant_bits} allow ({top}): "
            "set it to the bits that the camera has, or to none"
        )
    return np.round(pixels.astype(np.float32) * (65535 / top)).astype(np.uint16)
