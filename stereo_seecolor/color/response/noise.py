"""The noise of a camera over brightness, from the smoothest blocks of its images.

Photon noise has a variance that is proportional to the light (Janesick 2007, *Photon Transfer*).
``laws`` describes the effect of a response.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.blocks import in_blocks
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.records import Image, is_monochrome

Array = NDArray[np.float64]
Plane = NDArray[np.float32]
Values = NDArray[np.unsignedinteger]

SECOND_DIFFERENCE = np.array([1, -2, 1], np.float32) / np.sqrt(np.float32(6))
"""Filter along rows and columns: it removes slopes and preserves the variance of white noise."""
WIDE = np.array([1, 0, -2, 0, 1], np.float32) / np.sqrt(np.float32(6))
"""The same over twice the distance: white noise has the same variance, texture more."""
BLOCK_PX = 10
"""100 values: the variance of a block has a standard error of some 20 %."""
BINS = 14
"""Bins of brightness, uniform in its root: many blocks are dark; a curve has two parameters."""
LEAST_BLOCKS = 80
"""Least blocks of a bin; with fewer, none is smooth."""
SMOOTHEST, LEAST_SMOOTHEST = 0.03, 12
"""Fraction of the blocks of a bin that contain only noise, and least number of these."""
BRIGHTEST, DARKEST = 245.0, 3.0
"""Of 255: blocks with brighter values may be clipped, those with darker ones are cut at zero."""
DARK_QUANTILE = 1e-4
"""Quantile of the values above 0 of a channel: at or above the pedestal."""
NATIVE = 1.6
"""Least ratio of the noise at pixels measured in a color to that at interpolated ones, in
demosaiced images; means of two to four have half to a quarter of the variance.
"""


@dataclass(frozen=True, eq=False)
class NoiseCurve:
    """Noise of one channel over brightness; values are of 0 to 255 also for 16 bits.

    Attributes:
        mean: (K,) brightness.
        variance: (K,) of the noise.
        whiteness: Median ratio of the noise over two pixels to that over one: about 0.7 to 2 for
        the noise of a sensor, more after denoising and compression, or if all blocks have texture.
        darkest: The least of the images' darkest values.
        quantization: Variance that rounding adds.
    """

    mean: Array
    variance: Array
    whiteness: float
    darkest: float
    quantization: float


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of one channel of an image. mean, variance, wide_variance: (N,). darkest: value."""

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    wide_variance: NDArray[np.float32]
    darkest: float


def blocks_of(plane: Values, factor: np.float32) -> Blocks:
    """The blocks of a channel (H, W) that are neither clipped nor cut at zero, with values of 0 to
    255, from the pixels at which the sensor measured it. factor: 255 by the largest value.
    """
    sites = _native_sites(plane.astype(np.float32) * factor)
    mean, values = _means(sites), in_blocks(sites, BLOCK_PX)
    # one axis after the other is eight times as fast as both at once
    most, least = values.max(axis=1).max(axis=2), values.min(axis=1).min(axis=2)
    good = (most < BRIGHTEST) & (least > 0) & (mean > DARKEST)
    return Blocks(
        mean[good],
        _variances(sites, SECOND_DIFFERENCE)[good],
        _variances(sites, WIDE)[good],
        float(factor * dark_value(plane)),
    )


def dark_value(plane: Values) -> int:
    """The darkest of (H, W) unsigned integers, but for a few pixels and black borders."""
    counts = np.bincount(plane.ravel())
    counts[0] = 0
    number = np.cumsum(counts)
    if not number[-1]:
        return 0
    return int(np.searchsorted(number, int(DARK_QUANTILE * number[-1]), "right"))


def _native_sites(plane: Plane) -> Plane:
    """Every second row and column, where a color filter array let the channel be seen; the whole
    plane where all sites have the same noise, or are less than a block.
    """
    if min(plane.shape) < 2 * BLOCK_PX:
        return plane
    phases = [np.ascontiguousarray(plane[row::2, column::2]) for row in (0, 1) for column in (0, 1)]
    noise = [_least_noise(phase) for phase in phases]
    if not min(noise) > 0 or max(noise) < NATIVE * min(noise):
        return plane
    return phases[int(np.argmax(noise))]


def _least_noise(plane: Plane) -> float:
    mean, noise = _means(plane), _variances(plane, SECOND_DIFFERENCE)
    good = (mean > DARKEST) & (mean < BRIGHTEST)
    return float(np.quantile(noise[good], 0.05)) if good.any() else 0.0


def _variances(plane: Plane, kernel: NDArray[np.float32]) -> Plane:
    """Of each block of a filtered plane, whose means are near 0."""
    filtered = cv2.sepFilter2D(plane, cv2.CV_32F, kernel, kernel)
    return np.asarray(_means(filtered**2) - _means(filtered) ** 2)


def _means(plane: Plane) -> Plane:
    """Of each block; images of less than a block have none."""
    blocks = in_blocks(plane, BLOCK_PX)
    rows, _, columns, _ = blocks.shape
    if not blocks.size:
        return np.zeros((rows, columns), np.float32)
    cut = blocks.reshape(rows * BLOCK_PX, -1)
    return np.asarray(cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA))


def noise_curve(images: Sequence[Blocks], quantization: float) -> NoiseCurve | None:
    """Compute the curve of the blocks of one channel of several images; None if there are too few.

    The smoothest blocks of a bin are chosen by their noise over two pixels, so that the choice
    does not lower the noise that is measured.
    """
    joined = [
        np.concatenate([getattr(one, name) for one in images]).astype(np.float64)
        for name in ("mean", "variance", "wide_variance")
    ]
    mean, variance, wide = joined
    if mean.size < LEAST_BLOCKS:
        return None
    darkest, brightest = (float(np.quantile(mean, part)) ** 0.5 for part in (0.005, 0.995))
    place = np.digitize(mean, np.linspace(darkest, brightest, BINS + 1) ** 2) - 1
    rows = list(_rows(place, mean, variance, wide))
    if not rows:
        return None
    of_mean, of_variance, of_wide = np.array(rows).T
    known = of_variance > 0
    whiteness = float(np.median(of_wide[known] / of_variance[known])) if known.any() else np.inf
    least = min(one.darkest for one in images)
    return NoiseCurve(of_mean, of_variance, whiteness, least, quantization)


def _rows(
    place: NDArray[np.int64], mean: Array, variance: Array, wide: Array
) -> Iterable[tuple[float, float, float]]:
    for number in range(BINS):
        inside = np.flatnonzero(place == number)
        if inside.size >= LEAST_BLOCKS:
            most = max(int(SMOOTHEST * inside.size), LEAST_SMOOTHEST)
            smooth = inside[np.argsort(wide[inside])[:most]]
            yield (
                float(mean[smooth].mean()),
                float(np.median(variance[smooth])),
                float(np.median(wide[smooth])),
            )


def blocks_by_channel(images: Sequence[Image]) -> list[list[Blocks]]:
    """Compute the blocks of each image, by channel; of one channel if all images are monochrome."""
    number = 1 if all(is_monochrome(image) for image in images) else 3

    def of_channels(image: Image) -> list[Blocks]:
        factor = np.float32(255 / np.iinfo(image.dtype).max)
        return [blocks_of(image[..., channel], factor) for channel in range(number)]

    of_images = list(Threads(cores()).each(of_channels, images))
    return [[blocks[channel] for blocks in of_images] for channel in range(number)]


def quantization_of(images: Sequence[Image]) -> float:
    """Return the variance that rounding to 8 bits adds."""
    return 1 / 12 if images and images[0].dtype == np.uint8 else 0.0
