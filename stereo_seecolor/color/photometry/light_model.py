"""The model of the light of a survey: the brightness of a surface depends on its position in the
image, its range and the frame.

    log I_c(u, v, z, frame) = log scene_c + log pattern_c(u, v, z) + log gain_c(frame) + log
        shading_c(u, v, frame)

The pattern is vignetting times the light of lamps on the rig, the same in all frames: a polynomial
with mean 0 over the image at every range, so that the trend with range is left to the water. The
shading is sunlight and shadows that move over the reef: another polynomial for each frame.
"""

from array import array
from collections.abc import Callable, ItemsView, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.color_trend import ColorTrend, with_color_trend
from stereo_seecolor.compute.names import Names, SomeNames
from stereo_seecolor.config import ColorConfig, LampsConfig
from stereo_seecolor.files.json_values import Streamed
from stereo_seecolor.files.keys import content_key, content_key_of
from stereo_seecolor.records import Water
from stereo_seecolor.water.limits import LIMITS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PatternShape:
    """Degrees of the polynomial."""

    degree: int = 4
    """Total degree over the image: 6 and 8 are not better on a strobe-lit reef (real)."""
    range_degree: int = 2
    """Degree in the logarithm of the range."""
    range_step: float = 0.2
    """Logarithm of range that is 1 in the polynomial: terms have similar size at usual relief."""
    most: float = 1.6
    """Largest absolute logarithm of the pattern, a factor of 5; larger values are extrapolation."""


SHAPE = PatternShape()
POWERS = tuple(
    (a, b)
    for total in range(1, SHAPE.degree + 1)
    for a in range(total, -1, -1)
    for b in [total - a]
)
"""Powers of x and y of the pattern's terms."""
PATTERN = len(POWERS)
"""Terms of the pattern at the reference range; as many follow for each power of the range."""
TERMS = PATTERN * (SHAPE.range_degree + 1)
SHADING = 5
"""Number of terms of the shading of a frame: the first of the pattern, of degree 1 and 2."""


@dataclass(frozen=True, eq=False)
class ByFrame(Mapping[str, Array]):
    """Numbers (K,) by the name of a frame. numbers: (F, K) for all ``names``, NaN = none."""

    names: Names = field(default_factory=Names)
    numbers: Array = field(default_factory=lambda: np.zeros((0, 1)))

    def __getitem__(self, name: str) -> Array:
        number = self.names.number(name)
        if number is None or np.isnan(self.numbers[number, 0]):
            raise KeyError(name)
        return np.asarray(self.numbers[number])

    def __iter__(self) -> Iterator[str]:
        return iter(SomeNames(self.names, self._known))

    def __len__(self) -> int:
        return int(np.count_nonzero(self._known))

    def items(self) -> ItemsView[str, Array]:
        """Return names and numbers, without a search for each name."""
        return _Items(self)

    @property
    def _known(self) -> NDArray[np.bool_]:
        return ~np.isnan(self.numbers[:, 0])

    @classmethod
    def of(cls, numbers: Iterable[tuple[str, Sequence[float]]], each: int) -> Self:
        """Make the mapping of these names and numbers. each: K, numbers of a frame."""
        names, values = Names(), array("d")
        for name, several in numbers:
            names.add(name)
            values.extend(several)
        return cls(names, np.frombuffer(values, np.float64).reshape(-1, each))


class _Items(ItemsView[str, Array]):
    _mapping: ByFrame

    def __iter__(self) -> Iterator[tuple[str, Array]]:
        of = self._mapping
        return (
            (name, numbers)
            for name, numbers, known in zip(of.names, of.numbers, of._known, strict=True)
            if known
        )


