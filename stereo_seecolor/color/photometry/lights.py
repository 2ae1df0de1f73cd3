"""The light of the rig itself: its pattern over the picture, learned from the survey, and its fall-off with distance.

    log brightness of a part of the picture in a frame = log pattern of that part + trend(range) + the reef's own

Over many frames the reef's own differs and the pattern stays, so a median finds it. The trend takes out that a tilted camera's
upper part always looks farther: it is fitted within each part, over frames of different altitude and relief, where the pattern
cannot stand in for it. Pattern is vignetting times the lamps' beams; what falls off with distance is divided out as
1 / range^2, which is exact for lamps at the camera, and what the water takes is left in for the water's own fit.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import InputEncoding, decode, decoded_values, encode
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Image, Map

GRID = (24, 32)
"""Rows and columns of parts that a picture is divided into."""
LEAST_FRAMES = 12
LAMP_FALL_OFF = 2.0
LEAST_SPREAD = 0.05
"""Relative spread of the ranges at one place of the picture below which they tell nothing of the trend: they are mostly noise."""
DEGREE = 4
"""Of the polynomial that the logarithm of the pattern is."""
DARK = 1e-4
"""Mean light of a part below which its logarithm means nothing."""


@dataclass(frozen=True, eq=False)
class LightField:
    """pattern: (24, 32) light of each part of the picture against its mean. reference_m: the range whose light is kept.

    fall_off: power of the range by which light falls off: 2 for lamps on the rig, 0 for the sun.
    """

    pattern: NDArray[np.float64]
    reference_m: float
    fall_off: float = LAMP_FALL_OFF

    def light(self, range_m: Map) -> NDArray[np.float32]:
        """(H, W) light of the rig on a frame against the reference; the pattern alone where the range is unknown."""
        height, width = range_m.shape
        pattern = cv2.resize(self.pattern.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
        nearer = np.where(np.isfinite(range_m) & (range_m > 0), np.float32(self.reference_m) / range_m, np.float32(1))
        return np.asarray(np.maximum(pattern, 0.02) * nearer ** np.float32(self.fall_off), dtype=np.float32)


def learn_light(frames: Iterable[tuple[Image, Map]], encoding: InputEncoding, fall_off: float = LAMP_FALL_OFF) -> LightField:
    """The pattern of light over a survey's rectified left images, of one size and depth, with their measured ranges.

    Raises ColorError for fewer than 12 frames: then the reef would pass for light.
    """
    parts = [_parts(image, range_m, encoding) for image, range_m in frames]
    if len(parts) < LEAST_FRAMES:
        raise ColorError(f"only {len(parts)} frames to learn the rig's light from: give at least {LEAST_FRAMES}")
    brightness, log_range = (np.stack(values) for values in zip(*parts, strict=True))
    known = np.isfinite(brightness) & np.isfinite(log_range)
    seen = known.sum(axis=0) >= LEAST_FRAMES // 2
    if not seen.any():
        raise ColorError("no part of the picture has light and a known range in enough frames to learn the rig's light from")
    brightness, log_range = (np.where(known & seen, values, np.nan) for values in (brightness, log_range))
    reference = float(np.nanmedian(log_range))
    brightness = brightness + fall_off * (log_range - reference)  # what light() takes out must not be in the pattern too
    flat = brightness - _trend(brightness, log_range, reference)
    pattern = np.full(GRID, np.nan)
    pattern[seen] = np.nanmedian(flat[:, seen], axis=0)
    smooth = np.exp(_smoothed(pattern))
    return LightField(smooth / smooth.mean(), float(np.exp(reference)), fall_off)


def even_light(image: Image, range_m: Map, field: LightField, encoding: InputEncoding) -> Image:
    """The image as even light would show it, at its own depth; what that would push beyond full scale clips."""
    full = np.iinfo(image.dtype).max
    light = decoded_values(8 * image.dtype.itemsize, encoding)[image] / field.light(range_m)[..., None]
    clipped = np.clip(light, 0.0, 1.0).astype(np.float64)
    shown = encode(clipped, "srgb") if encoding == "srgb" else clipped
    rounded = np.round(shown * full)
    return rounded.astype(np.uint8) if image.dtype == np.uint8 else rounded.astype(np.uint16)


def _parts(image: Image, range_m: Map, encoding: InputEncoding) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Log of the mean light, and of the mean range, of each part of a frame; NaN where dark, or mostly unknown."""
    light = decode(image.mean(axis=2, dtype=np.float64) / np.iinfo(image.dtype).max, encoding)
    known = np.isfinite(range_m)
    size = GRID[::-1]
    share = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    total_m = cv2.resize(np.where(known, range_m, np.float32(0)), size, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(light, size, interpolation=cv2.INTER_AREA)
    good = (share > 0.5) & (mean > DARK)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(good, np.log(mean), np.nan), np.where(good, np.log(total_m / share), np.nan)


def _trend(brightness: NDArray[np.float64], log_range: NDArray[np.float64], reference: float) -> NDArray[np.float64]:
    """Brightness lost to range, a straight line in log range: least absolute deviations of differences within each part.

    The slope is held near zero where the ranges of a part hardly change from frame to frame.
    """
    known = np.isfinite(brightness)
    count = np.maximum(known.sum(axis=0), 1)
    aside = np.where(known, log_range - np.where(known, log_range, 0).sum(axis=0) / count, 0)[known]
    below = np.where(known, brightness - np.where(known, brightness, 0).sum(axis=0) / count, 0)[known]
    slope, weights = 0.0, np.ones(aside.size)
    for _ in range(20):
        slope = float((weights * aside * below).sum() / (weights * (aside**2 + LEAST_SPREAD**2)).sum())
        weights = 1.0 / np.maximum(np.abs(below - slope * aside), 0.02)
    return slope * (log_range - reference)


def _smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The polynomial of degree 4 in both directions nearest to the parts that are known: lamps and lenses are as smooth as that."""
    y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in values.shape), indexing="ij")
    terms = np.stack([x**i * y**j for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], axis=-1)
    known = np.isfinite(values)
    weights: NDArray[np.floating] = np.ones(int(known.sum()))
    coefficients: NDArray[np.floating] = np.zeros(terms.shape[-1])
    for _ in range(10):
        root = np.sqrt(weights)[:, None]
        coefficients = np.linalg.lstsq(root * terms[known], root[:, 0] * values[known], rcond=None)[0]
        weights = 1.0 / np.maximum(np.abs(values[known] - terms[known] @ coefficients), 0.02)
    return np.asarray(terms @ coefficients)
