"""Measure the water of a finished run from places that several of its frames see, for another run with ``--water``."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor.color.photometry.multiview import fit_sightings, with_white_of
from stereo_seecolor.color.photometry.sightings import KeyFrame, find_sightings
from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.trajectories import rectified_trajectory
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.track.placement import place
from stereo_seecolor.records import Image, Water
from stereo_seecolor.run_folder.survey_frames import SurveyFrames
from stereo_seecolor.run_folder.water_file import read_waters, write_waters


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
    config = config or RunConfig()
    frames = SurveyFrames(out)
    index = FrameIndex.build(frames, frames.pair)
    trajectory = rectified_trajectory(poses, config.mapping, frames.T_rectified_left)
    placed = place(index, trajectory, config.mapping)
    waters = read_waters(out / "water.json", list(index.names))
    if len({tuple(water.white) for water in waters.values()}) > 1:
        raise InputError(f"{out / 'water.json'}: holds a water for each frame: run again with --set color.lock=survey")
    scene = waters[index.names[0]]
    key_frames = _KeyFrames(out, frames, placed.T_world_camera, config)
    sightings = find_sightings(key_frames, frames.pair, scene.input_encoding)
    water = with_white_of(fit_sightings(sightings, scene.input_encoding), scene, sightings)
    path = out / "water_measured.json"
    write_waters(path, {"survey": water})
    return MeasuredWater(path, water)


class _KeyFrames(Lazy[KeyFrame]):
    """The placed frames of a run, raw and rectified, read when asked for."""

    def __init__(self, out: Path, frames: SurveyFrames, poses: NDArray[np.float64], config: RunConfig) -> None:
        self._frames, self._poses, self._config = frames, poses, config
        self._placed = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
        calib = json.loads((out / "run.json").read_bytes())["inputs"]["calib"]
        self._rectification = Rectification.from_rig(load_rig(calib, frames.pair.image_size))
        rows = csv.DictReader((out / "frames.csv").read_text(encoding="utf-8").splitlines())
        self._left = {row["name"]: Path(row["left"]) for row in rows}

    def __len__(self) -> int:
        return len(self._placed)

    def item(self, number: int) -> KeyFrame:
        """A frame, raw and rectified."""
        placed = int(self._placed[number])
        frame = self._frames[placed]
        image: Image = self._rectification.apply_left(read_image(self._left[frame.name], self._config.input))
        return KeyFrame(image, frame.range_m, self._poses[placed])
