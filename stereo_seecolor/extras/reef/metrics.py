"""``metrics``: reef structure of a fused run as ecologists publish it, with standard errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.colony import measure_outlines
from stereo_seecolor.extras.reef.compare import CLICK_PX
from stereo_seecolor.extras.reef.cover import cover
from stereo_seecolor.extras.reef.labelled_points import on_map, point_cover, read_points
from stereo_seecolor.extras.reef.metric_tables import SiteMetrics, tables, write_tables
from stereo_seecolor.extras.reef.outline_files import read_outlines
from stereo_seecolor.extras.reef.outlines import refuse_elsewhere
from stereo_seecolor.extras.reef.site_surface import open_site
from stereo_seecolor.extras.reef.terrain_of_mesh import grid_of, terrain_errors, terrain_of
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.free_places import new_folder
from stereo_seecolor.mapping.raster.height_errors import height_stds
from stereo_seecolor.mapping.raster.structure import structure
from stereo_seecolor.mapping.raster.terrain import known_area_m2
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.report.height_code import height_std_m as typical_std_m
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.own_paths import refuse_own_place


def metrics(
    out: Path, polygons: Path | None = None, folder: Path | None = None, points: Path | None = None
) -> SiteMetrics:
    """Measure structure at several scales of the map in ``out``, size and structure of each outline
    of ``polygons``, and the cover by ``points``.

    polygons: GeoJSON, or a project of TagLab. points: annotations of CoralNet (CSV).
    folder: new or empty, for the tables; None writes none.
    Raises InputError for a run without a map, or a file of polygons or points that cannot be used;
    OutputError.
    """
    if folder:
        refuse_own_place(folder)
    site = open_site(out)
    labelled = read_points(points, site.posed) if points else []
    outlines, mesh = read_outlines(polygons, site.posed) if polygons else [], site.mesh
    terrain = terrain_of(mesh, grid_of(mesh, site.posed.map.cell_m["dem_m"]))
    refuse_elsewhere(outlines, terrain.grid, site.posed.offset_m)
    errors = terrain_errors(site.posed, terrain)
    run = open_run(out)
    range_std_m, calibration = typical_std_m(run), calibration_std(run).total
    measured = measure_outlines(
        outlines,
        mesh,
        terrain,
        errors,
        range_std_m,
        CLICK_PX * site.posed.map.cell_m["mosaic_m"],
        calibration,
        site.posed.correlation_m,
    )
    colonies = tuple(colony for colony in measured if colony is not None)
    seen = on_map(labelled, terrain.height_m, terrain.grid)
    seen_m2 = known_area_m2([terrain.height_m], terrain.grid.cell_m)
    result = SiteMetrics(
        structure=tuple(
            each.with_calibration(calibration)
            for each in structure(terrain, errors, mesh_m2=mesh.area_over)
        ),
        colonies=colonies,
        cover=tuple(cover(colonies, seen_m2)),
        unseen=tuple(
            outline.name
            for outline, colony in zip(outlines, measured, strict=True)
            if colony is None
        ),
        cell_m=terrain.grid.cell_m,
        area_m2=seen_m2,
        height_std_m=_median(height_stds(terrain.height_m)[terrain.known]),
        point_cover=tuple(point_cover(seen)),
        unseen_points=len(labelled) - len(seen),
        note=site.posed.left_out,
    )
    if folder is None:
        return result
    with new_folder(folder) as building:
        write_tables(building, tables(result))
    return replace(result, files=tuple(sorted(files_below(folder))))


def _median(values: NDArray[np.float64]) -> float:
    """Of the known ones; NaN where none is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
