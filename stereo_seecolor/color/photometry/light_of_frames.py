"""Gain and shading of every frame of a dive, from the differences of neighboring frames that show
the same patches.

    log I(frame, u, v) - log I(other, u', v') = gain(frame) + shading(frame; u, v) - gain(other) -
        shading(other; u', v')

Pattern and trend with range have been solved before. Medians over the patches in parts of the
image represent the difference of two frames; all gains and shadings follow in one banded system. An
error of the slopes of the pattern looks like a drift of gains along a line, so the slopes are
solved again. The mean light of the reef is the same in each frame, with a large error: this
decides between slope and drift, and bounds the drift of long chains.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.robust_statistics import deviation_about_zero
from stereo_seecolor.color.photometry.light_model import SHADING, places, shading_terms
from stereo_seecolor.color.photometry.light_prior import COLOR, LUMINANCE, shading_deviations
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.color.photometry.survey_light import SurveyLight, usable

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
    """Least patches that both frames show, in each half: fewer follow single caustics."""
    least: int = 4
    """Least patches in a part."""
    half: float = 10.0
    """Number of patches with which a part has half of its largest weight."""
    gain: tuple[float, float] = (3.0, 0.05)
    """Prior deviation of a frame's log gain, luminance and color: an exposure may stay changed."""
    reef: tuple[float, float] = (2.0, 0.05)
    """Standard error of the mean light of the reef in a frame, luminance and color, logarithm. On
    synthetic dives they vary by 0.25 and 0.05; 60 neighbors count as one frame in luminance,
    because a reef may become darker for good. For color 0.1 and 0.2 are worse.
    """
    outlier: float = 1.5
    """Robust standard deviations at which a part has half its weight (Cauchy): a wrong pose."""
    floor: float = 0.005
    """Least standard deviation of a part, logarithm."""
    rounds: int = 5
    """Rounds with new weights."""
    offset: float = 0.03
    """Least offsets between frames (rms, logarithm) for which each frame gets a gain,"""
    left: float = 0.8
    """if at most this fraction of them remains on patches left out of the fit."""


SETTINGS = FramesSettings()
_OUTPUTS = (0,), (1, 2, 3)
"""Luminance, and color."""
_LEAST = 1e-6
"""Standard deviation of what is known, and one over that of what is not: the mean of the reef."""
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
median over its patches, its position in both, and whether its patches are left out of the fit. 22
bytes: a dive of 100,000 frames has five million of these.
"""
Parts = NDArray[np.void]
"""(D,) of PART, those of two frames one after the other."""
MEAN = np.dtype([("frame", "<i4"), ("light", "<f4", 4)])
"""Mean log light over a frame's patches without pattern and trend (luminance, color R, G, B)."""


class Differences(NamedTuple):
    """parts: differences between frames. means: (F,) of MEAN."""

    parts: Parts
    means: NDArray[np.void]

    @classmethod
    def joined(cls, several: "Iterable[Differences]") -> "Differences":
        """Join the differences, as bytes: a dive has millions."""
        parts, means = bytearray(), bytearray()
        for one in several:
            parts += one.parts.tobytes()
            means += one.means.tobytes()
        return cls(np.frombuffer(parts, PART), np.frombuffer(means, MEAN))


@dataclass(frozen=True, eq=False)
class LightOfFrames:
    """gains: (F, 3) logarithms, 0 where they do not help. shading: (F, SHADING, 3) coefficients,
    or (F, 0, 3). slopes: (2, 3) to add to the first coefficients of the pattern.
    measured (F,): frames that were compared. offsets: rms of luminance between frames, without and
    with gains and shading, on patches left out.
    """

    gains: Array
    shading: Array
    slopes: Array
    measured: NDArray[np.bool_]
    offsets: tuple[float, float]


class _Solution(NamedTuple):
    """own: (4, F, 1 + SHADING) gain and shading of frames. slopes: (4, 2) of the pattern."""

    own: Array
    slopes: Array


