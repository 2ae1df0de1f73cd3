"""``water``: measure the water of a finished run, for another run with ``--water``: from
overlapping frames, or from charts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.divided_light import divide_illumination, with_clipped
from stereo_seecolor.color.photometry.light_model import Light
from stereo_seecolor.color.photometry.observations import KeyFrame
from stereo_seecolor.color.render.carried import carry_ranges
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.charts.camera_matrix import (
    CameraMatrix,
    SeenPatches,
    camera_matrix,
)
from stereo_seecolor.extras.evaluation.charts.chart_white import (
    SeenWhite,
    WhiteTrend,
    believed,
    doubts_of,
    seen_whites,
    survey_white,
)
from stereo_seecolor.extras.evaluation.charts.targets import Targets, read_targets, targets_of
from stereo_seecolor.extras.evaluation.multiview import (
    find_observations,
    fit_observations,
    with_white_of,
)
from stereo_seecolor.inputs.trajectories import rectified_trajectory, trajectory_files
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import place
from stereo_seecolor.records import Water
from stereo_seecolor.report.frame_files import FrameFiles
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import MEASURED_WATER
from stereo_seecolor.run_folder.survey_frames import SurveyFrames
from stereo_seecolor.run_folder.water_file import read_waters, waters_content
from stereo_seecolor.water.model import read_water_document


@dataclass(frozen=True)
class ChartReading:
    """A chart or white card in a frame.

    range_m: of the target. residual_deg: angle between its white, with the water removed, and the
    mean white of all targets.
    ciede2000_before, ciede2000: median error of a chart's patches without and with the color
    matrix; NaN for a card.
    """

    frame: str
    target: str
    range_m: float
    residual_deg: float
    ciede2000_before: float
    ciede2000: float


@dataclass(frozen=True, eq=False)
class MeasuredWater:
    """A measured water, and the file that ``--water`` of another run takes.

    charts: targets that its white point is from, if any. trend: of their whites over range, where
    they lie at several ranges.
    matrix: the camera's color matrix; None with the reason in no_matrix where charts gave none.
    left_out: "frame: target" of possible white cards that were not used, since there are charts or
    since their color is unlikely.
    """

    path: Path
    water: Water
    charts: tuple[ChartReading, ...] = ()
    trend: WhiteTrend | None = None
    matrix: CameraMatrix | None = None
    no_matrix: str = ""
    left_out: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def measure_water(out: Path, poses: Path, config: RunConfig | None = None) -> MeasuredWater:
    """Write OUT/water_measured.json: attenuation and backscatter from spots seen at two ranges, the
    white point of the run's water.

    out: a run with color.lock=survey. poses: a trajectory of the left camera in any known format.
    Raises InputError, MappingError, ColorError where the run, the poses or the overlap do not
    suffice.
    """
    run = open_run(out)
    config = config or run.config
    frames = SurveyFrames(run)
    index = FrameIndex.build(frames, frames.geometry)
    trajectory = rectified_trajectory(poses, config.mapping, frames.T_rectified_left)
    if trajectory.fixes:
        raise InputError(
            f"{poses}: contains only positions: fuse with them, and give OUT/map/trajectory.tum "
            "here"
        )
    placed = place(index, trajectory)
    scene = _one_water(run, list(index.names))
    key_frames = _KeyFrames(run, frames, placed.T_world_camera)
    observations = find_observations(key_frames, frames.geometry, scene.input_encoding)
    water = with_white_of(fit_observations(observations, scene.input_encoding), scene, observations)
    return MeasuredWater(_written(out, water, trajectory_files(poses)), water)


def measure_white(
    out: Path, targets: Path | None = None, white: Sequence[str] = (), sand: Sequence[str] = ()
) -> MeasuredWater:
    """Write OUT/water_measured.json: the run's water with the white point of the charts and white
    cards that its frames show, and with the camera's color matrix where charts show enough patches.

    out: a run with one water for all frames. targets: JSON of chart corners and polygons (see
    ``read_targets``), of which only frames that it names count; without it every frame is searched
    for charts. white, sand: "FRAME:x,y", pixels of corrected images that show white or carbonate
    sand: then only these count. Raises InputError, also where nothing is found.
    """
    run = open_run(out)
    names = tuple(frame.name for frame in run.frames)
    spots = _spots(names, {"white": white, "sand": sand})
    given = spots or (read_targets(targets) if targets else None)
    frames = SurveyFrames(run)
    _check_places(targets, given or {}, frames.geometry.image_size, names)
    scene = _one_water(run, list(names))
    search = _TargetSearch(names, frames, FrameFiles.rectifying(run), scene, _light_of(run), given)
    seen = [white for part in Threads(cores()).each(search, range(len(names))) for white in part]
    kept = believed(seen, scene) if given is None else seen
    left_out = tuple(f"{one.frame}: {one.target}" for one in seen if one not in kept)
    if not kept:
        raise _nothing_seen(out, given, left_out)
    found = survey_white(kept)
    water = found.set_in(scene)
    charts = found.patches_in(water)
    for one, patches in zip(found.seen, charts, strict=True):
        if given is not None and patches and not patches.is_in_order:
            raise InputError(
                f"{targets}: {one.frame}: {one.target}: its patches fit the published colors no "
                "better than in random order: check the type of the chart, and its corners: their "
                "places, and the documented order"
            )
    matrix = camera_matrix([chart for chart in charts if chart])
    if isinstance(matrix, CameraMatrix):
        water = replace(water, matrix=matrix.matrix, matrix_errors=matrix.errors)
    return MeasuredWater(
        path=_written(out, water, (targets,) if targets else ()),
        water=water,
        charts=tuple(
            _reading(*of, water) for of in zip(found.seen, found.residuals_deg, charts, strict=True)
        ),
        trend=found.trend(),
        matrix=matrix if isinstance(matrix, CameraMatrix) else None,
        no_matrix="" if isinstance(matrix, CameraMatrix) else matrix,
        left_out=left_out,
        doubts=tuple(line for one in kept for line in doubts_of(one, scene)) if spots else (),
    )


def _written(out: Path, water: Water, inputs: Sequence[Path]) -> Path:
    with RunFolder.existing(out, "water", inputs) as folder:
        folder.dive.write(
            MEASURED_WATER, waters_content({"survey": water}), made_from=folder.dive.digest("range")
        )
    return out / MEASURED_WATER


def _spots(names: Sequence[str], spots: Mapping[str, Sequence[str]]) -> Targets:
    """The targets of spots given as "FRAME:x,y", by kind. Raises InputError for something else."""
    targets: Targets = {}
    for kind, given in spots.items():
        for one in given:
            frame, _, pixel = one.rpartition(":")
            try:
                x, y = map(float, pixel.split(","))
            except ValueError:
                raise InputError(
                    f"--{kind} {one}: needs FRAME:x,y, a frame and one of its pixels, for "
                    f"example {names[0]}:310,225"
                ) from None
            if frame not in names:
                raise InputError(f"--{kind} {one}: the run has no frame {frame!r}")
            targets.setdefault(frame, []).append({kind: np.array([x, y])})
    return targets


def _check_places(
    targets: Path | None, given: Targets, image_size: tuple[int, int], names: Sequence[str]
) -> None:
    """Raise InputError if no target is of a frame of the run, or some lie outside its images."""
    if given and not given.keys() & set(names):
        raise InputError(
            f"{targets}: names no frame of the run: the first is {next(iter(given))!r}, not as "
            f"{names[0]!r}"
        )
    width, height = image_size
    for frame in sorted(given.keys() & set(names)):
        for places in (places for one in given[frame] for places in one.values()):
            if ((places < -1) | (places > image_size)).any():
                x, y = np.atleast_2d(places)[0]
                raise InputError(
                    f"{frame}: a target at {x:g}, {y:g} reaches outside the corrected image of "
                    f"{width} x {height} pixels"
                )


def _nothing_seen(out: Path, given: Targets | None, left_out: tuple[str, ...]) -> InputError:
    where = (
        f"{out}: no color chart or white card"
        if given is None
        else f"{out}: none of the given targets"
    )
    unlikely = (
        f" ({', '.join(left_out)}: their color is unlikely for white here)" if left_out else ""
    )
    shown = f"shows gray patches with a known range that are neither clipped nor dark{unlikely}"
    return InputError(
        f"{where} {shown}: give corners with --targets, or other spots with --white or --sand"
    )


def _reading(
    seen: SeenWhite, residual_deg: float, chart: SeenPatches | None, water: Water
) -> ChartReading:
    before, after = (
        chart.ciede2000(matrix) if chart else float("nan") for matrix in (np.eye(3), water.matrix)
    )
    return ChartReading(seen.frame, seen.target, seen.range_m, residual_deg, before, after)


@dataclass(frozen=True, eq=False)
class _TargetSearch:
    """Finds charts and white cards of a frame. targets: given, by frame; None: to be searched."""

    names: tuple[str, ...]
    frames: SurveyFrames
    files: FrameFiles
    water: Water
    light: Light | None
    targets: Targets | None

    def __call__(self, number: int) -> list[SeenWhite]:
        name = self.names[number]
        if self.targets is not None and name not in self.targets:
            return []
        image = self.files.raw(self.frames.finished[number])
        range_m = self.frames[number].range_m
        found = targets_of(self.targets[name] if self.targets else [], image, range_m)
        if any(target.type is None for target in found):
            # a card or sand may be too even to be matched but at its border
            range_m = carry_ranges(image, range_m)
        if self.light and found:
            light = self.light.on(name, (image.shape[1], image.shape[0]))
            divided = divide_illumination(image, range_m, light, self.water.input_encoding)
            image = with_clipped(divided, image)
        return list(seen_whites(name, found, image, range_m, self.water))


def _one_water(run: FinishedRun, names: list[str]) -> Water:
    """The water that all frames share. Raises InputError where they have different ones."""
    waters = read_waters(run.water_file, names)
    if len({tuple(water.white) for water in waters.values()}) > 1:
        raise InputError(
            f"{run.water_file}: holds water parameters for each frame: run again with --set "
            "color.lock=survey"
        )
    return waters[names[0]]


def _light_of(run: FinishedRun) -> Light | None:
    """The light divided out of the run's images before its water was fitted; None without."""
    content = read_water_document(run.water_file).get("light")
    return Light.from_content(content) if content else None


class _KeyFrames(Lazy[KeyFrame]):
    """The placed frames of a run, uncorrected and rectified, each read when asked for."""

    def __init__(self, run: FinishedRun, frames: SurveyFrames, poses: NDArray[np.float64]) -> None:
        self._files, self._frames, self._poses = FrameFiles.rectifying(run), frames, poses
        self._placed = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))

    def __len__(self) -> int:
        return len(self._placed)

    def item(self, number: int) -> KeyFrame:
        """Read one frame."""
        placed = int(self._placed[number])
        frame = self._frames[placed]
        image = self._files.raw(self._frames.finished[placed])
        return KeyFrame(image, frame.range_m, self._poses[placed])
