"""Gain and shading of every frame of a dive, from the differences of neighboring frames that show
the same patches.

    log I(frame, u, v) - log I(other, u', v') = gain(frame) + shading(frame; u, v) - gain(other) -
        shading(other; u', v')

Pattern and trend with range have been solved before (in a long dive from a part of the frames).
Medians over the patches in parts of the image represent the difference of two frames; the gains and
shadings of all frames follow from these in one banded system. Shading is sunlight and shadows as
wide as an image, at another place on the reef in the next frame: views cannot distinguish a shadow
that stays in place from the color of the reef.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_model import SHADING, places, shading_terms
from stereo_seecolor.color.photometry.light_prior import COLOR, LUMINANCE, shading_deviations
from stereo_seecolor.color.photometry.observations import SeenWindow
from stereo_seecolor.color.photometry.survey_light import SurveyLight, usable
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]
AT_ONCE = 50_000
"""Number of parts whose equations are in memory at the same time."""
DENSE = 400
"""Largest number of unknowns of the dense solver: scipy's banded solver takes 0.2 s to load."""


@dataclass(frozen=True)
class FramesSettings:
    """Parts of images, their weights, and conditions for gains."""

    parts: int = 3
    """Parts of an image along each side, where frames have shading; else the image is one part."""
    least_patches: int = 20
    """Least patches that both frames show, in each half: the median of fewer follows single
    caustics.
    """
    least: int = 4
    """Least patches in a part."""
    half: float = 10.0
    """Number of patches with which a part has half of its largest weight."""
    gain: tuple[float, float] = (0.3, 0.03)
    """Prior standard deviation of the gain of a frame, luminance and color, logarithm."""
    outlier: float = 1.5
    """Robust standard deviations beyond which a part has less than half its weight (Cauchy): a
    wrong pose.
    """
    floor: tuple[float, float] = (0.05, 0.01)
    """Least standard deviation of luminance and of color of a whole image, logarithm: the error of
    pattern and trend that all patches share.
    """
    floor_parts: float = 0.005
    """The same of a part of an image."""
    rounds: int = 5
    """Rounds with new weights."""
    offset: float = 0.03
    """Least offsets between frames (rms, logarithm) for which each frame gets a gain,"""
    left: float = 0.8
    """if at most this fraction of them remains on patches left out of the fit."""


SETTINGS = FramesSettings()
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
        ("held", "?"),
    ]
)
"""Part of frame i that frame j < i also shows: logarithm of i over j (luminance, color R, G, B),
median over its patches, its position in both, and whether its patches are left out of the fit, to
test it. 22 bytes: a dive of 100,000 frames has five million of these.
"""
Parts = NDArray[np.void]
"""(D,) of PART, those of two frames one after the other."""
Chosen = tuple[bool | None, bool | None]
"""Whether gains of luminance and of color are used; None = if they help."""


@dataclass(frozen=True, eq=False)
class LightOfFrames:
    """gains: (F, 3) logarithms, 0 where they do not help. shading: (F, SHADING, 3) coefficients,
    or (F, 0, 3).
    measured (F,): frames that were compared. offsets: rms of luminance between frames, without and
    with gains and shading, on patches left out.
    """

    gains: Array
    shading: Array
    measured: NDArray[np.bool_]
    offsets: tuple[float, float]


