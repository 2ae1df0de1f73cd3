"""Reading of image files as RGB arrays at the camera's own bit depth."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import Container, contained, open_containers, read_bytes
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.capture import ExposureTable, read_capture
from stereo_seecolor.inputs.decoding import decoded, seam_row, seam_text
from stereo_seecolor.inputs.dive_pairs import Halves, is_half
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.video_file import VideoImages, is_video
from stereo_seecolor.plugins import added, load
from stereo_seecolor.records import Capture, Image, Map, StereoFrame

BAYER_CODES = {
    "rggb": cv2.COLOR_BayerRGGB2RGB,
    "bggr": cv2.COLOR_BayerBGGR2RGB,
    "gbrg": cv2.COLOR_BayerGBRG2RGB,
    "grbg": cv2.COLOR_BayerGRBG2RGB,
}


def read_image(path: str | Path, config: InputConfig | None = None) -> Image:
    """Read a PNG, TIFF, JPEG, BMP, PGM or PPM of 8 or 16 bits as (H, W, 3) RGB; gray is repeated,
    alpha dropped, EXIF applied.

    Raises InputError if the file is missing, truncated, damaged, too large, or holds no 8- or
    16-bit picture.
    """
    path = Path(path)
    return decode_image(read_image_bytes(path), path, config or InputConfig())


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
    if not (array.min() >= 0 and array.max() <= most):  # NaN is neither
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
    """Bring e.g. 12-bit values in a 16-bit file to full scale, so that 1.0 is the sensor's own
    white.
    """
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


# Reading of pairs: two files to one StereoFrame, with what the cameras recorded of them.

RAW_SUFFIX = ".tif"
"""Of what is raw pixels in a bag, or a video's frame: nothing is recorded beside them, so they need
not be read for that.
"""


class FrameReader:
    """Reads pairs, from any thread. Raises InputError for an exposure table that cannot be read.

    settings: hash of the settings and of the table.
    """

    def __init__(self, config: InputConfig) -> None:
        self._config = config
        self._exposures = (
            ExposureTable.read(config.exposures) if config.exposures else ExposureTable({})
        )
        rows = sorted(
            (name, row.exposure_s, row.gain) for name, row in self._exposures.rows.items()
        )
        self.settings = content_key(config.model_dump(), rows)

    def read(self, pair: Pair) -> StereoFrame:
        """Read both images, not rectified. Raises InputError if one cannot be read, or is
        damaged.
        """
        contents = {path: read_image_bytes(path) for path in (pair.left, pair.right)}
        images = [decode_image(content, path, self._config) for path, content in contents.items()]
        _refuse_damage(dict(zip(contents, images, strict=True)), contents)
        captures = [self._captured(path, content) for path, content in contents.items()]
        return StereoFrame(
            pair.name, images[0], images[-1], pair.timestamp_s, captures[0], captures[-1]
        )

    def capture(self, path: Path) -> Capture:
        """Read what the camera recorded beside the pixels of one image. Raises InputError if it
        cannot be read.
        """
        is_raw = path.suffix == RAW_SUFFIX and contained(path)
        return self._captured(path, b"" if is_raw else read_image_bytes(path))

    def _captured(self, path: Path, content: bytes) -> Capture:
        return self._exposures.applied(read_capture(content), path)


def _refuse_damage(images: dict[Path, Image], contents: dict[Path, bytes]) -> None:
    """Raise InputError where one image of a pair begins anew at a row, and the other at none: a
    line of text, say, is in both.
    """
    rows = {path: seam_row(image, contents[path]) for path, image in images.items()}
    found = [path for path, row in rows.items() if row is not None]
    if len(found) == 1:
        raise InputError(f"{found[0]}: {seam_text(rows[found[0]] or 0)}")


# Paths that lead into a video, a bag, or an image of both sides: these are opened by the path
# alone, in any process.


def open_around(path: Path) -> None:
    """Open the video, bag or image that ``path`` leads into, if it leads into one. Raises
    InputError, DeviceError.
    """
    if contained(path):
        return
    if is_half(path):
        image = path.parent.parent
        open_containers({image: Halves(image)})
        return
    outer = next(
        (
            parent
            for parent in path.parents
            if is_video(parent) or _kind(parent) in added("containers")
        ),
        None,
    )
    if outer and outer.is_file():
        open_containers({outer: _container(outer)})


def _container(outer: Path) -> Container:
    if is_video(outer):
        return VideoImages(outer)
    container: Container = load("containers", _kind(outer), needs=("__call__",))(outer)
    return container


def _kind(path: Path) -> str:
    return path.suffix.lower().removeprefix(".")
