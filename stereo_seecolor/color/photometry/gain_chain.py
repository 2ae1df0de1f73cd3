"""The gain of every frame of a dive, solved from the differences of neighboring frames that show
the same patches.

Pattern and trend with range have been solved before (in a long dive from a part of the frames). So
one difference (of luminance, and of three channels of color) and its number of patches describe two
frames. The gains of all frames follow from a banded system.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.frame_shading import PART, Parts, parts_of, solve_frames
from stereo_seecolor.color.photometry.light_model import places
from stereo_seecolor.color.photometry.observations import SeenWindow
from stereo_seecolor.color.photometry.survey_light import SurveyLight, usable
from stereo_seecolor.robust_statistics import ROBUST_DEVIATION

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChainSettings:
    """Weights of differences between frames, and conditions for gains."""

    least_patches: int = 20
    """Least patches that both frames show, in each half: the median of fewer follows single
    caustics.
    """
    correlated: float = 10.0
    """Number of patches that count as one, as in the solver of the pattern."""
    gain: float = 0.3
    """Prior standard deviation of the gain of a frame, luminance, logarithm. Twice that of the
    joint solution, because a slope of the pattern is already solved and cannot become a drift.
    Fitted to half of the patches of a real dive, 0.15 leaves offsets of 0.082 on the others, 0.3
    and 0.6 leave 0.074.
    """
    color_gain: float = 0.03
    """The same of color: no observation prevents a drift from pink to green along a long chain."""
    floor: tuple[float, float] = (0.05, 0.01)
    """Least standard error of a difference of luminance and of color, logarithm: the error of
    pattern and trend that all patches share.
    """
    outlier: float = 2.0
    """Standard errors beyond which a difference has less than half its weight (Cauchy): a wrong
    pose.
    """
    rounds: int = 5
    """Rounds with new weights."""
    offset: float = 0.03
    """Least offsets between frames (rms, logarithm) for which each frame gets a gain,"""
    left: float = 0.8
    """if at most this fraction of them remains on patches left out of the fit."""


SETTINGS = ChainSettings()
_LUMINANCE, _COLOR = slice(0, 1), slice(1, 4)


DIFFERENCE = np.dtype(
    [("i", "<i4"), ("j", "<i4"), ("patches", "<i4")]
    + [(what, "<f4", 4) for what in ("whole", "fitted", "judged", "spread")]
)
"""Difference between frames i > j: medians of the logarithm of i over j (luminance, color R, G, B)
over patches, and their number.