def differences(window: SeenWindow, light: SurveyLight, size: tuple[int, int]) -> Parts:
    """Compute differences of the first frame of a window to each other one, with pattern and trend
    removed.

    size: (width, height) of the images of the observations.
    """
    seen, good = window.seen, usable(window.seen)
    patch, frame, pixel = seen.patch[good], seen.frame[good], seen.pixel[good]
    left = np.log(seen.light[good]) - light.at(pixel, seen.range_m[good], size)
    luminance = left.mean(axis=1, keepdims=True)
    values, at = np.concatenate([luminance, left - luminance], axis=1), places(pixel, size)
    along = SETTINGS.parts if light.luminance.use.shading else 1
    first, found = np.flatnonzero(frame == 0), []
    for other in range(1, len(window.frames)):
        there = np.flatnonzero(frame == other)
        common, a, b = np.intersect1d(
            patch[first], patch[there], assume_unique=True, return_indices=True
        )
        a, b, held = first[a], there[b], (common // 2) % 2 == 1
        if min(held.sum(), (~held).sum()) < SETTINGS.least_patches:
            continue
        cell = np.clip(((at[a] + 1) / 2 * along).astype(int), 0, along - 1) @ (2, 2 * along) + held
        for number in np.unique(cell):
            inside = cell == number
            if inside.sum() >= SETTINGS.least:
                where = (np.rint(ACROSS * at[ends][inside].mean(axis=0)) for ends in (a, b))
                value = np.median((values[a] - values[b])[inside], axis=0)
                pair = window.frames[0], window.frames[other]
                found.append((*pair, *where, value, min(inside.sum(), 255), number % 2))
    return np.array(found, PART)


def solve_frames(
    parts: Parts, known: Array, shading: tuple[bool, bool], chosen: Chosen = (None, None)
) -> LightOfFrames:
    """Solve gains and shading of all frames.

    known: (F,) logarithms of gains, the prior mean; a frame without overlap gets its own. shading:
    whether luminance and color have shading.
    """
    measured = np.zeros(len(known), np.bool_)
    measured[parts["i"]] = measured[parts["j"]] = True
    held, own = parts[parts["held"]], np.zeros((4, len(known), 1 + SHADING * any(shading)))
    own[0, :, 0] = known
    raw = _offset(held, np.zeros_like(own), [0])
    offsets = raw, _offset(held, own, [0])
    for outputs, shaded, use in zip(([0], [1, 2, 3]), shading, chosen, strict=True):
        before = _offset(held, own, outputs)
        half = _solved(parts[~parts["held"]], own, outputs, shaded)
        after = _offset(held, half, outputs)
        helps = before > SETTINGS.offset and after < SETTINGS.left * before
        if helps if use is None else use:
            own = _solved(parts, own, outputs, shaded)
            offsets = (raw, after) if 0 in outputs else offsets
    of_channels = np.moveaxis(own[:1] + own[1:], 0, 2)
    return LightOfFrames(of_channels[:, 0], of_channels[:, 1:], measured | (known != 0), offsets)


def offset_between(parts: Parts, known: Array) -> float:
    """Compute the rms of luminance between frames on patches left out, with (F,) known gains
    subtracted.
    """
    return _offset(parts[parts["held"]], known[None, :, None], [0])


def _offset(parts: Parts, own: Array, outputs: Iterable[int]) -> float:
    """rms over pairs of frames of the mean difference of their parts, ``own`` subtracted."""
    if not len(parts):
        return 0.0
    first = np.flatnonzero(np.any([np.diff(parts[end], prepend=-1) for end in "ij"], axis=0))
    patches = parts["patches"].astype(np.float64)
    number, squares = np.add.reduceat(patches, first), []
    for output in outputs:
        off = parts["value"][:, output] - _explained(parts, own[output])
        squares.append((np.add.reduceat(patches * off, first) / number) ** 2)
    return float(np.sqrt(np.average(np.mean(squares, axis=0), weights=number)))


def _solved(parts: Parts, own: Array, outputs: Iterable[int], shaded: bool) -> Array:
    """``own`` (4, F, 1 + SHADING) as prior mean, solved for these outputs."""
    solved = own.copy()
    for output in outputs if len(parts) else ():
        color = min(output, 1)
        prior = np.array([SETTINGS.gain[color], *shading_deviations((LUMINANCE, COLOR)[color])])
        unknowns = prior.size if shaded else 1
        value = parts["value"][:, output] - _explained(parts, own[output])
        floor = SETTINGS.floor_parts if shaded else SETTINGS.floor[color]
        found = _chain(parts, value, prior[:unknowns] ** -2.0, floor, own.shape[1])
        found[:, 0] -= found[:, 0].mean()
        solved[output, :, :unknowns] += found
    return solved


def _chain(parts: Parts, value: Array, prior: Array, floor: float, frames: int) -> Array:
    """(F, K) unknowns of frames about 0 whose differences are the values: Cauchy weights."""
    patches = parts["patches"].astype(np.float64)
    least = patches / (patches + SETTINGS.half)
    weight = least / floor**2
    for _ in range(SETTINGS.rounds):
        own = _least_squares(parts, value, weight, prior, frames)
        off = value - _explained(parts, own)
        scale = max(deviation_about_zero(off), floor)
        weight = least / (scale**2 + (off / SETTINGS.outlier) ** 2)
    return own


def _explained(parts: Parts, own: Array) -> Array:
    """(D,) the differences of the parts by gains and shadings, ``own`` (F, K)."""
    i, j = (
        np.einsum("dk,dk->d", _terms(parts[f"at_{end}"], own.shape[1]), own[parts[end]])
        for end in "ij"
    )
    return np.asarray(i - j)


def _terms(at: NDArray[np.int8], number: int) -> Array:
    """(D, number) terms of gain and shading at (D, 2) places, in steps of 1 / ACROSS."""
    ones = np.ones((len(at), 1))
    return ones if number == 1 else np.concatenate([ones, shading_terms(at / ACROSS)], axis=1)


def _least_squares(parts: Parts, value: Array, weight: Array, prior: Array, frames: int) -> Array:
    """Solve (frames, K) unknowns of frames from weighted differences between them: least squares
    with a prior mean of 0.

    value, weight: (D,). prior: (K,) precisions.
    """
    reach, own = int((parts["i"] - parts["j"]).max()) + 1, len(prior)
    blocks, slope = np.zeros((reach, frames, own, own)), np.zeros((frames, own))
    blocks[0] += np.diag(prior)
    for start in range(0, len(value), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        w, ends = weight[some, None], [parts[end][some] for end in "ij"]
        both = [_terms(parts[f"at_{end}"][some], own) for end in "ij"]
        for frame, of_frame, sign in zip(ends, both, (1, -1), strict=True):
            np.add.at(blocks[0], frame, np.einsum("dp,dq->dpq", w * of_frame, of_frame))
            np.add.at(slope, frame, sign * w * of_frame * value[some, None])
        products = np.einsum("dp,dq->dpq", w * both[0], both[1])
        np.add.at(blocks, (ends[0] - ends[1], ends[1]), -products)
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
