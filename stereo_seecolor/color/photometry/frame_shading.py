"""The shading of every frame: shadows and sunlight that move over the reef, as a smooth pattern of
each frame's own.

    log I(frame, u, v) - log I(other, u', v') = S(frame; u, v) - S(other; u', v') + difference of
        their gains

Waves, and whatever floats above, throw light and shadow as wide as a picture, which lie elsewhere
on the reef in the next one. Where two frames show the same patches, medians over parts of the
picture keep their difference; the shading of all frames follows from them in one banded system, as
gains do (``gain_chain``). What stays in place on the reef no view tells from the reef's color.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_model import SHADING, SHAPE, FrameLight, shading_terms
from stereo_seecolor.color.photometry.light_prior import (
    COLOR,
    LUMINANCE,
    Deviations,
    shading_deviations,
)
from stereo_seecolor.color.render.tone import FULL_AT
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values, encode
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Image, Map
from stereo_seecolor.robust_statistics import deviation_about_zero

Array = NDArray[np.float64]
Indices = NDArray[np.signedinteger]
AT_ONCE = 50_000
"""Differences whose equations are in memory at once."""
DENSE = 400
"""Up to so many unknowns are solved densely: scipy's banded solver takes 0.2 s to load."""
OWN = 1 + SHADING
"""Unknowns of a frame: its gain and its shading."""


@dataclass(frozen=True)
class ShadingSettings:
    """How parts of pictures are compared and trusted."""

    parts: int = 4
    """Parts of a picture along each side."""
    least: int = 4
    """Patches in a part, for its median to count."""
    half: float = 10.0
    """Patches with which a part weighs half of what it can."""
    gain: tuple[float, float] = (0.3, 0.03)
    """Standard deviation of a frame's gain of luminance and of color, as in the chain."""
    outlier: float = 1.5
    """Robust standard deviations beyond which a part weighs less than half (Cauchy)."""
    floor: float = 0.005
    """Least standard deviation of a part, logarithm."""
    rounds: int = 5
    """Rounds with new weights."""


SETTINGS = ShadingSettings()
ACROSS = 127
"""Steps of a place from the middle of a picture to its edge."""
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
"""Part of frame i that frame j < i shows too: logarithm of i over j (luminance, color R, G, B), and
where both see it. 21 bytes: a dive of 100,000 frames has five million of these.
"""
Parts = NDArray[np.void]
"""(D,) of PART."""


def parts_of(pair: tuple[int, int], at: tuple[Array, Array], values: Array) -> Parts:
    """The difference of frames (``pair``) in each part of the first's image: medians over patches.

    at: (N, 2) places of the patches in either image, -1..1. values: (N, 4), as of PART.
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
    """(frames, SHADING, 3) coefficients, 0 where unknown. used: of luminance and of color."""
    solved = np.zeros((frames, SHADING, 3))
    if len(parts) and used[0]:
        solved += _solved(parts, 0, frames, SETTINGS.gain[0], LUMINANCE)[..., None]
    if len(parts) and used[1]:
        solved += np.stack(
            [_solved(parts, channel, frames, SETTINGS.gain[1], COLOR) for channel in (1, 2, 3)],
            axis=2,
        )
    return solved


def without_shading(found: NDArray[np.void], parts: Parts, shading: Array) -> NDArray[np.void]:
    """The DIFFERENCE of whole frames less what the (F, SHADING, 3) shading explains."""
    if not len(parts):
        return found
    frames, left = len(shading), found.copy()
    pairs, part = np.unique(parts["i"].astype(np.int64) * frames + parts["j"], return_inverse=True)
    pair = found["i"].astype(np.int64) * frames + found["j"]
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
    """(frames, K) unknowns of frames by weighted differences between them: least squares about 0.

    pair: (D,) frames i > j. value, weight: (D,). prior: (K,) precisions. terms: (d, K) of i and of
    j, for some of the differences.
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


# Divides the light of a survey out of an image: each value becomes that under even light and the
# usual exposure.

NODES = {8: 4096, 16: 65536}
"""Steps of the logarithm of light, by bit depth: half a step is below a quarter of a value."""
DARKEST = -12.0
"""Logarithm of the darkest light told from black: 0.4 of the least linear value of 16 bits."""

MOST = SHAPE.most
"""``SHAPE.most`` as a plain number, which compiled functions can read."""


class _Scale(NamedTuple):
    """log_light (V,): of each value. values (NODES,): of each step of it, from DARKEST to 0."""

    log_light: NDArray[np.float32]
    values: NDArray[Any]


def divide_illumination(
    image: Image, range_m: Map, light: FrameLight, encoding: InputEncoding
) -> Image:
    """The image with the light's pattern and the frame's gain and shading divided out, at the same
    bit depth.

    range_m: (H, W) meters; where it is unknown, the pattern at the reference range is used.
    Values above full scale are clipped. Values that the camera had clipped stay clipped, and the
    other channels of such a pixel do not get darker: the pixel would change its color.
    """
    out = np.empty_like(image)
    log_range = light.light.log_range(range_m).astype(np.float32)
    clipped = int(np.ceil(FULL_AT * np.iinfo(image.dtype).max))
    scale = _scale(8 * image.dtype.itemsize, encoding)
    _even(
        np.ascontiguousarray(image),
        log_range,
        light.maps,
        light.log_gain.astype(np.float32),
        light.log_shading,
        scale,
        clipped,
        out,
    )
    return out


@lru_cache
def _scale(bit_depth: int, encoding: InputEncoding) -> _Scale:
    full = 2**bit_depth - 1
    light = decoded_values(bit_depth, encoding).astype(np.float64)
    log_light = np.log(np.maximum(light, np.exp(DARKEST))).astype(np.float32)
    steps = np.exp(np.linspace(DARKEST, 0, NODES[bit_depth]))
    steps[0] = 0
    values = np.round((encode(steps, "srgb") if encoding == "srgb" else steps) * full)
    return _Scale(log_light, values.astype(np.uint8 if bit_depth == 8 else np.uint16))


@compiled
def _even(
    image: Any,
    log_range: Any,
    maps: Any,
    log_gain: Any,
    log_shading: Any,
    scale: Any,
    clipped: int,
    out: Any,
) -> None:
    """Divide pattern, gain and shading out, into ``out``. clipped: least value that may be so."""
    most, last = np.float32(MOST), scale.values.size - 1
    step = np.float32(last / -DARKEST)
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            z = log_range[row, column]
            is_clipped = (
                max(image[row, column, 0], image[row, column, 1], image[row, column, 2]) >= clipped
            )
            for c in range(3):
                value = image[row, column, c]
                pattern = np.float32(0)
                for k in range(maps.shape[3] - 1, -1, -1):
                    pattern = pattern * z + maps[row, column, c, k]
                pattern = min(max(pattern, -most), most)
                light = scale.log_light[value] - pattern - log_gain[c] - log_shading[row, column, c]
                at = np.int64((light - np.float32(DARKEST)) * step + np.float32(0.5))
                shown = scale.values[min(max(at, 0), last)]
                out[row, column, c] = max(shown, value) if is_clipped else shown
