"""Whether the settings look for ranges where a dive has its points: reefs lie within 20 m, streets and cliffs do not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MatchingConfig

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RangeConstants:
    """lost: fraction of the features outside the limits from which on it is said; of reefs, 0 to 0.01 are mismatches.

    ends: percentiles of the ranges that are taken for the nearest and the farthest point, without mismatches. margin: beyond them.
    """

    lost: float = 0.05
    ends: tuple[float, float] = (1.0, 95.0)
    margin: float = 1.3


CONSTANTS = RangeConstants()


@dataclass(frozen=True)
class RangeLimits:
    """A limit of matching that points of a dive lie outside of. key: its name there. now_m: its value; fits_m: one that takes them.

    lost: fraction of the points that lie outside.
    """

    key: str
    now_m: float
    fits_m: float
    lost: float

    @property
    def option(self) -> str:
        """As --set takes it."""
        return f"matching.{self.key}={self.fits_m:g}"

    @property
    def note(self) -> str:
        """What is lost, and what to do."""
        side = "beyond" if self.fits_m > self.now_m else "nearer than"
        limit = f"matching.{self.key} ({self.now_m:g} m)"
        return f"{self.lost:.0%} of the features lie {side} {limit} and get no range: --set {self.option}"


def range_limits(range_m: Array, config: MatchingConfig) -> tuple[RangeLimits, ...]:
    """The limits that too many features, at range_m (n,) along the ray, lie outside of. Empty for none, and without features."""
    if range_m.size == 0:
        return ()
    near_m, far_m = np.percentile(range_m, CONSTANTS.ends)
    near = RangeLimits(
        "min_range_m",
        config.min_range_m,
        _rounded(near_m / CONSTANTS.margin, np.floor),
        float((range_m < config.min_range_m).mean()),
    )
    far = RangeLimits(
        "max_range_m", config.max_range_m, _rounded(far_m * CONSTANTS.margin, np.ceil), float((range_m > config.max_range_m).mean())
    )
    return tuple(limit for limit in (near, far) if limit.lost > CONSTANTS.lost)


def _rounded(value_m: float, towards: np.ufunc) -> float:
    """To one digit."""
    unit_m = 10 ** np.floor(np.log10(value_m))
    return float(f"{towards(value_m / unit_m) * unit_m:.1g}")
