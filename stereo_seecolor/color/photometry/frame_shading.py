"""The shading of every frame: shadows and sunlight that move over the reef, as a smooth pattern for
each frame.

    log I(frame, u, v) - log I(other, u', v') = S(frame; u, v) - S(other; u', v') + difference of
        their gains

Waves and floating objects cause light and shadow as wide as an image, at another place on the reef
in the next frame. For two frames that show the same patches, medians over parts of the image
represent their difference; the shading of all frames follows from these in one banded system, like
gains (``gain_chain``). Views cannot distinguish a shadow that stays in place from the color of the
reef.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_model import SHADING, shading_terms
from stereo_seecolor.color.photometry.light_prior import (
    COLOR,
    LUMINANCE,
    Deviations,
    shading_deviations,
)
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]
Indices = NDArray[np.signedinteger]
AT_ONCE = 50_000
"""Number of differences whose equations are in memory at the same time."""
DENSE = 400
"""Largest number of unknowns of the dense solver: scipy's banded solver takes 0.2 s to load."""
OWN = 1 + SHADING
"""Unknowns of a frame: gain and shading."""


@dataclass(frozen=True)
class ShadingSettings:
    """Parts of images, and their weights."""

    parts: int = 4
    """Parts of an image along each side."""
    least: int = 4
    """Least patches in a part."""
    half: float = 10.0
    """Number of patches with which a part has half of its largest weight."""
    gain: tuple[float, float] = (0.3, 0.03)
    """Prior standard deviation of the gain of a frame, of luminance and of color, as in the chain.
    """
    outlier: float = 1.5
    """Robust standard deviations beyond which a part has less than half its weight (Cauchy)."""
    floor: float = 0.005
    """Least standard deviation of a part, logarithm."""
    rounds: int = 5
    """Rounds with new weights."""


SETTINGS = ShadingSettings()
ACROSS = 127
"""Steps of a position from the middle of an image to its edge."""
PART = np.dtype(
    [
        ("i", "<i4"),
        ("j", "<i4"),
        ("at_i", "i1", 2),
        ("at_j", "i1", 2),
        ("value", "<f2", 4),
        ("patches", "u1"),
    ]
)
"""Part of frame i that frame j < i also shows: logarithm of i over j (luminance, color R, G, B),
and its position in both. 21 bytes: a dive of 100,000 frames has five million of these.
"""
Parts = NDArray[np.void]
"""(D,) of PART."""


def parts_of(pair: tuple[int, int], at: tuple[Array, Array], values: Array) -> Parts:
    """Compute the difference of two frames (``pair``) in each part of the first image: medians over
    patches.

    at: (N, 2) positions of the patches in either image, -1..1. values: (N, 4), as in PART.
    """
    part = np.clip(((at[0] + 1) / 2 * SETTINGS.parts).astype(int), 0, SETTINGS.parts - 1) @ (
        1,
        SETTINGS.parts,
    )
    found = []
    for number in np.unique(part):
        inside = part == number
        if inside.sum() >= SETTINGS.least:
            steps = (np.rint(ACROSS * place[inside].mean(axis=0)) for place in at)
            found.append((*pair, *steps, np.median(values[inside], axis=0), min(inside.sum(), 255)))
    return np.array(found, PART)


def solve_shading(parts: Parts, frames: int, used: tuple[bool, bool]) -> Array:
    """Solve (frames, SHADING, 3) coefficients, 0 = unknown. used: whether luminance and color have
    shading.
    """
    solved = np.zeros((frames, SHADING, 3))
    if len(parts) and used[0]:
        solved += _solved(parts, 0, frames, SETTINGS.gain[0], LUMINANCE)[..., None]
    if len(parts) and used[1]:
        solved += np.stack(
            [_solved(parts, channel, frames, SETTINGS.gain[1], COLOR) for channel in (1, 2, 3)],
            axis=2,
        )
    return solved


