"""All metrics of a site, and their tables: one CSV each, with standard errors beside the values."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stereo_seecolor.extras.reef.colony import Colony
from stereo_seecolor.extras.reef.cover import Cover
from stereo_seecolor.extras.reef.labelled_points import PointCover
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.csv_tables import csv_text
from stereo_seecolor.mapping.raster.structure import StructureAtScale

Row = dict[str, Any]


@dataclass(frozen=True)
class SiteMetrics:
    """The metrics of a site.

    structure: at each scale. colonies: each outline that was seen. cover: by label. unseen:
    outlines of which nothing was seen. point_cover: by label, of points that somebody labelled;
    unseen_points: how many of those lie where the map shows nothing.
    height_std_m: median standard error of a height of the terrain; at rims it is larger. files:
    what was written. note: on frames that are left out.
    """

    structure: tuple[StructureAtScale, ...]
    colonies: tuple[Colony, ...]
    cover: tuple[Cover, ...]
    unseen: tuple[str, ...]
    cell_m: float
    area_m2: float
    height_std_m: float
    point_cover: tuple[PointCover, ...] = ()
    unseen_points: int = 0
    files: tuple[Path, ...] = ()
    note: str = ""


def tables(result: SiteMetrics) -> dict[str, list[Row]]:
    """Name of the table -> its rows; those of outlines only where there are outlines."""
    found = {
        "structure": [_scale(each) for each in result.structure],
        "outlines": [_outline(each) for each in result.colonies],
    }
    found["cover"] = [asdict(each) for each in result.cover]
    found["point_cover"] = [asdict(each) for each in result.point_cover]
    return {name: rows for name, rows in found.items() if rows}


def write_tables(folder: Path, content: dict[str, list[Row]]) -> None:
    """A CSV for each table; numbers that are not known are empty."""
    for name, rows in content.items():
        write_atomic(
            folder / f"{name}.csv", csv_text(rows[0], (row.values() for row in rows)).encode()
        )


def _scale(scale: StructureAtScale) -> Row:
    others = {"std": scale.standard_error, "between": scale.between_squares, "mapped": scale.mapped}
    head = {"edge_m": scale.edge_m, "scale_m": scale.scale_m, "squares": scale.squares}
    return head | _with_errors(
        asdict(scale.mean), {name: asdict(each) for name, each in others.items()}
    )


def _outline(colony: Colony) -> Row:
    head: Row = {"name": colony.name, "label": colony.label}
    body = _with_errors(asdict(colony.measured), {"std": asdict(colony.standard_error)})
    return (
        head
        | body
        | {"unseen": colony.unseen, "views": colony.views, "overlap": 1 - colony.counted}
    )


def _with_errors(values: Row, others: dict[str, Row]) -> Row:
    """Each value with its columns of errors beside it: rugosity, rugosity_std, ..."""
    row: Row = {}
    for name, value in values.items():
        row[name] = value
        row |= {f"{name}_{suffix}": columns[name] for suffix, columns in others.items()}
    return row
