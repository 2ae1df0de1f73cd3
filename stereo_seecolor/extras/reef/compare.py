"""``compare``: what changed between two fused runs of one site."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.errors import ComparingError, InputError
from stereo_seecolor.extras.reef.comparing.change_files import write_change
from stereo_seecolor.extras.reef.comparing.change_page import write_change_page
from stereo_seecolor.extras.reef.comparing.joint_track import JointTrack, joint_track
from stereo_seecolor.extras.reef.comparing.positions import position_note
from stereo_seecolor.extras.reef.comparing.site_change import SiteChange, compare_sites
from stereo_seecolor.extras.reef.site_surface import Site, open_site
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.free_places import new_folder, refuse_filled
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.mapping.raster.georeference import Georeference
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.own_paths import refuse_own_place

SECOND_TRACK = "second_track.tum"
ALIKE_VOXELS = 1.1
"""Voxels of 1 and 2 cm make changes of 5 to 8 standard errors out of one dive."""
CLICK_PX = 0.5
"""Of the mosaic: how well a person hits the corner of an outline there."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """The change of a site. files: written to the folder. joint: the second track, solved in one
    graph with the first, if asked. position_note: on places on Earth that contradict each other,
    else "".
    """

    change: SiteChange
    files: tuple[Path, ...]
    joint: JointTrack | None = None
    position_note: str = ""

    @property
    def is_wrong(self) -> bool:
        """Whether lengths of one survey are wrong, or its place on Earth."""
        return self.change.registration.is_wrong or bool(self.position_note)


def compare(
    first: Path, second: Path, folder: Path | None = None, joint: bool = False
) -> Comparison:
    """Register the map in ``second`` to that in ``first``, and find where the bottom rose, sank or
    changed its color.

    folder: new or empty, for page, rasters, table and picture; None writes none. Both runs are left
    as they are.
    joint: also solve the second's track in one graph with the first's, to fuse it again with; needs
    a folder.
    Raises InputError for a run without a map; ComparingError, with the evidence, if the maps cannot
    be compared; OutputError; DeviceError if GTSAM is missing for ``joint``.
    """
    if folder:
        refuse_filled(folder)
        refuse_own_place(folder)
    elif joint:
        raise InputError(
            "--joint writes the track of the second dive: give --out, a new or empty folder"
        )
    a, b = open_site(first), open_site(second)
    cell_m = max(site.posed.map.cell_m["dem_m"] for site in (a, b))
    change = compare_sites(a, b, cell_m, calibration_std(open_run(first)).total)
    _refuse_other_voxels(a, b)  # of one site
    note = position_note(a.posed, b.posed, change.registration.T_a_b)
    if folder is None:
        return Comparison(change, (), position_note=note)
    track = joint_track(a, b, change.registration, Threads(cores())) if joint else None
    with new_folder(folder) as building:
        if track:
            write_tum(building / SECOND_TRACK, track.trajectory)
        write_change(building, change, Georeference(a.posed.offset_m, a.posed.origin))
        shutil.rmtree(building / ".scratch", ignore_errors=True)
        write_change_page(building, change, *_names(first.resolve(), second.resolve()), note)
    return Comparison(change, tuple(sorted(files_below(folder))), track, note)


def _refuse_other_voxels(*sites: Site) -> None:
    """Raise ComparingError for other voxels: what the coarser smooths would be growth and loss."""
    fine, coarse = sorted(sites, key=lambda site: site.posed.voxel_m)
    if coarse.posed.voxel_m > ALIKE_VOXELS * fine.posed.voxel_m:
        out, edge_m = fine.posed.run.root, coarse.posed.voxel_m
        raise ComparingError(
            f"{out} was fused with voxels of {1000 * fine.posed.voxel_m:g} mm, "
            f"{coarse.posed.run.root} with {1000 * edge_m:g} mm: what the larger ones smooth would "
            f"be change: stereo-seecolor fuse {quote(str(out))} --set mapping.voxel_m={edge_m:g}"
        )


def _names(first: Path, second: Path) -> tuple[str, str]:
    """The names of the two runs on the page, with their parent folders' where both are the same."""
    if first.name != second.name:
        return first.name, second.name
    return f"{first.parent.name}/{first.name}", f"{second.parent.name}/{second.name}"
