"""The noise of a camera over brightness in JPEGs, from the coefficients that quantization left.

A JPEG quantizes the cosine transform of each block of 8 pixels (ITU T.81). Noise stays where it
exceeds half a step; its variance before quantization follows from that of the coefficients after.
"""

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.blocks import in_blocks
from stereo_seecolor.color.response.noise import BINS, NoiseCurve, dark_value
from stereo_seecolor.records import Image

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

BLOCK_PX = 8
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""Of encoded R, G, B (JFIF, ITU T.871)."""
BANDS = ((8, 11), (6, 8), (5, 7))
"""Frequencies, sums of both directions', at which noise is measured: the highest with noise, where
texture is weakest. Over 4 to 5 texture makes encoded images look linear.
"""
MOST_BLOCKS = 20_000
"""Blocks of an image at most, 5 MB, but for rounding: of larger ones some rows are left out."""
LEAST_BLOCKS = 600
"""Least blocks of a bin,"""
SMOOTHEST, LEAST_SMOOTHEST = 0.01, 24
"""of which this fraction, and least number, with the weakest lower frequencies is noise."""
LEAST_LEFT = 0.08
"""Least fraction of coefficients that quantization left: with fewer, their variance is unknown."""
RANGE, LEAST_BINS = (0.005, 0.98), 6
"""Quantiles of brightness between which bins lie, and their least number: brighter blocks are few,
and have texture.
"""
BRIGHTEST, DARKEST = 250, 3
"""Of 255: blocks with brighter values may be clipped, those that are darker are cut at zero."""
SIGMAS = np.geomspace(0.02, 60, 300)


def jpeg_noise_curve(images: Sequence[Image], steps: bytes) -> NoiseCurve | None:
    """Compute the curve of luminance; None where quantization left too little noise.

    Args:
        images: As decoded, each (H, W, 3) RGB, uint8.
        steps: The 64 steps of luminance, in the order of the file (zigzag).
    """
    blocks = [_blocks(image) for image in images]
    coefficients, means = (np.concatenate([one[k] for one in blocks]) for k in (0, 1))
    if len(means) < LEAST_BLOCKS:
        return None
    step = np.zeros((BLOCK_PX, BLOCK_PX))
    step[_zigzag()] = np.frombuffer(steps, np.uint8)
    darkest = float(min(own for *_, own in blocks))
    for band in BANDS:
        rows = [row for row in _rows(coefficients, means, step, band) if row[2] > LEAST_LEFT]
        if len(rows) >= LEAST_BINS:
            mean, variance, _ = np.array(rows).T
            return NoiseCurve(mean, variance, np.nan, darkest, 0.0)
    return None


def _blocks(image: Image) -> tuple[Floats, Floats, int]:
    """(N, 8, 8) cosine transforms of luminance and (N,) means, of blocks that are not clipped; and
    the darkest value.
    """
    values = in_blocks(image, BLOCK_PX)
    rows, columns = values.shape[::2][:2]
    values = values[:: max(rows * columns // MOST_BLOCKS, 1)]
    blocks = (values @ LUMA).swapaxes(1, 2).reshape(-1, BLOCK_PX, BLOCK_PX)
    most, least = (of(values, axis=(1, 3, 4)).ravel() for of in (np.max, np.min))
    mean = blocks.mean(axis=(1, 2))
    good = (most < BRIGHTEST) & (least > 0) & (mean > DARKEST)
    k = np.arange(BLOCK_PX)
    cosines = np.cos(np.outer(k, 2 * k + 1) * np.pi / (2 * BLOCK_PX)) / 2
    cosines[0] /= np.sqrt(2)
    cosines = cosines.astype(np.float32)
    darkest = dark_value(blocks.astype(np.uint8)) if blocks.size else 0
    return cosines @ blocks[good] @ cosines.T, mean[good], darkest


def _rows(
    coefficients: Floats, means: Floats, step: Array, band: tuple[int, int]
) -> Iterator[tuple[float, float, float]]:
    """Mean, variance in a band, and fraction of coefficients left, of each bin of brightness."""
    frequency = np.add.outer(np.arange(BLOCK_PX), np.arange(BLOCK_PX))
    lower = (frequency > 0) & (frequency < band[0])
    own = (frequency >= band[0]) & (frequency <= band[1])
    darkest, brightest = np.sqrt(np.quantile(means, RANGE))
    place = np.digitize(means, np.linspace(darkest, brightest, BINS + 1) ** 2) - 1
    for number in range(BINS):
        inside = np.flatnonzero(place == number)
        if inside.size < LEAST_BLOCKS:
            continue
        most = max(int(SMOOTHEST * inside.size), LEAST_SMOOTHEST)
        texture = (coefficients[inside][:, lower] ** 2).sum(axis=1)
        smooth = inside[np.argsort(texture)[:most]]
        values, steps = coefficients[smooth][:, own], step[own]
        left = float((np.abs(values) > steps / 2).mean())
        yield float(means[smooth].mean()), _variance(values, steps), left


def _variance(values: Floats, steps: Array) -> float:
    """Of normal noise with (N, K) coefficients after quantization by (K,) steps."""
    expected = sum(step**2 * _after_quantization(SIGMAS / step) for step in steps)
    return float(np.interp((values**2).mean(axis=0).sum(), expected, SIGMAS) ** 2)


def _after_quantization(sigma: Array) -> Array:
    """Second moment of rounded normal noise: the sum of (k^2 - (k - 1)^2) P(|x| > k - 1/2)."""
    from scipy.special import erfc  # not before: most dives need none

    k = np.arange(1, 60)
    rounded = ((2 * k - 1) * erfc((k - 0.5) / (sigma[:, None] * np.sqrt(2)))).sum(axis=1)
    return np.where(sigma > 8, sigma**2 + 1 / 12, rounded)


@cache
def _zigzag() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the 64 steps (ITU T.81, figure A.6)."""
    every = [(row, total - row) for total in range(15) for row in range(8) if 0 <= total - row < 8]
    ordered = sorted(every, key=lambda at: (sum(at), at[0] if sum(at) % 2 else at[1]))
    rows, columns = np.array(ordered).T
    return rows, columns
