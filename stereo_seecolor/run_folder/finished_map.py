"""OUT/map read back: the poses of its frames, and the metrics of its site."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereo_seecolor.files.csv_tables import table_rows
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.files.whole_files import damaged_map
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.run_folder.layout import MAP

LONGEST_M = 1000.0
"""Of a voxel or a cell: more is damage."""


@dataclass(frozen=True)
class TrackPoint:
    """The position of a frame's rectified left camera, meters in the map's world; residuals are
    None where no poses were given.
    """

    name: str
    timestamp_s: float | None
    x_m: float
    y_m: float
    z_m: float
    position_residual_m: float | None
    attitude_residual_deg: float | None


@dataclass(frozen=True)
class FinishedMap:
    """The main component of a map, in ``folder``.

    track: its frames in order. site: metrics of the whole site by name. area_m2: planar area that
    the map shows, None in maps of earlier versions. cell_m: edges of voxels and cells by name.
    offset_m: (3,), what to add to the map's own coordinates to get those of its world. pieces:
    number of further components. origin: of x and y on Earth. range_scale: how many times as long
    ranges are in the map than in the frames' files. missing_fraction: of the measured ground, what
    has no height; 0 in maps of earlier versions.
    """

    folder: Path
    track: tuple[TrackPoint, ...]
    site: dict[str, float]
    area_m2: float | None
    cell_m: dict[str, float]
    offset_m: list[float]
    pieces: int
    origin: GeoOrigin | None = None
    range_scale: float = 1.0
    missing_fraction: float = 0.0


def open_map(out: Path) -> FinishedMap | None:
    """Read the map of a run; None where there is none. Raises InputError if it is damaged."""
    folder = out / MAP
    if not (folder / "map.json").is_file():
        return None
    try:
        description = load_object(folder / "map.json")
        cell_m = {
            name: _length(name, description[name])
            for name in ("voxel_m", "dem_m", "mosaic_m", "metrics_m")
        }
        squares = _rows(folder / "reef_metrics.csv")
        site = next((_numbers(row) for row in squares if row["square"] == "site"), {})
        return FinishedMap(
            folder=folder,
            track=tuple(_point(row) for row in _rows(folder / "poses.csv")),
            site=site,
            area_m2=float(description["area_m2"]) if "area_m2" in description else None,
            cell_m=cell_m,
            offset_m=_place(description["offset_m"]),
            pieces=len(list(folder.glob("piece_*"))),
            origin=as_record(GeoOrigin, description["origin"]) if description["origin"] else None,
            range_scale=_length("range_scale", description.get("range_scale", 1)),
            missing_fraction=float(description.get("missing_fraction", 0)),
        )
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise damaged_map(folder, error) from error


def track_points(out: Path) -> tuple[TrackPoint, ...]:
    """The positions of the frames of all components of a map; none without an intact map."""
    try:
        return tuple(
            _point(row) for path in sorted((out / MAP).glob("**/poses.csv")) for row in _rows(path)
        )
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def _rows(path: Path) -> list[dict[str, str]]:
    return list(table_rows(path.read_bytes())) if path.is_file() else []


def _length(name: str, value: Any) -> float:
    if not 0 < (number := float(value)) < LONGEST_M:
        raise ValueError(f"a {name} of {number:g}")
    return number


def _place(values: Any) -> list[float]:
    found = [float(value) for value in values]
    if len(found) != 3 or not all(map(math.isfinite, found)):
        raise ValueError("a position that is not three numbers")
    return found


def _numbers(row: dict[str, str]) -> dict[str, float]:
    return {key: float(value) for key, value in row.items() if key != "square" and value}


def _point(row: dict[str, str]) -> TrackPoint:
    number = {key: float(value) if value else None for key, value in row.items() if key != "name"}
    x_m, y_m, z_m = _place(row[key] for key in ("x_m", "y_m", "z_m"))
    return TrackPoint(
        row["name"],
        number["timestamp_s"],
        x_m,
        y_m,
        z_m,
        number["position_residual_m"],
        number["attitude_residual_deg"],
    )
