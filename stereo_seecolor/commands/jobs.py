"""What the commands do: each the same stages, entered at another point."""

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration import Rectification, StereoRig
from calibration.checks import suspicions
from calibration.formats import load_rig, write_rig
from stereo_seecolor.commands.sources import RangedSource, StereoSource
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair, Pairing, pair_by_stem, pair_folders
from stereo_seecolor.inputs.video import is_video, unpack
from stereo_seecolor.pipeline import Pipeline, Survey
from stereo_seecolor.progress import Listener, RunOptions, Silence
from stereo_seecolor.run_folder.folder import RUN_FORMAT, STATE, RunFolder, content_key, held
from stereo_seecolor.run_folder.frames_table import FrameRow, RunSummary, frames_csv
from stereo_seecolor.run_folder.survey_frames import SurveyFrames
from stereo_seecolor.run_folder.water_file import read_waters, write_waters
from stereo_seecolor.version import __version__

if TYPE_CHECKING:
    from stereo_seecolor.mapping.survey_map import MapSummary


def run(
    left: Path,
    right: Path,
    calib: str | Path,
    out: Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
    *,
    water: Path | None = None,
    ranges_only: bool = False,
) -> RunSummary:
    """Stereo pairs in; range maps, true-color frames, clouds and tables out, in ``out``.

    left, right: folders of images, or one video a side, or twice the same video that shows both side by side.
    calib: any calibration that load_rig reads. water: the water.json of an earlier dive, to be used instead of a fit.
    ranges_only: stop after the range maps.
    Raises SeeColorError or CalibrationError for what concerns the whole dive; a bad pair is named in the summary's rows.
    """
    config, options = config or RunConfig(), options or RunOptions()
    identity = content_key("stereo", str(left.resolve()), str(right.resolve()))
    pairing, pipeline = _open(left, right, calib, out, config)
    with RunFolder(out, identity, config.output.image_format, options.overwrite) as folder:
        source = StereoSource(pipeline, folder)
        job = _Job(folder, Survey(source, config, folder, options), pairing, config)
        job.inputs = {"left": str(left), "right": str(right), "calib": str(calib)}
        job.rectification = pipeline.rectification
        if ranges_only:
            return job.go(lambda survey: survey.match(pairing.pairs))
        return job.go(lambda survey: _color(survey, config, folder, pairing.pairs, water))


def correct(
    images: Path,
    ranges: Path,
    out: Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
    *,
    water: Path | None = None,
) -> RunSummary:
    """Color alone: images and their range maps (float32 TIFF in meters or 16-bit PNG in millimeters) in, corrected images out."""
    config, options = config or RunConfig(), options or RunOptions()
    pairing = pair_by_stem(images, ranges)
    identity = content_key("ranged", str(images.resolve()), str(ranges.resolve()))
    with RunFolder(out, identity, config.output.image_format, options.overwrite) as folder:
        survey = Survey(RangedSource(config), config, folder, options)
        job = _Job(folder, survey, pairing, config)
        job.inputs = {"images": str(images), "range": str(ranges)}
        return job.go(lambda survey: _color(survey, config, folder, pairing.pairs, water))


def rectify(
    left: Path, right: Path, calib: str | Path, out: Path, config: RunConfig | None = None, options: RunOptions | None = None
) -> RunSummary:
    """Rectified pairs as PNG in ``rectified_left`` and ``rectified_right``; ``rectified.yaml``, the calibration they have now."""
    config, options = config or RunConfig(), options or RunOptions()
    pairing, pipeline = _open(left, right, calib, out, config)
    with RunFolder(out, content_key("rectify", str(left.resolve()), str(right.resolve())), overwrite=options.overwrite) as folder:
        source = StereoSource(pipeline, folder)
        job = _Job(folder, Survey(source, config, folder, options), pairing, config)
        job.inputs = {"left": str(left), "right": str(right), "calib": str(calib)}
        job.rectification = pipeline.rectification
        write_rig(pipeline.rectification.rectified_rig(), folder.root / "rectified.yaml")
        return job.go(lambda survey: survey.each("rectified", pairing.pairs, source.write_rectified))


def check_fusion(poses: Path | None, config: RunConfig) -> None:
    """Look at all that fusion needs before the first frame: the library, and the trajectory.

    Raises DeviceError if a library is missing, with the command that installs it; InputError for a bad trajectory.
    """
    from stereo_seecolor.inputs.trajectories import read_trajectory
    from stereo_seecolor.mapping.survey_map import check

    check(config.mapping, poses is not None)
    if poses:
        read_trajectory(poses, config.mapping.mount)


