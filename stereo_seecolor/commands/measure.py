"""``measure``: points, lengths and areas in the frames of a finished run, from a table of places in its images."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.reading import read_bytes
from stereo_seecolor.geometry import estimated_range_std_m
from stereo_seecolor.measuring.measures import (
    Measured,
    along_surface,
    planar_area,
    range_of,
    straight_length,
    surface_area,
)
from stereo_seecolor.measuring.picking import Pick, Surface
from stereo_seecolor.report.range_code import std_codes, std_from_codes
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run

Kind = Literal["point", "length", "area"]
LEAST_POINTS: dict[Kind, int] = {"point": 1, "length": 2, "area": 3}
COLUMNS = ("measure", "frame", "kind", "label", "x_px", "y_px")


@dataclass(frozen=True)
class Wanted:
    """What to measure: places (x, y) in pixels of the rectified left image of a frame."""

    measure: str
    frame: str
    kind: Kind
    label: str
    places: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Measurement:
    """What was measured; None where the surface is not known at one of the places.

    value, std: range, straight length or planar area, with its standard error, meters or square meters. surface, surface_std: the
    length or area along the surface, None for a point. x_m, y_m, z_m: of a point, rectified left camera.
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


def measure(out: Path, points: Path) -> list[Measurement]:
    """Measure what a table asks for: columns measure, frame, kind (point, length or area), label, x_px, y_px; a row for each place.

    Rows with the same measure belong together, in their order. The page writes such tables, and gives the same numbers.
    Raises InputError if the table cannot be used, or the run knows no camera or not the frame.
    """
    run = open_run(out)
    wanted = read_wanted(points)
    surfaces: dict[str, Surface] = {}
    results = []
    for each in wanted:
        if each.frame not in surfaces:
            surfaces = {each.frame: surface_of(run, each.frame)}  # tables are sorted by frame: one is kept
        results.append(measured(surfaces[each.frame], each))
    return results


def surface_of(run: FinishedRun, name: str) -> Surface:
    """The surface that a frame of a run shows. Raises InputError if the run knows no camera, or not the frame."""
    if run.geometry is None:
        raise InputError(f"{run.root}: the run knows no camera (made by correct?): measuring needs the output of run")
    frame = run.frame(name)
    range_m = frame.measured_range_m()
    if "range_std" in frame.products:
        std_m = np.where(np.isfinite(range_m), frame.read("range_std"), np.float32(np.nan))
    else:
        std_m = estimated_range_std_m(range_m, run.geometry)
    return Surface(run.geometry, range_m, std_from_codes(std_codes(std_m)))  # as the page holds them


def measured(surface: Surface, wanted: Wanted) -> Measurement:
    """Measure one thing on a surface."""
    found = [surface.pick(x_px, y_px) for x_px, y_px in wanted.places]
    picks = [pick for pick in found if pick is not None]
    about = (wanted.measure, wanted.frame, wanted.kind, wanted.label)
    if len(picks) < len(found):
        return Measurement(*about, None, None)
    if wanted.kind == "point":
        x_m, y_m, z_m = (float(value) for value in picks[0].point_m)
        value = range_of(picks[0])
        return Measurement(*about, value.value, value.total_std, x_m=x_m, y_m=y_m, z_m=z_m)
    straight, on_surface = _length(surface, picks) if wanted.kind == "length" else _area(surface, picks)
    return Measurement(*about, straight.value, straight.total_std, on_surface.value, on_surface.total_std)


def _length(surface: Surface, picks: Sequence[Pick]) -> tuple[Measured, Measured]:
    return straight_length(picks), straight_length(along_surface(surface, picks))


def _area(surface: Surface, picks: Sequence[Pick]) -> tuple[Measured, Measured]:
    return planar_area(picks), surface_area(surface, picks)[0]


def read_wanted(path: Path) -> list[Wanted]:
    """The table of places. Raises InputError, naming the line, if it cannot be used."""
    table = csv.DictReader(io.StringIO(read_bytes(path).decode("utf-8-sig", errors="replace")))
    missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
    if missing:
        raise InputError(f"{path}: has no column {missing[0]!r}: give the columns {', '.join(COLUMNS)}")
    found: dict[str, Wanted] = {}
    for number, row in enumerate(table, start=2):
        each = _wanted(row, f"{path}: line {number}")
        earlier = found.get(each.measure)
        if earlier and (earlier.frame, earlier.kind) != (each.frame, each.kind):
            raise InputError(f"{path}: line {number}: measure {each.measure!r} has another frame or kind than before")
        found[each.measure] = each if earlier is None else _joined(earlier, each)
    for each in found.values():
        if len(each.places) < LEAST_POINTS[each.kind]:
            raise InputError(f"{path}: measure {each.measure!r}: {each.kind} needs at least {LEAST_POINTS[each.kind]} places")
    return list(found.values())


def _joined(earlier: Wanted, later: Wanted) -> Wanted:
    return Wanted(earlier.measure, earlier.frame, earlier.kind, earlier.label, (*earlier.places, *later.places))


def _wanted(row: dict[str, str], where: str) -> Wanted:
    kind = next((kind for kind in LEAST_POINTS if kind == row["kind"]), None)
    if kind is None:
        raise InputError(f"{where}: kind is {row['kind']!r}: give point, length or area")
    try:
        place = float(row["x_px"]), float(row["y_px"])
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: x_px and y_px must be numbers: {error}") from error
    return Wanted(row["measure"], row["frame"], kind, row["label"] or "", (place,))
