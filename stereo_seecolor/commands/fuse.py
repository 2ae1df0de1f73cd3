"""``fuse``: fuse the frames of a finished run into one map."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.errors import counted
from stereo_seecolor.commands.described_frames import describe_frames
from stereo_seecolor.compute.compiled import STAGE
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.process import return_freed
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.trajectories import given_trajectory, trajectory_files
from stereo_seecolor.progress import Both, Listener, Silence
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import MAP, state
from stereo_seecolor.run_folder.map_folder import FUSION, building_map
from stereo_seecolor.run_folder.run_progress import ProgressFile
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

if TYPE_CHECKING:
    from stereo_seecolor.mapping.survey_map import MapSummary


def check_fusion(poses: Path | None, config: RunConfig) -> tuple[Path, ...]:
    """Check libraries and trajectory before the first frame is measured. Returns the files to read.

    Raises DeviceError if a library cannot be loaded, with the command that fixes it; InputError for
    a bad trajectory.
    """
    from stereo_seecolor.mapping.survey_map import check

    check(config.mapping, given_trajectory(poses, config.mapping, np.eye(4)))
    tracks = [path for path in (poses, config.mapping.fixes) if path]
    return (*config.files, *(file for path in tracks for file in trajectory_files(path)))


def fuse(
    out: str | Path,
    poses: str | Path | None = None,
    config: RunConfig | None = None,
    listener: Listener | None = None,
    compute: Compute | None = None,
) -> "MapSummary":
    """Fuse a finished run into ``out``/map: cloud, mesh, trajectory and the chosen products.

    An earlier map is replaced when the new one is complete.

    Args:
        out: Folder of a finished run.
        poses: A trajectory of the left camera in any known format; without it the track is
            estimated from the frames.
        config: Settings; the run's own if not given.
        listener: Receives progress events; by default the log.
        compute: Where the work runs; all cores of this machine if not given.

    Returns:
        A summary of the map, with warnings; missing or damaged frames are named and left out.

    Raises:
        DeviceError: If a library is missing; before the first frame.
        InputError: If the run or the poses cannot be read.
        MappingError: If the track cannot be estimated, or the frames cannot be fused.
        OutputError: If the map cannot be written, or another process writes into ``out`` now.
    """
    from stereo_seecolor.mapping.survey_map import Workspace, build_map

    out, poses = Path(out), Path(poses) if poses else None
    run = open_run(out)
    config, compute = config or run.config, compute or Threads(cores())
    read = check_fusion(poses, config)
    SurveyFrames(run)  # refuses a run that cannot be fused before anything is written into it
    with RunFolder.existing(out, "fuse", read) as folder:
        run = open_run(out)
        stalled = set(run.stalled)
        frames = SurveyFrames(
            run, frames=[frame for frame in run.frames if frame.name not in stalled]
        )
        trajectory = given_trajectory(poses, config.mapping, frames.T_rectified_left)
        progress = _stages_of(Both(listener or Silence(), ProgressFile(folder.root)))
        with (
            compute.sharing(state(out), ()),
            building_map(folder, folder.dive.digest("corrected")) as building,
        ):
            workspace = Workspace(state(out, FUSION), progress, compute)
            summary = build_map(
                frames, frames.geometry, building, config.mapping, trajectory, workspace
            )
        return_freed()
        describe_frames(folder)
    warnings = (*summary.warnings, *_warnings(run, folder))
    return replace(summary.moved(building, out / MAP), warnings=warnings)


def _warnings(run: FinishedRun, folder: RunFolder) -> Iterator[str]:
    """What a user should know of the run and the folder of a map."""
    if run.stalled:
        yield (
            f"{counted(len(run.stalled), 'frame')} with an image of the previous frame, the first: "
            f"{run.stalled[0]}: a camera stalled, or files were copied: left out of track and map"
        )
    for path in folder.owned.set_aside:
        yield f"{path}: was in the earlier map, but this program did not write it; it is kept here"
    if run.state != "complete":
        yield "the run was stopped: pairs that it did not process are not in the map"


def _stages_of(listener: Listener) -> Callable[[str, int, int], None]:
    """A function that reports the stages of a map (stage, done, total) to a listener: with each
    stage that had to compile something before its first report, that it did.
    """
    from stereo_seecolor.compute.kernel_cache import compilations

    current, before = "", compilations()

    def progress(what: str, done: int, total: int) -> None:
        nonlocal current, before
        now = compilations()
        if what != current:
            return_freed()
            current = what
            listener.begin(f"{what} ({STAGE})" if now > before else what, total)
        before = now
        listener.advance(FrameRow(f"{done}"))

    return progress
