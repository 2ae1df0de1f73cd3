"""Cover of the bottom by label, as fractions of the surface area and of the planar area."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from stereo_seecolor.extras.reef.metrics.colony import Colony

UNLABELED = "unlabeled"


@dataclass(frozen=True)
class Cover:
    """The cover of one label, over all its outlines. of_surface, of_planar: fractions of what all outlines cover; _std: from the
    range errors.
    """

    label: str
    outlines: int
    surface_m2: float
    surface_std_m2: float
    planar_m2: float
    of_surface: float
    of_surface_std: float
    of_planar: float


def cover(colonies: Sequence[Colony]) -> list[Cover]:
    """A row for each label, the largest surface first. Cells of several outlines are divided among them."""
    groups: dict[str, list[Colony]] = defaultdict(list)
    for colony in colonies:
        groups[colony.label or UNLABELED].append(colony)
    total = sum(_surface_m2(colony) for colony in colonies)
    planar = sum(_planar_m2(colony) for colony in colonies)
    variance = _variance(colonies)
    rows = []
    for label, members in groups.items():
        surface, own = sum(map(_surface_m2, members)), _variance(members)
        fraction = surface / total
        error = ((1 - fraction) ** 2 * own + fraction**2 * (variance - own)) ** 0.5 / total
        planar_m2 = sum(map(_planar_m2, members))
        rows.append(Cover(label, len(members), surface, own**0.5, planar_m2, fraction, error, planar_m2 / planar))
    return sorted(rows, key=lambda row: -row.surface_m2)


def _surface_m2(colony: Colony) -> float:
    return colony.counted * colony.measured.surface_m2


def _planar_m2(colony: Colony) -> float:
    return colony.counted * colony.measured.planar_m2


def _variance(colonies: Sequence[Colony]) -> float:
    """Of the summed surface; errors of different outlines are independent."""
    return float(sum((each.counted * each.standard_error.surface_m2) ** 2 for each in colonies))
