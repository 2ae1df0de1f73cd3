"""The files of one pair: its range map, and its frame in true colours with the cloud."""

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.config import OutputConfig
from stereo_seecolor.data import ColoredCloud, Correction, RangeMap
from stereo_seecolor.outputs.atomic import write_atomic
from stereo_seecolor.outputs.encode import encode_cloud, encode_confidence, encode_image, encode_map, encode_mask
from stereo_seecolor.outputs.run_folder import RunFolder

MASK_CODES = {"good": 0, "range unknown": 1, "range filled in": 2, "color beyond recovery": 3}


def write_range(folder: RunFolder, name: str, range_map: RangeMap, config: OutputConfig) -> None:
    """Write OUT/range, OUT/confidence and, if wanted, OUT/range_std of one pair."""
    write_atomic(folder.range(name), encode_map(range_map.range_m))
    write_atomic(folder.confidence(name), encode_confidence(range_map.confidence))
    if config.range_std:
        write_atomic(folder.range_std(name), encode_map(range_map.range_std_m))


def write_correction(
    folder: RunFolder,
    name: str,
    correction: Correction,
    range_map: RangeMap,
    geometry: RectifiedPair | None,
    config: OutputConfig,
) -> None:
    """Write OUT/corrected, OUT/mask and, if wanted and the camera is known, OUT/clouds of one pair."""
    write_atomic(folder.corrected(name), encode_image(correction.image, config.image_format))
    write_atomic(folder.mask(name), encode_mask(_mask(correction, range_map)))
    if config.clouds and geometry is not None:
        write_atomic(folder.cloud(name), encode_cloud(colored_cloud(correction, range_map, geometry)))


def colored_cloud(correction: Correction, range_map: RangeMap, geometry: RectifiedPair) -> ColoredCloud:
    """The measured points of a frame in its true colours; nothing that was filled in."""
    range_m = range_map.measured_m
    known = np.isfinite(range_m)
    return ColoredCloud(geometry.points_from_range(range_m)[known], _to_8_bit(correction.image)[known])


def _to_8_bit(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    if image.dtype == np.uint16:
        return (image.astype(np.uint16, copy=False) >> 8).astype(np.uint8)
    return np.round(np.clip(image.astype(np.float32), 0, 1) * 255).astype(np.uint8)


def _mask(correction: Correction, range_map: RangeMap) -> NDArray[np.uint8]:
    mask = np.zeros(correction.unknown.shape, np.uint8)
    mask[correction.unrecoverable] = MASK_CODES["color beyond recovery"]
    mask[range_map.filled] = MASK_CODES["range filled in"]
    mask[correction.unknown] = MASK_CODES["range unknown"]
    return mask
