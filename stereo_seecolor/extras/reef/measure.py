"""``measure``: points, lengths and areas on frames and map of a run, from a table of places."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.reef.ground_volume import volume_above
from stereo_seecolor.extras.reef.lengths_and_areas import (
    Measured,
    along_surface,
    known_area,
    length_along,
    planar_area,
    range_of,
    straight_length,
    surface_area,
)
from stereo_seecolor.extras.reef.map_ground import Ground, Spot
from stereo_seecolor.extras.reef.measure_limits import LIMITS
from stereo_seecolor.extras.reef.picking import STEP_PX, FrameSurface, Pick
from stereo_seecolor.extras.reef.polygons import crosses_itself
from stereo_seecolor.extras.reef.site_surface import SiteMesh, read_mesh
from stereo_seecolor.files import csv_tables
from stereo_seecolor.mapping.raster.sides import sides_seen
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.report.height_code import height_std_m
from stereo_seecolor.report.kept_measures import KeptMeasures, read_kept_measures
from stereo_seecolor.report.map_images import TerrainImages
from stereo_seecolor.report.range_code import std_codes, std_from_codes
from stereo_seecolor.run_folder.finished_run import FinishedRun, geometry_of, open_run
from stereo_seecolor.run_folder.layout import MAP, TERRAIN
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run

Kind = Literal["point", "length", "area"]
LEAST_POINTS: dict[Kind, int] = {"point": 1, "length": 2, "area": 3}
COLUMNS = ("measure", "frame", "kind", "label")
NOT_ON_GROUND = (
    "unknown along the surface: a place is not on the ground seen from above, or the outline is "
    "too steep or smaller than a cell"
)
FRAME_COLUMNS, MAP_COLUMNS = ("x_px", "y_px"), ("x_m", "y_m")


@dataclass(frozen=True)
class Wanted:
    """One thing to measure, from a table of places.

    measure: its name in the table. frame: "" for the map. places: (x, y) in pixels of the frame's
    rectified left image.
    spots: (x_m, y_m, z_m, click_m) on the map: position and standard error of the click; height NaN
    where not given. clicks_px: standard error of each of the places, 0 of exact ones.
    """

    measure: str
    frame: str
    kind: Kind
    label: str
    places: tuple[tuple[float, float], ...]
    spots: tuple[tuple[float, float, float, float], ...] = ()
    clicks_px: tuple[float, ...] = ()


@dataclass(frozen=True)
class Measurement:
    """A measurement with standard errors; None where the surface is not known at one of the places,
    or lies at a step.

    value, std: straight length, planar area, or of a point its range (on the map its height);
    meters or square meters.
    surface, surface_std: length or area along the surface; None for a point, and where the map does
    not show it from above.
    x_m, y_m, z_m: of a point, in the axes of the rectified left camera; on the map, in the map's.
    known: of an area, the fraction of the outline in which the surface is known: the rest counts as
    that does, with a standard error. Where corners are not known, surface is that of the known part
    alone. note: what is not known, and why.
    """

    measure: str
    frame: str
    kind: Kind
    label: str
    value: float | None
    std: float | None
    surface: float | None = None
    surface_std: float | None = None
    x_m: float | None = None
    y_m: float | None = None
    z_m: float | None = None
    known: float | None = None
    volume_l: float | None = None
    volume_std_l: float | None = None
    note: str = ""


def measure(out: Path, points: Path) -> list[Measurement]:
    """Measure what a table asks for: columns measure, frame, kind (point, length or area), label,
    x_px, y_px; a row for each place. A .json file holds measures that the page saved.

    Rows without a frame are on the map, and have x_m, y_m, and z_m unless it is that of the
    terrain. Rows with the same measure belong together, in their order. click_px and click_m, if
    there, are standard errors of how well a place was hit; without them places are exact. The page
    writes such tables, and gives the same numbers.
    Raises InputError if the table cannot be used, or the run has no calibration, not the frame, or
    no map.
    """
    run = open_run(out)
    wanted = read_wanted(points)
    surfaces: dict[str, FrameSurface] = {}
    ground = ground_of(run) if any(not each.frame for each in wanted) else None
    if ground is not None and any(not each.frame and each.kind == "area" for each in wanted):
        ground = with_sides(ground, read_mesh(out), open_posed_run(out))
    results, calibration = [], calibration_std(run).total
    for each in wanted:
        if not each.frame and ground is not None:
            results.append(measured_on_map(ground, each, calibration))
            continue
        if each.frame not in surfaces:
            # tables are sorted by frame: one is kept
            surfaces = {each.frame: surface_of(run, each.frame)}
        results.append(measured(surfaces[each.frame], each, calibration))
    return results


def surface_of(run: FinishedRun, name: str) -> FrameSurface:
    """The surface that a frame shows. Raises InputError without a calibration, or the frame."""
    geometry = geometry_of(run, "measuring")
    frame = run.frame(name)
    range_m = frame.measured_range_m()
    if "range_std" in frame.products:
        std_m = np.where(np.isfinite(range_m), frame.read("range_std"), np.float32(np.nan))
    else:
        std_m = geometry.estimated_range_std_m(range_m)
    # as the page holds them
    return FrameSurface(geometry, range_m, std_from_codes(std_codes(std_m)))


def ground_of(run: FinishedRun) -> Ground:
    """The terrain of a run's map. Raises InputError without one, or without its library."""
    path = run.root / MAP / TERRAIN
    if not path.is_file():
        raise InputError(
            f"{run.root}: holds no terrain ({MAP}/{TERRAIN}): make it with stereo-seecolor fuse "
            "and the geo extra"
        )
    terrain = TerrainImages.open(path)
    if terrain is None:  # pragma: no cover: where the geo extra is missing
        raise InputError(f"{path}: needs rasterio to be read: pip install 'stereo-seecolor[geo]'")
    grid, std_m = terrain.grid, height_std_m(run)
    heights_m = terrain.heights_m((0, 0, *grid.shape[::-1]))
    std_m = std_m if np.isfinite(std_m) else 0.0
    return Ground(heights_m, grid, std_m, base_m=terrain.base_m)


