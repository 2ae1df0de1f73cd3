"""``fuse``: fuse the frames of a finished run into one map."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.wording import counted
from stereo_seecolor.commands.placed_frames import describe_frames
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.trajectories import given_trajectory, trajectory_file
from stereo_seecolor.progress import Both, Listener, Silence
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import MAP, state
from stereo_seecolor.run_folder.map_folder import building_map, fusion_folder
from stereo_seecolor.run_folder.progress_file import ProgressFile
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

if TYPE_CHECKING:
    from stereo_seecolor.mapping.survey_map import MapSummary


def check_fusion(poses: Path | None, config: RunConfig) -> tuple[Path, ...]:
    """Check libraries and trajectory before the first frame is measured. Returns the files that a fusion reads.

    Raises DeviceError if a library cannot be loaded, with the command that fixes it; InputError for a bad trajectory.
    """
    from stereo_seecolor.mapping.survey_map import check

    check(config.mapping, given_trajectory(poses, config.mapping, np.eye(4)))
    return (*config.files, *(trajectory_file(path) for path in (poses, config.mapping.fixes) if path))


def fuse(
    out: Path,
    poses: Path | None = None,
    config: RunConfig | None = None,
    listener: Listener | None = None,
    compute: Compute | None = None,
) -> "MapSummary":
    """Fuse a finished run into ``out``/map: cloud, mesh, trajectory and whatever else the config asks for.

    poses: a trajectory of the left camera in any known format; without it the program finds the track itself.
    config: the settings; the run's own if not given. compute: where the work runs; all cores of this machine if not given.
    Raises DeviceError, before the first frame, if a library is missing; InputError; MappingError; OutputError, also where another
    run or fusion writes into ``out`` now. A frame that is gone or damaged is named, and the rest fused. An earlier map is replaced
    when the new one is complete, and stays as it is otherwise.
    """
    from stereo_seecolor.mapping.survey_map import Workspace, build_map

    run = open_run(out)
    config, compute = config or run.config, compute or Threads(cores())
    read = check_fusion(poses, config)
    SurveyFrames(run)  # refuses a run that cannot be fused before anything is written into it
    with RunFolder.existing(out, "fuse", read) as folder:
        run = open_run(out)
        stalled = set(run.stalled)
        frames = SurveyFrames(run, frames=[frame for frame in run.frames if frame.name not in stalled])
        trajectory = given_trajectory(poses, config.mapping, frames.T_rectified_left)
        progress = _stages_of(Both(listener or Silence(), ProgressFile(folder.root)))
        with compute.sharing(state(out), ()), building_map(folder, folder.dive.digest("corrected")) as building:
            workspace = Workspace(fusion_folder(out), progress, compute)
            summary = build_map(frames, frames.geometry, building, config.mapping, trajectory, workspace)
        describe_frames(folder)
    aside = tuple(f"{path}: was in the earlier map and is not of this program; it is kept here" for path in folder.owned.set_aside)
    stopped = () if run.state == "complete" else ("the run was stopped: pairs that it did not come to are not in the map",)
    warnings = (*summary.warnings, *_stall_warning(run.stalled), *aside, *stopped)
    return replace(summary.moved(building, out / MAP), warnings=warnings)


def _stall_warning(stalled: Sequence[str]) -> tuple[str, ...]:
    if not stalled:
        return ()
    what = f"{counted(len(stalled), 'frame')} with an image of the frame before, the first: {stalled[0]}"
    return (f"{what}: a camera stalled, or files were copied: left out of track and map",)


def _stages_of(listener: Listener) -> Callable[[str, int, int], None]:
    """A function that reports the stages of a map (stage, done, total) to a listener."""
    current = ""

    def progress(what: str, done: int, total: int) -> None:
        nonlocal current
        if what != current:
            current = what
            listener.begin(what, total)
        listener.advance(FrameRow(f"{done}"))

    return progress