@dataclass(frozen=True, eq=False)
class Light:
    """The light of a survey.

    coefficients: (TERMS, 3) of the logarithm of the pattern, R, G, B. reference_m: range at which
    only the first PATTERN terms are not 0. seen_m: nearest and farthest measured range. gains: name
    of a frame -> (3,) logarithm of its gain.
    fade: power of the range with which the light of a surface falls off, water and lamps together;
    0 = not measured.
    color_trend: change of the color of a surface with range; None = not measured.
    shading: name of a frame -> (3 SHADING,) coefficients of the logarithm of its shading, each for
    R, G, B.
    """

    coefficients: Array
    reference_m: float
    seen_m: tuple[float, float]
    gains: Mapping[str, Array] = field(default_factory=ByFrame)
    fade: float = 0.0
    color_trend: ColorTrend | None = None
    shading: Mapping[str, Array] = field(default_factory=ByFrame)

    def on(self, name: str, size: tuple[int, int]) -> "FrameLight":
        """The light of the frame ``name``, whose image has ``size`` (width, height)."""
        shading = shading_map(self.shading.get(name, np.zeros(3 * SHADING)), size)
        return FrameLight(self, self.gains.get(name, np.zeros(3)), self.maps(size), shading)

    def log_pattern(self, pixel: Array, range_m: Array, size: tuple[int, int]) -> Array:
        """(N, 3) at (N, 2) pixels x, y of an image of ``size`` (width, height), at (N,) ranges."""
        terms = pattern_terms(pixel, self.log_range(range_m), size)
        return np.clip(terms @ self.coefficients, -SHAPE.most, SHAPE.most)

    def log_range(self, range_m: NDArray[np.floating]) -> Array:
        """The variable of the polynomial: 0 at the reference range and for unknown ranges."""
        known = np.where(np.isfinite(range_m) & (range_m > 0), range_m, self.reference_m)
        return np.asarray(
            np.log(np.clip(known, *self.seen_m) / self.reference_m) / SHAPE.range_step
        )

    def maps(self, size: tuple[int, int]) -> NDArray[np.float32]:
        """(H, W, 3, range_degree + 1) coefficients of the powers of ``log_range`` by pixel."""
        if size in self._maps:
            return self._maps[size]
        width, height = size
        x = _normalized(np.arange(width, dtype=np.float64), width)
        y = _normalized(np.arange(height, dtype=np.float64), height)
        parts = self.coefficients.reshape(SHAPE.range_degree + 1, PATTERN, 3)
        grid = np.zeros((SHAPE.degree + 1, SHAPE.degree + 1, 3, SHAPE.range_degree + 1))
        for term, (a, b) in enumerate(POWERS):
            grid[a, b] = parts[:, term].T
            grid[0, 0] -= _mean(a, b) * parts[:, term].T
        powers_x, powers_y = (np.stack([at**k for k in range(SHAPE.degree + 1)]) for at in (x, y))
        rows = np.einsum("by,abck->ayck", powers_y, grid)
        self._maps[size] = np.einsum("ax,ayck->yxck", powers_x, rows).astype(np.float32)
        return self._maps[size]

    @cached_property
    def _maps(self) -> dict[tuple[int, int], NDArray[np.float32]]:
        return {}

    @cached_property
    def fingerprint(self) -> str:
        """A hash of the whole light."""
        gains, shading = (
            content_key_of(one for pair in of.items() for one in pair)
            for of in (self.gains, self.shading)
        )
        return content_key(replace(self, gains={}, shading={}).content(), gains, shading)

    def content(self) -> dict[str, Any]:
        """Convert to JSON."""
        return {
            "reference_m": self.reference_m,
            "seen_m": list(self.seen_m),
            "fade": self.fade,
            **({} if self.color_trend is None else {"color_trend": self.color_trend.content()}),
            "log_pattern": self.coefficients.tolist(),
            "log_gains": _streamed(self.gains),
            **({"log_shading": _streamed(self.shading)} if self.shading else {}),
        }

    @classmethod
    def from_content(cls, content: Any) -> "Light":
        """Convert from JSON. Raises ValueError, KeyError or TypeError for other content."""
        coefficients = np.array(content["log_pattern"], dtype=np.float64).reshape(TERMS, 3)
        near_m, far_m = (float(value) for value in content["seen_m"])
        gains = ByFrame.of(content["log_gains"].items(), 3)
        shading = ByFrame.of(content.get("log_shading", {}).items(), 3 * SHADING)
        trend = (
            ColorTrend.from_content(content["color_trend"]) if "color_trend" in content else None
        )
        return cls(
            coefficients,
            float(content["reference_m"]),
            (near_m, far_m),
            gains,
            float(content["fade"]),
            trend,
            shading,
        )


def _streamed(of: Mapping[str, Array]) -> Streamed:
    return Streamed(lambda: ((name, numbers.tolist()) for name, numbers in of.items()))


@dataclass(frozen=True, eq=False)
class FrameLight:
    """log_gain: (3,), 0 = not measured. maps: of ``Light.maps``. log_shading: (H, W, 3)."""

    light: Light
    log_gain: Array
    maps: NDArray[np.float32]
    log_shading: NDArray[np.float32]

    def seen_through(
        self, warp: Callable[[NDArray[np.float32]], NDArray[np.float32]]
    ) -> "FrameLight":
        """Convert the light to the pixels of another image; ``warp`` converts an (H, W) map."""

        def warped(several: NDArray[np.float32]) -> NDArray[np.float32]:
            planes = np.moveaxis(several.reshape(*several.shape[:2], -1), 2, 0)
            maps = np.stack([warp(np.ascontiguousarray(plane)) for plane in planes], axis=2)
            return maps.reshape(*maps.shape[:2], *several.shape[2:])

        return replace(self, maps=warped(self.maps), log_shading=warped(self.log_shading))


