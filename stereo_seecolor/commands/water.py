"""Measure the water of a finished run from places that several of its frames see, for another run with ``--water``."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.multiview import fit_sightings, with_white_of
from stereo_seecolor.color.photometry.sightings import KeyFrame, find_sightings
from stereo_seecolor.commands.raw_images import RawImages
from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import rectified_trajectory
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.track.placement import place
from stereo_seecolor.records import Water
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import MEASURED_WATER
from stereo_seecolor.run_folder.survey_frames import SurveyFrames
from stereo_seecolor.run_folder.water_file import read_waters, waters_content


@dataclass(frozen=True, eq=False)
class MeasuredWater:
    """The water, and the file that ``--water`` of another run takes."""

    path: Path
    water: Water


def measure_water(out: Path, poses: Path, config: RunConfig | None = None) -> MeasuredWater:
    """Write OUT/water_measured.json: attenuation and backscatter from places seen at two ranges, the white point as fitted before.

    out: a run with color.lock=survey. poses: a trajectory of the left camera in any known format.
    Raises InputError, MappingError, ColorError where the run, the poses or the overlap cannot carry it.
    """
    run = open_run(out)
    config = config or run.config
    frames = SurveyFrames(run)
    index = FrameIndex.build(frames, frames.geometry)
    trajectory = rectified_trajectory(poses, config.mapping, frames.T_rectified_left)
    placed = place(index, trajectory, config.mapping)
    waters = read_waters(run.water_file, list(index.names))
    if len({tuple(water.white) for water in waters.values()}) > 1:
        raise InputError(f"{run.water_file}: holds a water for each frame: run again with --set color.lock=survey")
    scene = waters[index.names[0]]
    key_frames = _KeyFrames(run, frames, placed.T_world_camera)
    sightings = find_sightings(key_frames, frames.geometry, scene.input_encoding)
    water = with_white_of(fit_sightings(sightings, scene.input_encoding), scene, sightings)
    with RunFolder.existing(out, (poses,)) as folder:
        folder.write(MEASURED_WATER, waters_content({"survey": water}), made_from=folder.digest("range"))
    return MeasuredWater(out / MEASURED_WATER, water)


class _KeyFrames(Lazy[KeyFrame]):
    """The placed frames of a run, as the camera saw them and rectified, read when asked for."""

    def __init__(self, run: FinishedRun, frames: SurveyFrames, poses: NDArray[np.float64]) -> None:
        self._raw, self._frames, self._poses = RawImages(run), frames, poses
        self._placed = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))

    def __len__(self) -> int:
        return len(self._placed)

    def item(self, number: int) -> KeyFrame:
        """A frame, raw and rectified."""
        placed = int(self._placed[number])
        frame = self._frames[placed]
        return KeyFrame(self._raw.rectified(frame.name), frame.range_m, self._poses[placed])
