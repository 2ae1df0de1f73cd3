"""Cover of the bottom by label: as a fraction of what was seen, and of what was outlined."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from stereo_seecolor.extras.reef.colony import Colony

UNLABELED = "unlabeled"


@dataclass(frozen=True)
class Cover:
    """The cover of one label, over all its outlines.

    Attributes:
        of_seen: the seen part of the planar area, over the planar area that the map shows: the
        cover that ecologists state.
        of_outlined_planar: planar area over that of all outlines.
        of_outlined_surface: surface over that of all outlines, with the standard error by the
        errors of ranges.
    """

    label: str
    outlines: int
    surface_m2: float
    surface_std_m2: float
    planar_m2: float
    of_seen: float
    of_outlined_planar: float
    of_outlined_surface: float
    of_outlined_surface_std: float


def cover(colonies: Sequence[Colony], seen_m2: float) -> list[Cover]:
    """A row for each label, the largest surface first. Cells of several outlines are divided among
    them. seen_m2: planar area that the map shows.
    """
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
        seen = sum((1 - each.unseen) * _planar_m2(each) for each in members)
        of_all = seen / seen_m2, planar_m2 / planar
        rows.append(
            Cover(label, len(members), surface, own**0.5, planar_m2, *of_all, fraction, error)
        )
    return sorted(rows, key=lambda row: -row.surface_m2)


def _surface_m2(colony: Colony) -> float:
    return colony.counted * colony.measured.surface_m2


def _planar_m2(colony: Colony) -> float:
    return colony.counted * colony.measured.planar_m2


def _variance(colonies: Sequence[Colony]) -> float:
    """Of the summed surface; errors of different outlines are independent."""
    return float(sum((each.counted * each.standard_error.surface_m2) ** 2 for each in colonies))
