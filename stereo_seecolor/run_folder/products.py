"""The files of one pair: its range map, and its frame in true colors with the cloud."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.config import OutputConfig
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.encode import encode_confidence, encode_image, encode_map, encode_mask
from stereo_seecolor.files.ply import encode_cloud
from stereo_seecolor.records import Correction, RangeMap
from stereo_seecolor.run_folder.folder import RunFolder

MASK_CODES = {"good": 0, "range unknown": 1, "range filled in": 2, "color beyond recovery": 3}


def range_outputs(folder: RunFolder, name: str, config: OutputConfig) -> list[Path]:
    """What write_range writes."""
    return [folder.range(name), folder.confidence(name), *([folder.range_std(name)] if config.range_std else [])]


def write_range(folder: RunFolder, name: str, range_map: RangeMap, config: OutputConfig) -> None:
    """Write OUT/range, OUT/confidence and, if wanted, OUT/range_std of one pair."""
    write_atomic(folder.range(name), encode_map(range_map.range_m))
    write_atomic(folder.confidence(name), encode_confidence(range_map.confidence))
    if config.range_std:
        write_atomic(folder.range_std(name), encode_map(range_map.range_std_m))


def correction_outputs(folder: RunFolder, name: str, geometry: RectifiedPair | None, config: OutputConfig) -> list[Path]:
    """What write_correction writes."""
    return [folder.corrected(name), folder.mask(name), *([folder.cloud(name)] if config.clouds and geometry else [])]


def write_correction(
    folder: RunFolder,
    name: str,
    correction: Correction,
    range_map: RangeMap,
    geometry: RectifiedPair | None,
    config: OutputConfig,
) -> None:
    """Write OUT/corrected, OUT/mask and, if wanted and the camera is known, OUT/clouds of one pair."""
    pixels = correction.image if correction.linear is None else correction.linear
    write_atomic(folder.corrected(name), encode_image(pixels, config.image_format))
    write_atomic(folder.mask(name), encode_mask(_mask(correction, range_map)))
    if config.clouds and geometry is not None:
        write_atomic(folder.cloud(name), encode_cloud(range_map.measured_m, geometry.rays, correction.image))


def _mask(correction: Correction, range_map: RangeMap) -> NDArray[np.uint8]:
    mask = np.zeros(correction.unknown.shape, np.uint8)
    mask[correction.unrecoverable] = MASK_CODES["color beyond recovery"]
    mask[range_map.filled] = MASK_CODES["range filled in"]
    mask[correction.unknown] = MASK_CODES["range unknown"]
    return mask