def without_shading(
    differences: NDArray[np.void], parts: Parts, shading: Array
) -> NDArray[np.void]:
    """Subtract the (F, SHADING, 3) shading from the differences (DIFFERENCE) of whole frames."""
    if not len(parts):
        return differences
    frames, left = len(shading), differences.copy()
    pairs, part = np.unique(parts["i"].astype(np.int64) * frames + parts["j"], return_inverse=True)
    pair = differences["i"].astype(np.int64) * frames + differences["j"]
    at = np.minimum(np.searchsorted(pairs, pair), len(pairs) - 1)
    patches = parts["patches"].astype(np.float64)
    luminance = shading.mean(axis=2, keepdims=True)
    for output, own in enumerate(
        np.moveaxis(np.concatenate([luminance, shading - luminance], axis=2), 2, 0)
    ):
        said = _explained(parts, np.pad(own, ((0, 0), (1, 0))))
        mean = np.bincount(part, patches * said) / np.bincount(part, patches)
        for medians in ("whole", "fitted", "judged"):
            left[medians][:, output] -= np.where(pairs[at] == pair, mean[at], 0.0)
    return left


def _solved(parts: Parts, output: int, frames: int, gain: float, about: Deviations) -> Array:
    """(frames, SHADING) coefficients of luminance (output 0) or a color. gain: prior deviation."""
    value, patches = (parts[name].astype(np.float64) for name in ("value", "patches"))
    prior, own = np.array([gain, *shading_deviations(about)]) ** -2.0, np.zeros((frames, OWN))
    least = patches / (patches + SETTINGS.half)

    def terms(some: slice) -> tuple[Array, Array]:
        return _terms(parts["at_i"][some]), _terms(parts["at_j"][some])

    for _ in range(SETTINGS.rounds):
        off = value[:, output] - _explained(parts, own)
        scale = max(deviation_about_zero(off), SETTINGS.floor)
        weight = least / (scale**2 + (off / SETTINGS.outlier) ** 2)
        own = solve_frames((parts["i"], parts["j"]), value[:, output], weight, prior, frames, terms)
    return own[:, 1:]


def _explained(parts: Parts, own: Array) -> Array:
    """(D,) the differences of the parts by the frames' gains and shadings, ``own`` (F, OWN)."""
    i, j = (np.einsum("dk,dk->d", _terms(parts[f"at_{end}"]), own[parts[end]]) for end in "ij")
    return np.asarray(i - j)


def _terms(at: NDArray[np.int8]) -> Array:
    """(D, OWN) terms of gain and shading at (D, 2) places, in steps of 1 / ACROSS."""
    return np.concatenate([np.ones((len(at), 1)), shading_terms(at / ACROSS)], axis=1)


def solve_frames(
    pair: tuple[Indices, Indices],
    value: Array,
    weight: Array,
    prior: Array,
    frames: int,
    terms: Callable[[slice], tuple[Array, Array]],
) -> Array:
    """Solve (frames, K) unknowns of frames from weighted differences between them: least squares
    with a prior mean of 0.

    pair: (D,) frames i > j. value, weight: (D,). prior: (K,) precisions. terms: (d, K) of i and of
    j, for a slice of the differences.
    """
    reach, own = int((pair[0] - pair[1]).max()) + 1, len(prior)
    blocks, slope = np.zeros((reach, frames, own, own)), np.zeros((frames, own))
    blocks[0] += np.diag(prior)
    for start in range(0, len(value), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        (i, j), w, both = (of[some] for of in pair), weight[some, None], terms(some)
        for frame, of_frame, sign in ((i, both[0], 1), (j, both[1], -1)):
            np.add.at(blocks[0], frame, np.einsum("dp,dq->dpq", w * of_frame, of_frame))
            np.add.at(slope, frame, sign * w * of_frame * value[some, None])
        np.add.at(blocks, (i - j, j), -np.einsum("dp,dq->dpq", w * both[0], both[1]))
    band = np.zeros((reach * own, frames * own), order="F")
    for back in range(reach):
        for p in range(own):
            for q in range(own if back else p + 1):
                band[back * own + p - q, q::own] = blocks[back, :, p, q]
    return _solve_banded(band, slope.ravel()).reshape(frames, own)


def _solve_banded(band: Array, slope: Array) -> Array:
    """(N,) solution of a positive definite system of diagonals (reach, N), both overwritten."""
    size = len(slope)
    if size > DENSE:
        from scipy.linalg import solveh_banded

        return np.asarray(solveh_banded(band, slope, True, True, lower=True))
    lower = np.zeros((size, size))
    for back, diagonal in enumerate(band[:size]):
        lower[np.arange(back, size), np.arange(size - back)] = diagonal[: size - back]
    return np.asarray(np.linalg.solve(lower + np.tril(lower, -1).T, slope), np.float64)