def with_sides(ground: Ground, mesh: SiteMesh, posed: PosedRun) -> Ground:
    """The ground of a map in its world, with the sides that its mesh holds, and with the distance
    over which its frames make errors alike.
    """
    heights = ground.heights_m.astype(np.float64)
    mesh_m2 = mesh.area_over(ground.grid.moved(-posed.offset_m))
    sides = sides_seen(heights, mesh_m2, ground.grid.cell_m, ground.gap_m)
    return replace(ground, sides=sides, correlation_m=float(np.nan_to_num(posed.correlation_m)))


def measured_on_map(ground: Ground, wanted: Wanted, calibration: float) -> Measurement:
    """Measure one thing on the map. calibration: relative standard error of a length by the
    calibration.
    """
    about = (wanted.measure, wanted.frame, wanted.kind, wanted.label)
    spots: list[Spot] = []
    for x_m, y_m, z_m, click_m in wanted.spots:
        spot = ground.pick(x_m, y_m, None if np.isnan(z_m) else z_m - ground.base_m, click_m)
        if spot is None:
            part = (
                ground.known_area([each[:2] for each in wanted.spots], click_m)
                if wanted.kind == "area"
                else None
            )
            return _partly_known(about, part, len(spots) + 1, calibration)
        spots.append(spot)
    if wanted.kind == "point":
        x_m, y_m, z_m = map(float, np.add(spots[0].point_m, (0.0, 0.0, ground.base_m)))
        return Measurement(
            *about, z_m, float(np.sqrt(spots[0].covariance[2, 2])), x_m=x_m, y_m=y_m, z_m=z_m
        )
    straight = straight_length(spots) if wanted.kind == "length" else planar_area(spots)
    measurement = Measurement(*about, straight.value, straight.total_std(calibration))
    on_ground, known = _on_ground(ground, wanted.kind, spots)
    if on_ground is None:
        return replace(measurement, note=NOT_ON_GROUND)
    volume = volume_above(ground, spots) if wanted.kind == "area" else None
    return replace(
        measurement,
        volume_l=volume.value if volume else None,
        volume_std_l=volume.total_std(calibration) if volume else None,
        surface=on_ground.value,
        surface_std=on_ground.total_std(calibration),
        known=known,
    )