def fuse(out: Path, poses: Path | None = None, config: RunConfig | None = None, listener: Listener | None = None) -> "MapSummary":
    """Fuse a finished run into ``out``/map: cloud, mesh, trajectory and whatever else the config asks for.

    poses: a trajectory of the left camera in any known format; without it the program finds the track itself.
    Raises DeviceError, before the first frame, if Open3D is missing; InputError; MappingError; OutputError,
    also where another run or fusion writes into ``out`` now. A frame that is gone or damaged is named, and the rest fused.
    """
    from stereo_seecolor.inputs.trajectories import rectified_trajectory
    from stereo_seecolor.mapping.survey_map import Workspace, build_map

    config = config or RunConfig()
    check_fusion(poses, config)
    SurveyFrames(out)  # refuses what is no run's folder before anything is written into it
    with held(out):
        frames = SurveyFrames(out)
        trajectory = rectified_trajectory(poses, config.mapping, frames.T_rectified_left) if poses else None
        building, tiles = out / STATE / "map", out / STATE / "tiles"
        shutil.rmtree(building, ignore_errors=True)
        workspace = Workspace(tiles, _stages_of(listener or Silence()))
        summary = build_map(frames, frames.pair, building, config.mapping, trajectory, workspace)
        shutil.rmtree(out / "map", ignore_errors=True)
        building.rename(out / "map")
        return summary.moved(building, out / "map")


def _stages_of(listener: Listener) -> Callable[[str, int, int], None]:
    """A listener to passes over pairs, listening to the stages of a map."""
    current = ""

    def progress(what: str, done: int, total: int) -> None:
        nonlocal current
        if what != current:
            current = what
            listener.begin(what, total)
        listener.advance(FrameRow(f"{done}"))

    return progress


def _open(left: Path, right: Path, calib: str | Path, out: Path, config: RunConfig) -> tuple[Pairing, Pipeline]:
    """The pairs of two folders, or of videos, whose frames are unpacked into ``out`` first; and the pipeline for their rig.

    What looks wrong with the rig, though it can be used, is added to the pairing's notes.
    """
    if is_video(left) and is_video(right):
        left, right = unpack(left, right, out / STATE / "frames", config.input.video_every)
    pairing = pair_folders(left, right, config.input)
    rig = load_rig_for(calib, pairing, config)
    notes = pairing.notes + tuple(f"calibration: {suspicion}" for suspicion in suspicions(rig))
    return replace(pairing, notes=notes), Pipeline(rig, config)


def load_rig_for(calib: str | Path, pairing: Pairing, config: RunConfig) -> StereoRig:
    """The rig, for images as large as the first that can be read (some calibration files do not say)."""
    problems = []
    for pair in pairing.pairs:
        try:
            height, width = read_image(pair.left, config.input).shape[:2]
        except InputError as error:
            problems.append(str(error))
            continue
        return load_rig(calib, (width, height))
    raise InputError(f"none of the {len(problems)} left images can be read; the first: {problems[0]}")


def _color(survey: Survey, config: RunConfig, folder: RunFolder, pairs: Sequence[Pair], water: Path | None) -> None:
    """Both passes; only the second where the water is known already. Before them, if asked, the rig's own lights are learned."""
    if config.color.lights == "learn":
        survey.learn_light(pairs)
    waters = read_waters(water, [pair.name for pair in pairs]) if water else survey.fit(pairs)
    if waters:
        write_waters(folder.root / "water.json", waters)
    survey.correct(pairs, waters)


class _Job:
    """One job over all pairs: its passes, and the files that tell of it, also when it is stopped midway."""

    rectification: Rectification | None = None
    inputs: dict[str, str]

    def __init__(self, folder: RunFolder, survey: Survey, pairing: Pairing, config: RunConfig) -> None:
        self._folder, self._survey, self._pairing, self._config = folder, survey, pairing, config
        self._start = time.perf_counter()

    def go(self, passes: Callable[[Survey], None]) -> RunSummary:
        """All passes; Ctrl-C ends them early, with everything told that was done, and then the files that no pass saw."""
        stopped = True
        self._tell(stopped)
        try:
            passes(self._survey)
            stopped = False
        except KeyboardInterrupt:
            pass
        finally:
            for file in self._pairing.unpaired:
                error = f"{file.path}: {file.reason}"
                self._survey.rows.add(FrameRow(file.name, status="unpaired", left=str(file.path), error=error))
            summary = self._tell(stopped)
        return summary

    def _tell(self, stopped: bool) -> RunSummary:
        """frames.csv and run.json, of all that is known by now."""
        summary = RunSummary(self._survey.rows, self._pairing.notes, time.perf_counter() - self._start, stopped)
        self._folder.write_json("run.json", self._content(summary))
        write_atomic(self._folder.root / "frames.csv", frames_csv(summary.rows))
        return summary

    def _content(self, summary: RunSummary) -> dict[str, Any]:
        return {
            "format": RUN_FORMAT,
            "version": __version__,
            "inputs": {**self.inputs, "files": {row.name: row.hashes for row in summary.rows if row.hashes}},
            "config": self._config.model_dump(),
            "geometry": asdict(self.rectification.pair) if self.rectification else None,
            "T_rectified_left": self.rectification.T_rectified_left.tolist() if self.rectification else None,
            "totals": summary.totals(),
        }
