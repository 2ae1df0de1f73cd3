"""``metrics``: reef structure of a fused run as ecologists publish it, with standard errors."""

from dataclasses import replace
from pathlib import Path

from stereo_seecolor.extras.reef.metrics.colony import measure_outlines
from stereo_seecolor.extras.reef.metrics.cover import cover
from stereo_seecolor.extras.reef.metrics.outline_files import read_outlines
from stereo_seecolor.extras.reef.metrics.structure import structure
from stereo_seecolor.extras.reef.metrics.tables import SiteMetrics, tables, write_tables
from stereo_seecolor.extras.reef.site.mesh import open_site
from stereo_seecolor.extras.reef.site.terrain import grid_of, terrain_of
from stereo_seecolor.extras.reef.site.terrain_errors import terrain_errors
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.new_folder import new_folder
from stereo_seecolor.mapping.raster.terrain import known_area_m2
from stereo_seecolor.report.height_code import height_std_m
from stereo_seecolor.run_folder.finished_run import open_run


def metrics(out: Path, polygons: Path | None = None, folder: Path | None = None) -> SiteMetrics:
    """Measure structure at several scales of the map in ``out``, and size and structure of each outline of ``polygons``.

    polygons: GeoJSON, or a project of TagLab. folder: new or empty, for the tables; None writes none.
    Raises InputError for a run without a map, or a polygon file that cannot be used; OutputError.
    """
    site = open_site(out)
    outlines, mesh = read_outlines(polygons, site.posed) if polygons else [], site.mesh
    terrain = terrain_of(mesh, grid_of(mesh, site.posed.map.cell_m["dem_m"]))
    errors = terrain_errors(site.posed, terrain)
    measured = measure_outlines(outlines, mesh, terrain, errors, height_std_m(open_run(out)) if outlines else 0.0)
    colonies = tuple(colony for colony in measured if colony is not None)
    seen_m2 = known_area_m2([terrain.height_m], terrain.grid.cell_m)
    result = SiteMetrics(
        structure=tuple(structure(mesh, terrain, errors)),
        colonies=colonies,
        cover=tuple(cover(colonies, seen_m2)),
        unseen=tuple(outline.name for outline, colony in zip(outlines, measured, strict=True) if colony is None),
        cell_m=terrain.grid.cell_m,
        area_m2=seen_m2,
        height_std_m=errors.median_m,
    )
    if folder is None:
        return result
    with new_folder(folder) as building:
        write_tables(building, tables(result))
    return replace(result, files=tuple(sorted(files_below(folder))))
