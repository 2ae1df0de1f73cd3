"""Records beside a map: its track, its frames' poses with their errors, and its coordinates."""

import csv
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.files.atomic import atomic_path, write_atomic
from stereo_seecolor.files.csv_tables import guard_formula
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.placing import PlacedSurvey
from stereo_seecolor.mapping.raster.georeference import Georeference, crs_name
from stereo_seecolor.records import Trajectory


def write_track(path: Path, component: Component) -> Path:
    """Write the component's poses in the world as a TUM trajectory. Raises OutputError."""
    index, chosen = component.survey.index, component.frames
    T = component.T_local_camera[chosen].copy()
    T[:, :3, 3] += component.offset_m
    times = np.where(np.isfinite(index.timestamps_s[chosen]), index.timestamps_s[chosen], chosen)
    write_tum(path, Trajectory(tuple(index.names[i] for i in chosen), times, T))
    return path


def write_poses(path: Path, component: Component, placed: PlacedSurvey) -> Path:
    """Write poses.csv: each frame's position, the residual of the pose that was given for it, and
    standard errors. Raises OutputError.
    """
    index, placement = component.survey.index, placed.placement
    unknown = np.full(len(index.names), np.nan)
    columns = {
        "position_residual_m": placed.position_residual_m,
        "attitude_residual_deg": placed.attitude_residual_deg,
        "position_std_m": unknown if placement.position_std_m is None else placement.position_std_m,
        "attitude_std_deg": unknown
        if placement.attitude_std_deg is None
        else placement.attitude_std_deg,
    }
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "timestamp_s", "x_m", "y_m", "z_m", *columns])
        for i in component.frames:
            position = component.T_local_camera[i, :3, 3] + component.offset_m
            values = (index.timestamps_s[i], *position, *(column[i] for column in columns.values()))
            numbers = [f"{value:.4f}" if np.isfinite(value) else "" for value in values]
            writer.writerow([guard_formula(index.names[i]), *numbers])
    return path


def write_description(
    path: Path,
    place: Georeference,
    config: MappingConfig,
    range_scale: float,
    shown: Mapping[str, float],
) -> Path:
    """Write map.json: the place of the map's local coordinates, what it shows (the planar area, and
    the part of the measured ground that is missing), the sizes of its voxels and cells, the factor
    on all ranges, the engine that fused it.
    """
    content = {
        "format": "stereo-seecolor/map",
        "offset_m": place.offset_m.tolist(),
        "origin": asdict(place.origin) if place.origin else None,
        "crs": crs_name(place.origin),
        **shown,
        "range_scale": range_scale,
        "engine": config.engine,
        "voxel_m": config.voxel_edge_m,
        "dem_m": config.terrain_cell_m,
        "mosaic_m": config.mosaic_cell_m,
        "metrics_m": config.square_m,
    }
    write_atomic(path, (json.dumps(content, indent=2) + "\n").encode())
    return path


def comment(place: Georeference) -> str:
    """The comment of the map's PLY files: units, axes, coordinate system, offset."""
    lines = ["stereo-seecolor, meters: x east, y north, z up", f"crs {crs_name(place.origin)}"]
    if place.offset_m.any():
        lines.append(
            "offset "
            + " ".join(f"{value:.3f}" for value in place.offset_m)
            + ": add it to get world coordinates"
        )
    return "\n".join(lines)