def differences(window: Observations, light: SurveyLight, size: tuple[int, int]) -> Differences:
    """Compute differences of the first frame of a window to each other one, and its mean, with
    pattern and trend removed.

    size: (width, height) of the images of the observations.
    """
    seen = window.part(usable(window))
    left = np.log(seen.light) - light.at(seen.pixel, seen.range_m, size)
    luminance = left.mean(axis=1, keepdims=True)
    values, at = np.concatenate([luminance, left - luminance], axis=1), places(seen.pixel, size)
    along = SETTINGS.parts if light.luminance.use.shading else 1
    first, found = np.flatnonzero(seen.frame == 0), []
    for other in range(1, len(window.frames)):
        a, b = seen.of_both(0, other)
        held = (seen.patch[a] // 2) % 2 == 1
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
    means = [(window.frames[0], values[first].mean(axis=0))] if len(first) else []
    return Differences(np.array(found, PART), np.array(means, MEAN))


def solve_frames(
    differing: Differences,
    known: Array,
    shading: tuple[bool, bool],
    errors: tuple[float, float] = (0.0, 0.0),
    chosen: tuple[bool | None, bool | None] = (None, None),
) -> LightOfFrames:
    """Solve gains and shading of all frames. They are not used where they enlarge the differences
    of patches left out.

    known: (F,) logarithms of gains, the prior mean; a frame without overlap gets its own. shading:
    whether luminance and color have shading. errors: standard errors of the pattern of luminance
    and color. chosen: whether gains of luminance and of color are used; None = if they help.
    """
    parts = differing.parts
    measured = np.zeros(len(known), np.bool_)
    measured[parts["i"]] = measured[parts["j"]] = True
    fit, held = (differing._replace(parts=parts[parts["held"] == half]) for half in (False, True))
    found = _Solution(np.zeros((4, len(known), 1 + SHADING * any(shading))), np.zeros((4, 2)))
    raw = _offset(held.parts, found, _OUTPUTS[0])
    found.own[0, :, 0] = known
    offsets = raw, _offset(held.parts, found, _OUTPUTS[0])
    for color, use in enumerate(chosen):
        how = color, shading[color], errors[color]
        before = _offset(held.parts, found, _OUTPUTS[color])
        after = _offset(held.parts, _solved(fit, found, *how), _OUTPUTS[color])
        helps = before > SETTINGS.offset and after < SETTINGS.left * before
        if (helps if use is None else use) and after <= before:
            found = _solved(differing, found, *how)
            offsets = offsets if color else (raw, after)
    own, slopes = (np.moveaxis(of[:1] + of[1:], 0, -1) for of in found)
    return LightOfFrames(own[:, 0], own[:, 1:], slopes, measured | (known != 0), offsets)


def offset_between(parts: Parts, known: Array) -> float:
    """The rms of luminance between frames on patches left out, with (F,) known gains subtracted."""
    found = _Solution(known[None, :, None], np.zeros((1, 2)))
    return _offset(parts[parts["held"]], found, _OUTPUTS[0])


def _offset(parts: Parts, found: _Solution, outputs: Iterable[int]) -> float:
    """rms over pairs of frames of the mean difference of their parts, the solution subtracted."""
    if not len(parts):
        return 0.0
    first = np.flatnonzero(np.any([np.diff(parts[end], prepend=-1) for end in "ij"], axis=0))
    patches = parts["patches"].astype(np.float64)
    number, squares = np.add.reduceat(patches, first), []
    for output in outputs:
        off = parts["value"][:, output] - _explained(parts, found.own[output], found.slopes[output])
        squares.append((np.add.reduceat(patches * off, first) / number) ** 2)
    return float(np.sqrt(np.average(np.mean(squares, axis=0), weights=number)))


def _solved(
    differing: Differences, found: _Solution, color: int, shaded: bool, error: float
) -> _Solution:
    """The solution with luminance (0) or color (1) solved about it. error: of the pattern."""
    parts, means = differing
    own, slopes = found.own.copy(), found.slopes.copy()
    about = shading_deviations((LUMINANCE, COLOR)[color])
    prior = np.array([SETTINGS.gain[color], *about])[: 1 + SHADING * shaded] ** -2.0
    shared = np.array([max(error, _LEAST), max(error, _LEAST), 1 / _LEAST]) ** -2.0
    patches = parts["patches"].astype(np.float64)
    least = patches / (patches + SETTINGS.half)
    for output in _OUTPUTS[color] if len(parts) else ():
        value = parts["value"][:, output] - _explained(parts, own[output], slopes[output])
        mean = means["light"][:, output] - own[output, means["frame"], 0]
        weight = least / SETTINGS.floor**2
        for _ in range(SETTINGS.rounds):
            system = _System.of(parts, value, weight, prior, own.shape[1])
            system.add_means(means["frame"], mean, SETTINGS.reef[color] ** -2.0)
            frames, whole = system.solved(shared)
            off = value - _explained(parts, frames, whole[:2])
            scale = max(deviation_about_zero(off), SETTINGS.floor)
            weight = least / (scale**2 + (off / SETTINGS.outlier) ** 2)
        frames[:, 0] -= frames[:, 0].mean()
        own[output, :, : len(prior)] += frames
        slopes[output] += whole[:2]
    return _Solution(own, slopes)


def _explained(parts: Parts, own: Array, slopes: Array) -> Array:
    """(D,) the differences of the parts by ``own`` (F, K) of frames and (2,) slopes."""
    i, j = (
        np.einsum("dk,dk->d", _terms(parts[f"at_{end}"], own.shape[1]), own[parts[end]])
        for end in "ij"
    )
    return np.asarray(i - j + _moved(parts) @ slopes)


def _moved(parts: Parts) -> Array:
    """(D, 2) the terms of the slopes: places in i less those in j."""
    return np.asarray((parts["at_i"].astype(np.float64) - parts["at_j"]) / ACROSS)


def _terms(at: NDArray[np.int8], number: int) -> Array:
    """(D, number) terms of gain and shading at (D, 2) places, in steps of 1 / ACROSS."""
    ones = np.ones((len(at), 1))
    return ones if number == 1 else np.concatenate([ones, shading_terms(at / ACROSS)], axis=1)


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations of K unknowns of each frame, and of what all frames share: two slopes and
    the mean of the reef.

    blocks (reach, F, K, K): of frame j + back with frame j, by back. border (F, K, 4): of frames
    with what they share; last, the right side. corner (3, 4): of what they share.
    """

    blocks: Array
    border: Array
    corner: Array

    @classmethod
    def of(cls, parts: Parts, value: Array, weight: Array, prior: Array, frames: int) -> "_System":
        """The equations of the (D,) values of the parts. prior: (K,) precisions about 0."""
        reach, own = int((parts["i"] - parts["j"]).max()) + 1, len(prior)
        blocks, border = np.zeros((reach, frames, own, own)), np.zeros((frames, own, 4))
        corner = np.zeros((3, 4))
        blocks[0] += np.diag(prior)
        for start in range(0, len(value), AT_ONCE):
            some = parts[start : start + AT_ONCE]
            w, ends = weight[start : start + AT_ONCE, None], [some[end] for end in "ij"]
            both = [_terms(some[f"at_{end}"], own) for end in "ij"]
            shared = np.zeros((len(some), 4))
            shared[:, :2], shared[:, 3] = _moved(some), value[start : start + AT_ONCE]
            for frame, of_frame, sign in zip(ends, both, (1, -1), strict=True):
                np.add.at(blocks[0], frame, np.einsum("dp,dq->dpq", w * of_frame, of_frame))
                np.add.at(border, frame, sign * np.einsum("dp,dq->dpq", w * of_frame, shared))
            products = np.einsum("dp,dq->dpq", w * both[0], both[1])
            np.add.at(blocks, (ends[0] - ends[1], ends[1]), -products)
            corner += (w * shared[:, :3]).T @ shared
        return cls(blocks, border, corner)

    def add_means(self, frame: NDArray[np.signedinteger], mean: Array, precision: float) -> None:
        """Add the mean light of some frames: gain and mean of the reef."""
        self.blocks[0, frame, 0, 0] += precision
        self.border[frame, 0, 2] += precision
        self.border[frame, 0, 3] += precision * mean
        self.corner[2, 2:] += precision * np.array([len(mean), mean.sum()])

    def solved(self, prior: Array) -> tuple[Array, Array]:
        """Solve (F, K) unknowns of frames, and (3,) shared ones of precisions ``prior`` about 0."""
        reach, frames, own, _ = self.blocks.shape
        band = np.zeros((reach * own, frames * own), order="F")
        for back in range(reach):
            for p in range(own):
                for q in range(own if back else p + 1):
                    band[back * own + p - q, q::own] = self.blocks[back, :, p, q]
        border = self.border.reshape(-1, 4)
        inner = _solve_banded(band, border)
        left = self.corner - border[:, :3].T @ inner
        whole = np.asarray(np.linalg.solve(left[:, :3] + np.diag(prior), left[:, 3]), np.float64)
        each = np.asarray(inner[:, 3] - inner[:, :3] @ whole, np.float64)
        return each.reshape(frames, own), whole


def _solve_banded(band: Array, right: Array) -> Array:
    """(N, Q) solutions of a positive definite system of diagonals (reach, N), overwritten."""
    size = len(right)
    if size > DENSE:
        from scipy.linalg import solveh_banded

        return np.asarray(solveh_banded(band, right, True, lower=True))
    lower = np.zeros((size, size))
    for back, diagonal in enumerate(band[:size]):
        lower[np.arange(back, size), np.arange(size - back)] = diagonal[: size - back]
    return np.asarray(np.linalg.solve(lower + np.tril(lower, -1).T, right), np.float64)
