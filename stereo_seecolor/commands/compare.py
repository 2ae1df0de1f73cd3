"""``compare``: what changed between two fused runs of one site."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.comparing.change_files import write_change
from stereo_seecolor.comparing.registration import Surveyed
from stereo_seecolor.comparing.site_change import SiteChange, compare_sites
from stereo_seecolor.errors import InputError
from stereo_seecolor.export.posed_run import open_posed_run
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.new_folder import new_folder, refuse_filled
from stereo_seecolor.mapping.raster.georeference import Georeference
from stereo_seecolor.report.change_page import write_change_page
from stereo_seecolor.run_folder.finished_map import open_map
from stereo_seecolor.site.mesh import read_mesh


@dataclass(frozen=True, eq=False)
class Comparison:
    """What changed, and the files that say so."""

    change: SiteChange
    files: tuple[Path, ...]


def compare(first: Path, second: Path, folder: Path | None = None) -> Comparison:
    """Register the map in ``second`` to that in ``first``, and find what rose, sank or changed its color.

    folder: new or empty, for page, rasters, table and picture; None writes none. Both runs are left as they are.
    Raises InputError for a run without a map; ComparingError, with the evidence, if the maps cannot be compared; OutputError.
    """
    if folder:
        refuse_filled(folder)
    a, b = _open(first), _open(second)
    change = compare_sites(a, b, max(_cell_m(first), _cell_m(second)))
    if folder is None:
        return Comparison(change, ())
    with new_folder(folder) as building:
        write_change(building, change, Georeference(a.posed.offset_m, a.posed.origin))
        shutil.rmtree(building / ".scratch", ignore_errors=True)
        write_change_page(building, change, *_names(first.resolve(), second.resolve()))
    return Comparison(change, tuple(sorted(files_below(folder))))


def _names(first: Path, second: Path) -> tuple[str, str]:
    """With their folders' names where both are called the same."""
    if first.name != second.name:
        return first.name, second.name
    return f"{first.parent.name}/{first.name}", f"{second.parent.name}/{second.name}"


def _open(out: Path) -> Surveyed:
    posed = open_posed_run(out)
    mesh, made = read_mesh(out), open_map(out)
    if not len(mesh.triangles) or made is None:
        raise InputError(f"{out}: its map is empty: fuse it again with more frames or a larger mapping.voxel_m")
    return Surveyed(posed, mesh, made.cell_m["voxel_m"])


def _cell_m(out: Path) -> float:
    made = open_map(out)
    assert made is not None, "it was opened before"
    return made.cell_m["dem_m"]