whole: of all patches. fitted, judged: of the half in the fit, and of the half left out. spread:
robust standard deviation of a single patch. 76 bytes: a dive of a million frames has three million
of these.
"""
Differences = NDArray[np.void]
"""(D,) of DIFFERENCE."""


class DifferenceTable:
    """A growing table of differences, as bytes. whole: of frames. parts: of parts of images."""

    def __init__(self) -> None:
        self._whole, self._parts = bytearray(), bytearray()

    def add(self, whole: Differences, parts: Parts) -> None:
        """Append differences."""
        self._whole += whole.tobytes()
        self._parts += parts.tobytes()

    @property
    def whole(self) -> Differences:
        """Return all differences of frames."""
        return np.frombuffer(self._whole, DIFFERENCE)

    @property
    def parts(self) -> Parts:
        """Return all differences of parts of images."""
        return np.frombuffer(self._parts, PART)


def differences(
    window: SeenWindow, light: SurveyLight, size: tuple[int, int]
) -> tuple[Differences, Parts]:
    """Compute differences of the first frame of a window to each other one, with pattern and trend
    removed.

    size: (width, height) of the images of the observations. Parts are empty unless the light has
    shading.
    """
    good = usable(window.seen)
    seen = window.seen
    patch, frame = seen.patch[good], seen.frame[good]
    left = np.log(seen.light[good]) - light.at(seen.pixel[good], seen.range_m[good], size)
    luminance = left.mean(axis=1, keepdims=True)
    values = np.concatenate([luminance, left - luminance], axis=1)
    at = places(seen.pixel[good], size)
    first, found, parts = np.flatnonzero(frame == 0), [], [np.zeros(0, PART)]
    for other in range(1, len(window.frames)):
        there = np.flatnonzero(frame == other)
        common, a, b = np.intersect1d(
            patch[first], patch[there], assume_unique=True, return_indices=True
        )
        difference = values[first[a]] - values[there[b]]
        held = (common // 2) % 2 == 1
        if min(held.sum(), (~held).sum()) >= SETTINGS.least_patches:
            whole, fitted, judged = (
                np.median(difference[part], axis=0) for part in (held | ~held, ~held, held)
            )
            spread = ROBUST_DEVIATION * np.median(np.abs(difference - whole), axis=0)
            pair = window.frames[0], window.frames[other]
            found.append((*pair, len(common), whole, fitted, judged, spread))
            if light.luminance.use.shading or light.color.use.shading:
                parts.append(parts_of(pair, (at[first[a]], at[there[b]]), difference))
    return np.array(found, DIFFERENCE), np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Chain:
    """gains: (F, 3) logarithms, 0 where they do not help. measured (F,): frames that were compared.
    offsets: rms of luminance between frames, without and with gains, on patches left out.
    """

    gains: Array
    measured: NDArray[np.bool_]
    offsets: tuple[float, float]


Chosen = tuple[bool | None, bool | None]
"""Whether gains of luminance and of color are used; None = if they help."""


def solve_chain(differences: Differences, known: Array, chosen: Chosen = (None, None)) -> Chain:
    """Solve gains of luminance and color. known: (F,) logarithms of gains to subtract first."""
    measured = np.zeros(len(known), np.bool_)
    measured[differences["i"]] = measured[differences["j"]] = True
    halves, outputs = (_outputs(differences, known, part) for part in ("fitted", "whole"))
    luminance, color = (
        _offsets(differences, halves[:, part], known, part) for part in (_LUMINANCE, _COLOR)
    )
    used = [
        _helps(offsets) if use is None else use
        for use, offsets in zip(chosen, (luminance, color), strict=True)
    ]
    gains = outputs[:, _LUMINANCE] * used[0] + outputs[:, _COLOR] * used[1]
    return Chain(gains, measured, luminance)


def offset_between(differences: Differences, known: Array) -> float:
    """Compute the rms of luminance between frames on patches left out, with (F,) known gains
    subtracted.
    """
    return _offsets(differences, np.zeros((len(known), 1)), known, _LUMINANCE)[0]


def _values(differences: Differences, medians: str, output: int, known: Array) -> Array:
    """(D,) medians of luminance (output 0) or of a color, known gains of luminance subtracted."""
    values = differences[medians][:, output].astype(np.float64)
    if output == 0:
        values -= known[differences["i"]]
        values += known[differences["j"]]
    return values


def _offsets(
    differences: Differences, gains: Array, known: Array, part: slice
) -> tuple[float, float]:
    """rms of differences on patches left out of the fit, without and with gains."""
    if not len(differences):
        return 0.0, 0.0
    weights, squares, columns = (
        differences["patches"].astype(np.float64),
        np.zeros(2),
        range(4)[part],
    )
    for gain, column in zip(gains.T, columns, strict=True):  # one by one: there may be millions
        without = _values(differences, "judged", column, known)
        left = without - gain[differences["i"]] + gain[differences["j"]]
        squares += [np.einsum("d,d,d", off, off, weights) for off in (without, left)]
    before, after = np.sqrt(squares / (len(columns) * weights.sum())).tolist()
    return before, after


def _helps(offsets: tuple[float, float]) -> bool:
    before, after = offsets
    return before > SETTINGS.offset and after < SETTINGS.left * before


def _outputs(differences: Differences, known: Array, medians: str) -> Array:
    """(F, 4) gains of luminance and color, fitted to medians of a name ("fitted" or "whole")."""
    solved = np.zeros((len(known), 4))
    for output in range(4) if len(differences) else ():
        deviation = SETTINGS.color_gain if output else SETTINGS.gain
        spread = differences["spread"][:, output].astype(np.float64)
        variance = (
            spread**2 * SETTINGS.correlated / differences["patches"]
            + SETTINGS.floor[min(output, 1)] ** 2
        )
        values = _values(differences, medians, output, known)
        solved[:, output] = _chain(differences, values, variance, deviation, len(known))
    return solved


def _chain(
    differences: Differences, value: Array, variance: Array, deviation: float, frames: int
) -> Array:
    """(F,) gains about 0 whose differences are the values: Cauchy weights and a prior."""
    i, j = (np.ascontiguousarray(differences[end]) for end in "ij")
    weight, prior = 1.0 / variance, np.array([deviation**-2])

    def terms(some: slice) -> tuple[Array, Array]:
        ones = np.ones((len(i[some]), 1))
        return ones, ones

    for _ in range(SETTINGS.rounds):
        gains = solve_frames((i, j), value, weight, prior, frames, terms)[:, 0]
        off = value - gains[i] + gains[j]
        weight = 1.0 / ((off**2 / (SETTINGS.outlier**2 * variance) + 1.0) * variance)
    return np.asarray(gains - gains.mean(), np.float64)