def _on_ground(
    ground: Ground, kind: Kind, spots: Sequence[Spot]
) -> tuple[Measured | None, float | None]:
    if kind == "area":
        return ground.area(spots) or (None, None)
    return ground.length(spots), None


def _partly_known(
    about: tuple[str, str, Kind, str],
    part: tuple[Measured, float] | None,
    number: int,
    calibration: float,
) -> Measurement:
    """A measurement of which place ``number`` is not known; part: the area of the outline's known
    part, and the fraction it is.
    """
    what = f"place {number}: the surface is unknown there"
    if part is None or part[1] == 0:
        return Measurement(*about, None, None, note=what)
    area, known = part
    note = f"{what}; surface is that of the known part, {known:.0%} of the outline"
    return Measurement(
        *about, None, None, area.value, area.total_std(calibration), known=known, note=note
    )


def measured(surface: FrameSurface, wanted: Wanted, calibration: float) -> Measurement:
    """Measure one thing in a frame. calibration: its relative error of lengths."""
    about = (wanted.measure, wanted.frame, wanted.kind, wanted.label)
    picks: list[Pick] = []
    clicks_px = wanted.clicks_px or (0.0,) * len(wanted.places)
    width, height = surface.geometry.image_size
    for number, (place, click_px) in enumerate(zip(wanted.places, clicks_px, strict=True), 1):
        if not (-1 < place[0] < width and -1 < place[1] < height):
            note = f"place {number}: lies outside the corrected image of {width} x {height} pixels"
            return Measurement(*about, None, None, note=note)
        pick = surface.pick(*place, click_px)
        if pick is None:
            part = known_area(surface, wanted.places) if wanted.kind == "area" else None
            return _partly_known(about, part, number, calibration)
        if near_m := surface.nearer_m(pick):
            step = (
                f"place {number} lies at a step, {pick.point_m[2]:.2f} m away, next to an object "
                f"{near_m:.2f} m away"
            )
            return Measurement(
                *about,
                None,
                None,
                note=(
                    f"{step}: click inside the near object, or more than {STEP_PX} pixels away "
                    "from it"
                ),
            )
        picks.append(pick)
    if wanted.kind == "point":
        x_m, y_m, z_m = (float(value) for value in picks[0].point_m)
        value = range_of(picks[0])
        return Measurement(
            *about, value.value, value.total_std(calibration), x_m=x_m, y_m=y_m, z_m=z_m
        )
    known: float | None = None
    if wanted.kind == "length":
        straight, on_surface = (straight_length(picks), length_along(along_surface(surface, picks)))
    else:
        straight, (on_surface, known) = planar_area(picks), surface_area(surface, picks)
    stds = straight.total_std(calibration), on_surface.total_std(calibration)
    return Measurement(*about, straight.value, stds[0], on_surface.value, stds[1], known=known)


