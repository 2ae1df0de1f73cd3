"""The limits of range in the settings against features of a dive: reefs lie within 20 m."""

from dataclasses import dataclass

import numpy as np

from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.records import Array

LOST = 0.05
"""Fraction of features outside a limit above which the limit is reported; on reefs 0 to 0.01 are,
by mismatches.
"""
ENDS, MARGIN = (1.0, 95.0), 1.3
"""Percentiles of range taken for the nearest and the farthest point, which leave out mismatches;
and the factor between these and the proposed limits.
"""


@dataclass(frozen=True)
class RangeLimits:
    """A limit of range that cuts off features of a dive. key: its setting in ``matching``. now_m:
    its value. fits_m: one that fits.

    lost: fraction of the features outside it.
    """

    key: str
    now_m: float
    fits_m: float
    lost: float

    @property
    def option(self) -> str:
        """The proposed setting, as --set takes it."""
        return f"matching.{self.key}={self.fits_m:g}"

    @property
    def note(self) -> str:
        """A line on what is lost, and what to do."""
        side = "beyond" if self.fits_m > self.now_m else "nearer than"
        limit = f"matching.{self.key} ({self.now_m:g} m)"
        return (
            f"{self.lost:.0%} of the features lie {side} {limit} and get no range: --set "
            f"{self.option}"
        )


def range_limits(range_m: Array, config: MatchingConfig) -> tuple[RangeLimits, ...]:
    """The limits that too many features lie outside of. range_m: (n,) of features, meters."""
    if range_m.size == 0:
        return ()
    near_m, far_m = np.percentile(range_m, ENDS)
    near = RangeLimits(
        "min_range_m",
        config.min_range_m,
        _rounded(near_m / MARGIN, np.floor),
        float((range_m < config.min_range_m).mean()),
    )
    far = RangeLimits(
        "max_range_m",
        config.max_range_m,
        _rounded(far_m * MARGIN, np.ceil),
        float((range_m > config.max_range_m).mean()),
    )
    return tuple(limit for limit in (near, far) if limit.lost > LOST)


def _rounded(value_m: float, towards: np.ufunc) -> float:
    """A length rounded to one digit, down or up: ``towards`` is np.floor or np.ceil."""
    unit_m = 10 ** np.floor(np.log10(value_m))
    return float(f"{towards(value_m / unit_m) * unit_m:.1g}")
