"""Rigid alignment of the map to surveyed places of markers; the scale is the rig's, and is checked, not fitted."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files import csv_table
from stereo_seecolor.geometry import rigid_alignment, transformed
from stereo_seecolor.mapping.markers.marker_map import PlacedMarker

Array = NDArray[np.float64]
FEWEST = 3
"""Points that fix a rigid motion; of just three the residuals say little."""


USUAL_STD_M = 0.01
"""Standard error of a surveyed place where the table states none, meters: tape and level by divers."""


@dataclass(frozen=True, eq=False)
class ControlFit:
    """T: (4, 4) from the map's world to that of the control points. residuals_m: by marker. rms_m: of them."""

    T: Array
    residuals_m: dict[int, float]
    rms_m: float


def read_control_points(path: Path) -> dict[int, Array]:
    """A CSV with marker, x_m, y_m, z_m: number -> (3,). Raises InputError, naming the line."""
    return {int(row[0]): row[1:] for row in _rows(path, ("marker", "x_m", "y_m", "z_m"))}


def read_stds(path: Path) -> dict[int, float]:
    """Standard errors of the control points, meters, by marker: of the column std_m, or the usual one. Raises InputError."""
    if "std_m" not in csv_table.header(path):
        return dict.fromkeys(read_control_points(path), USUAL_STD_M)
    return {int(row[0]): float(row[1]) for row in _rows(path, ("marker", "std_m"))}


def read_bars(path: Path) -> dict[tuple[int, int], float]:
    """A CSV with first, second, length_m of scale bars: numbers of the markers at both ends -> length. Raises InputError."""
    return {(int(row[0]), int(row[1])): float(row[2]) for row in _rows(path, ("first", "second", "length_m"))}


def control_fit(markers: Sequence[PlacedMarker], points: dict[int, Array]) -> ControlFit:
    """Fit the rigid motion of the map to the surveyed points. Raises InputError if fewer than three were found, or they lie in
    line.
    """
    found = [marker for marker in markers if marker.number in points]
    if len(found) < FEWEST:
        raise InputError(f"control points: {len(found)} of {len(points)} markers were found in two frames; needed: {FEWEST}")
    here, there = np.array([marker.place_m for marker in found]), np.array([points[marker.number] for marker in found])
    if np.linalg.svd(there - there.mean(axis=0), compute_uv=False)[1] < 1e-3 * np.ptp(there, axis=0).max():
        raise InputError("control points: those that were found lie in line, and the map can turn about it: give one beside it")
    T = rigid_alignment(here, there)
    off = np.linalg.norm(transformed(T, here) - there, axis=1)
    residuals = {marker.number: float(value) for marker, value in zip(found, off, strict=True)}
    return ControlFit(T, residuals, float(np.sqrt((off**2).mean())))


def _rows(path: Path, columns: tuple[str, ...]) -> list[Array]:
    found = []
    for where, row in csv_table.rows(path, columns):
        try:
            found.append(np.array([float(row[name]) for name in columns]))
        except (TypeError, ValueError) as error:
            raise InputError(f"{where}: {error}: give numbers in {', '.join(columns)}") from error
    return found