def read_wanted(path: Path) -> list[Wanted]:
    """Read a table of places, a CSV, in which rows with the same measure are one; or measures that
    the page saved (.json). Raises InputError, naming the line, if it is bad.
    """
    if path.suffix.lower() == ".json":
        return _of_page(read_kept_measures(path), path)
    names = csv_tables.header(path)
    places = (
        FRAME_COLUMNS if FRAME_COLUMNS[0] in names or MAP_COLUMNS[0] not in names else MAP_COLUMNS
    )
    found: dict[str, Wanted] = {}
    for where, row in csv_tables.rows(path, (*COLUMNS, *places)):
        each = _wanted(row, where)
        earlier = found.get(each.measure)
        if earlier and (earlier.frame, earlier.kind) != (each.frame, each.kind):
            raise InputError(
                f"{where}: measure {each.measure!r} has another frame or kind than before"
            )
        found[each.measure] = each if earlier is None else _joined(earlier, each)
    if not found:
        raise InputError(f"{path}: holds no rows below its header")
    for each in found.values():
        if len(each.places) + len(each.spots) < LEAST_POINTS[each.kind]:
            raise InputError(
                f"{path}: measure {each.measure!r}: {each.kind} needs at least "
                f"{LEAST_POINTS[each.kind]} places"
            )
        if each.kind == "area" and crosses_itself(
            np.array(each.places or [spot[:2] for spot in each.spots])
        ):
            raise InputError(
                f"{path}: measure {each.measure!r}: the outline crosses itself: give its corners "
                "in order around it"
            )
    return list(found.values())


def _of_page(kept: KeptMeasures, path: Path) -> list[Wanted]:
    """What to measure again of what the page saved. Raises InputError."""
    found = []
    for each in kept.measures:
        kind = next((kind for kind in LEAST_POINTS if kind == each.kind), None)
        if kind is None or len(each.points) < LEAST_POINTS[kind]:
            raise InputError(f"{path}: measure {each.id} is damaged: save it again on the page")
        about = str(each.id), each.frame, kind, each.label
        if each.frame:
            clicks_px = (LIMITS.click_std_px,) * len(each.places)
            found.append(Wanted(*about, tuple(each.places), clicks_px=clicks_px))
            continue
        world = np.array(each.points) + kept.offset_m
        spots = zip(*world.T.tolist(), each.clicks_m or (), strict=True)
        found.append(Wanted(*about, (), tuple(spots)))
    return found


def _joined(earlier: Wanted, later: Wanted) -> Wanted:
    return replace(
        earlier,
        places=(*earlier.places, *later.places),
        spots=(*earlier.spots, *later.spots),
        clicks_px=(*earlier.clicks_px, *later.clicks_px),
    )


def _wanted(row: dict[str, str], where: str) -> Wanted:
    """One row of the table, as a thing to measure with one place. Raises InputError."""
    kind = next((kind for kind in LEAST_POINTS if kind == row["kind"]), None)
    if kind is None:
        raise InputError(f"{where}: kind is {row['kind']!r}: give point, length or area")
    frame = row["frame"] or ""
    if frame:
        return Wanted(
            row["measure"],
            frame,
            kind,
            row["label"] or "",
            (_numbers(row, FRAME_COLUMNS, where),),
            clicks_px=(_click(row, "click_px", where),),
        )
    x_m, y_m = _numbers(row, MAP_COLUMNS, where)
    given = (row.get("z_m") or "nan").lower() != "nan"
    z_m = _number(row["z_m"], "z_m", where) if given else math.nan
    spot = x_m, y_m, z_m, _click(row, "click_m", where)
    return Wanted(row["measure"], frame, kind, row["label"] or "", (), (spot,))


def _numbers(row: dict[str, str], names: tuple[str, str], where: str) -> tuple[float, float]:
    x, y = (_number(row.get(name), name, where) for name in names)
    return x, y


def _click(row: dict[str, str], name: str, where: str) -> float:
    """The standard error of a click, 0 where the table has none."""
    given = row.get(name) or "nan"
    value = 0.0 if given.lower() == "nan" else _number(given, name, where)
    if value < 0:
        raise InputError(f"{where}: {name} is {given!r}: give a standard error, 0 or more")
    return value


def _number(text: str | None, name: str, where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: {name} is {text or ''!r}: give a number")
    return value
