"""Limits of the water parameters, checked wherever they are read, fitted or given."""

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Limits:
    """Limits beyond which no water lies; within them arithmetic stays finite."""

    light: float = 1e6
    """Fraction of full scale: more than any bright water at any exposure."""
    least_white: float = 1e-12
    """Fraction of full scale: less than the white point of a black image."""
    rate_per_m: float = 1e4
    """Light lost within 0.1 mm; the most turbid harbors have some 50 per meter."""
    exposure: float = 1e12
    """Gain of all channels: the gain that takes the least white point to full scale."""
    row_sum: float = 1e-6
    """Difference of the sum of a row of the color matrix from 1: rounding."""
    mixing: float = 10.0
    """Size of an entry of the color matrix: far above that of any camera with three colors."""
    fall_off: float = 4.0
    """Power of the range: light that goes to a surface and comes back falls off by no more."""


LIMITS = Limits()
LITTLE_RELIEF = "little relief"
"""What the warning begins with of a water whose attenuation is the prior's."""
SHARE = "; use color.lock=survey"
"""What helps a water of some frames whose ranges do not determine it."""

_LIGHT, _RATE = (0.0, LIMITS.light), (0.0, LIMITS.rate_per_m)
_SIGNED = (-LIMITS.rate_per_m, LIMITS.rate_per_m)
_LOGIT = (-700.0, 700.0)  # of light before a sigmoid: beyond, exp overflows
BOUNDS = {
    "gamma_inf": _LIGHT,
    "beta": _RATE,
    "eta": _LIGHT,
    "alpha": _RATE,
    "w": _SIGNED,
    "v": _RATE,
    "y": _SIGNED,
    "x": _RATE,
    "white": (LIMITS.least_white, LIMITS.light),
}
"""Parameter -> least and greatest, each channel."""
PARAMETERS = tuple(BOUNDS)
MATRICES = ("matrix", "matrix_errors")
"""Fields with three rows of three numbers."""
_LEAST, _GREATEST = (np.array([[bounds[end]] for bounds in BOUNDS.values()]) for end in (0, 1))


def problem_of(water: Mapping[str, Any]) -> str:
    """The first problem of these water parameters, as "name must be ... (got ...)"; "" for none."""
    printed = _number_problem("final_sigmoid", water["final_sigmoid"], 0.0, LIMITS.light)
    bounds_of = BOUNDS | (
        {"gamma_inf": _LOGIT, "eta": _LOGIT} if not printed and water["final_sigmoid"] else {}
    )
    problems = (
        []
        if _all_inside(water)
        else [_channels_problem(name, water[name], *bounds) for name, bounds in bounds_of.items()]
    )
    if not any(problems) and not _light_falls(water):
        problems.append(
            "w and y let light grow with range: w exp(-v z) + y exp(-x z) must not be negative at "
            "any range"
        )
    if water["input_encoding"] not in ("srgb", "linear", "as-is"):
        problems.append(
            f"input_encoding must be srgb, linear or as-is (got {water['input_encoding']!r:.80})"
        )
    if water["exposure"] is not None:
        problems.append(_number_problem("exposure", water["exposure"], 1 / LIMITS.exposure))
    problems.append(printed)
    problems.append(_number_problem("highlights", water["highlights"], 1.0))
    problems.append(_number_problem("fall_off", water["fall_off"], 0.0, LIMITS.fall_off))
    if water["typical_range_m"] is not None:
        problems.append(_number_problem("typical_range_m", water["typical_range_m"], 0.0))
    problems.append(_matrix_problem(water["matrix"], water["matrix_errors"]))
    errors = water["standard_errors"]
    for name, values in () if _errors_inside(list(errors.values())) else errors.items():
        known = np.nan_to_num(values, nan=0.0) if _is_channels(values) else values
        problems.append(
            _channels_problem(f"the standard error of {name}", known, 0.0, np.finfo(np.float64).max)
        )
    return next(filter(None, problems), "")


def _all_inside(water: Mapping[str, Any]) -> bool:
    """Whether all parameters are within limits, by one fast test of thousands of waters."""
    values = [water[name] for name in PARAMETERS]
    return all(map(_is_channels, values)) and bool(
        ((values >= _LEAST) & (values <= _GREATEST)).all()
    )


def _errors_inside(errors: list[Any]) -> bool:
    """Whether all standard errors are finite or unknown (NaN), and not negative."""
    return all(map(_is_channels, errors)) and not (np.less(errors, 0.0) | np.isinf(errors)).any()


def _is_channels(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.shape == (3,) and value.dtype.kind == "f"


def _channels_problem(name: str, value: Any, low: float, high: float) -> str:
    if not _is_channels(value):
        return f"{name} needs three numbers, one a channel (got {value!r:.80})"
    inside = (value >= low) & (value <= high)
    return (
        ""
        if inside.all()
        else f"{name} must be from {low:g} to {high:g} in each channel (got {value.tolist()})"
    )


def _number_problem(name: str, value: Any, low: float, high: float = LIMITS.exposure) -> str:
    good = not isinstance(value, bool) and isinstance(value, Real) and low <= float(value) <= high
    return "" if good else f"{name} must be a number from {low:g} to {high:g} (got {value!r:.80})"


def _matrix_problem(matrix: Any, errors: Any) -> str:
    for name, value in (
        ("matrix", matrix),
        ("matrix_errors", np.zeros((3, 3)) if errors is None else errors),
    ):
        if (
            not isinstance(value, np.ndarray)
            or value.shape != (3, 3)
            or not (np.abs(value) <= LIMITS.mixing).all()
        ):
            return (
                f"{name} needs three rows of three numbers from {-LIMITS.mixing:g} to "
                f"{LIMITS.mixing:g} (got {value!r:.80})"
            )
    balanced = np.abs(matrix.sum(axis=1) - 1) <= LIMITS.row_sum
    return (
        ""
        if balanced.all()
        else f"matrix must have rows that sum to 1 (got {matrix.sum(axis=1).tolist()})"
    )


def _light_falls(water: Mapping[str, Any]) -> bool:
    """Whether w exp(-v z) + y exp(-x z) >= 0 at every range: a negative term must be the smaller
    and the first to vanish.
    """
    w, v, y, x = (water[name] for name in ("w", "v", "y", "x"))
    rounding = 1e-9 * (np.abs(w) + np.abs(y))
    rising = ((w >= -rounding) | (v >= x)) & ((y >= -rounding) | (x >= v)) & (w + y >= -rounding)
    return bool(rising.all())
