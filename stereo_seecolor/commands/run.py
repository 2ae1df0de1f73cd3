"""``run``: stereo pairs in; range maps, true-color frames, clouds and tables out. ``range`` stops after the range maps."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from calibration.formats import native
from stereo_seecolor.commands.bag_inputs import BagInputs
from stereo_seecolor.commands.over_pairs import Job, Opened, StereoInputs, claim, describe, with_rig
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive import Dive
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.progress import RunOptions
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.layout import RIG, WATER, Stage
from stereo_seecolor.run_folder.water_file import read_waters, waters_content


def run(
    left: Path,
    right: Path,
    calib: str | Path,
    out: Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
    *,
    water: Path | None = None,
) -> RunSummary:
    """Stereo pairs in; range maps, true-color frames, clouds and tables out, in ``out``.

    left, right: folders of images, patterns (``DIVE/*_L.png``), or one video a side, or twice the same video that shows both.
    calib: any calibration that load_rig reads. water: the water.json of an earlier dive, to be used instead of a fit.
    Raises SeeColorError or CalibrationError for what concerns the whole dive; a bad pair is named in the summary's rows.
    """
    command = StereoCommand(StereoInputs(left, right, calib), config or RunConfig(), options or RunOptions(), "corrected")
    return command.into(out, lambda dive, folder, pairing: color(dive, folder, pairing, water), water)


def run_bag(
    inputs: BagInputs,
    out: Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
    *,
    water: Path | None = None,
) -> RunSummary:
    """As ``run``, of a ROS bag, which needs no ROS: .bag, .db3, .mcap, or a folder with the files of a split one.

    Raises as ``run``, and DeviceError if the library for bags is missing.
    """
    command = StereoCommand(inputs, config or RunConfig(), options or RunOptions(), "corrected")
    return command.into(out, lambda dive, folder, pairing: color(dive, folder, pairing, water), water)


def range_maps(
    left: Path, right: Path, calib: str | Path, out: Path, config: RunConfig | None = None, options: RunOptions | None = None
) -> RunSummary:
    """Range maps alone, in ``out``; arguments and errors as in ``run``."""
    command = StereoCommand(StereoInputs(left, right, calib), config or RunConfig(), options or RunOptions(), "range")
    return command.into(out, lambda dive, _, pairing: dive.measure(pairing.pairs))


@dataclass(frozen=True, eq=False)
class StereoCommand:
    """A command over stereo pairs. last: the stage after which a pair is done."""

    inputs: StereoInputs | BagInputs
    config: RunConfig
    options: RunOptions
    last: Stage

    def into(self, out: Path, passes: Callable[[Dive, RunFolder, Pairing], None], water: Path | None = None) -> RunSummary:
        """Do ``passes`` into ``out``. Folders are looked at before OUT is touched; videos are unpacked into it."""
        inputs = self.inputs
        if isinstance(inputs, StereoInputs) and inputs.is_video:
            opened, owner = None, inputs.owner("stereo", None)
        else:
            opened = inputs.open(self.config)
            owner = inputs.owner("stereo", opened.pairing)
        with RunFolder(out, claim(owner, self.options, [*inputs.paths, water])) as folder:
            if isinstance(inputs, StereoInputs) and opened is None:
                opened = inputs.unpacked(folder, self.config).open(self.config)
            assert opened
            return self._job(opened.for_dive(folder, self.options), passes).conduct(folder, self.options)

    def _job(self, opened: Opened, passes: Callable[[Dive, RunFolder, Pairing], None]) -> Job:
        pairing, pipeline = opened.pairing, opened.pipeline
        description = describe(self.inputs.names, self.config, pairing, self.last, self.options)

        def with_rig_file(dive: Dive, folder: RunFolder) -> None:
            folder.write(RIG, native.to_bytes(pipeline.rig))
            passes(dive, folder, pairing)

        return Job(pipeline, pairing, with_rig(description, pipeline.rectification), with_rig_file)


def color(dive: Dive, folder: RunFolder, pairing: Pairing, water: Path | None) -> None:
    """Both passes of a dive, and water.json; only the second pass where ``water`` is a file of waters."""
    waters = read_waters(water, [pair.name for pair in pairing.pairs]) if water else dive.waters(pairing.pairs)
    if waters and (water is None or water.resolve() != (folder.root / WATER).resolve()):
        folder.write(WATER, waters_content(waters))
    dive.correct(pairing.pairs, waters)