def pattern_terms(pixel: Array, log_range: Array, size: tuple[int, int]) -> Array:
    """(N, TERMS) terms of the polynomial, each with mean 0 over the image."""
    flat = _flat_terms(places(pixel, size), POWERS)
    return np.concatenate(
        [flat * log_range[:, None] ** k for k in range(SHAPE.range_degree + 1)], axis=1
    )


def places(pixel: Array, size: tuple[int, int]) -> Array:
    """(N, 2) pixels x, y as -1..1 from edge to edge of an image of ``size`` (width, height)."""
    return np.stack([_normalized(pixel[:, axis], size[axis]) for axis in (0, 1)], axis=1)


def shading_terms(place: Array) -> Array:
    """(N, SHADING) terms of the shading of a frame at (N, 2) ``places``, each of mean 0."""
    return _flat_terms(place, POWERS[:SHADING])


def _flat_terms(place: Array, powers: Sequence[tuple[int, int]]) -> Array:
    x, y = place.T
    return np.stack([x**a * y**b - _mean(a, b) for a, b in powers], axis=1)


def shading_map(coefficients: Array, size: tuple[int, int]) -> NDArray[np.float32]:
    """(H, W, 3) logarithm of the shading of a frame. coefficients: of ``Light.shading``."""
    width, height = size
    if not coefficients.any():
        return np.zeros((height, width, 3), np.float32)
    x = _normalized(np.arange(width, dtype=np.float64), width)
    y = _normalized(np.arange(height, dtype=np.float64), height)
    of_rows = [
        y[:, None] ** b * of_rgb
        for (_, b), of_rgb in zip(POWERS, coefficients.reshape(SHADING, 3), strict=False)
    ]
    mean = np.array([_mean(a, b) for a, b in POWERS[:SHADING]]) @ coefficients.reshape(SHADING, 3)
    rows = np.stack([*of_rows, np.tile(-mean, (height, 1))])  # (SHADING + 1, H, 3)
    columns = np.stack([*(x**a for a, _ in POWERS[:SHADING]), np.ones(width)])
    return np.asarray(
        np.einsum("sx,syc->yxc", columns.astype(np.float32), rows.astype(np.float32), optimize=True)
    )


def _normalized(pixel: Array, size: int) -> Array:
    """Pixel coordinates as -1 at the first edge of the image, 1 at the last. size: pixels."""
    return (2 * pixel + 1 - size) / size


def _mean(a: int, b: int) -> float:
    """Mean of x^a y^b over the image, x and y from -1 to 1."""
    return 0.0 if a % 2 or b % 2 else 1.0 / ((a + 1) * (b + 1))


MEAN_SQUARES = np.array(
    [[_mean(a + c, b + d) - _mean(a, b) * _mean(c, d) for c, d in POWERS] for a, b in POWERS]
)
"""(PATTERN, PATTERN) mean over the image of the products of the pattern's terms."""


LAMPS_FADE = 1.5
"""Least power of the range, water and lamps together, at which lamps on the rig give most of the
light: 1.5 to 2.2 on synthetic dives by night, 2.4 on a real dive with strobes.
"""


def settings_under(config: ColorConfig, light: Light | None) -> ColorConfig:
    """The settings for the fit of the water: light of lamps has not traveled through water
    above the reef, so its white point is that of lamps, not of daylight at a depth.
    """
    if light is None or light.fade < LAMPS_FADE:
        return config
    return config.model_copy(update={"robust": LampsConfig(**dict(config.robust))})


def lit_by(water: Water, light: Light | None) -> Water:
    """Add two measurements of the light to a water: the color trend, and the fall-off of lamps."""
    if light is None:
        return water
    if light.fade:  # what of it the water itself does not explain
        near_far_m = light.reference_m * np.exp(SHAPE.range_step * np.array([-0.5, 0.5]))
        near, far = np.log(water.attenuation(near_far_m)).mean(axis=1)
        left = light.fade - (near - far) / SHAPE.range_step
        water = replace(water, fall_off=float(np.clip(left, 0.0, LIMITS.fall_off)))
    return with_color_trend(water, light.color_trend)
