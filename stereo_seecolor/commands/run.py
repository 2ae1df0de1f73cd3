"""``run``: stereo pairs in; range maps, true-color frames, clouds and tables out. ``range`` stops after the range maps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from calibration.formats import native
from stereo_seecolor.commands.dive_job import Job, claim, describe
from stereo_seecolor.commands.first_run import compile_for, load_beside
from stereo_seecolor.commands.stereo_inputs import DiveInputs, Opened, StereoInputs
from stereo_seecolor.compute.library_threads import one_thread_in_products
from stereo_seecolor.compute.shard import WHOLE, Shard
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.passes import Dive
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.pipeline import PAIR_BYTES_A_PIXEL
from stereo_seecolor.records import Water
from stereo_seecolor.run_folder.disk_need import Room, need_bytes
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.layout import RIG, WATER, Stage, state
from stereo_seecolor.run_folder.water_file import read_known_waters, read_waters, waters_content

KIND = "stereo"
"""The kind of output folder that these commands write, in its manifest."""

Passes = Callable[[Dive, RunFolder, Pairing], None]
"""The passes that a command makes over the pairs of a dive, with results in its output folder."""


def run(
    left: Path,
    right: Path,
    calib: str | Path,
    out: Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
) -> RunSummary:
    """Stereo pairs in; range maps, true-color frames, clouds and tables out, in ``out``.

    left, right: folders of images, patterns (``DIVE/*_L.png``), or one video a side, or twice the same video that shows both.
    calib: any calibration that load_rig reads. A shard without a water (``options.water``) stops after the first pass: the water
    of all shards is fitted by ``merge``.
    Raises SeeColorError or CalibrationError for what concerns the whole dive; a bad pair is named in the summary's rows.
    """
    return run_inputs(StereoInputs(left, right, calib), out, config, options)


@one_thread_in_products()
def run_inputs(inputs: DiveInputs, out: Path, config: RunConfig | None = None, options: RunOptions | None = None) -> RunSummary:
    """``run`` for two sides (images or videos) or for a ROS bag: .bag, .db3, .mcap, or the folder of a split one; without ROS.

    Raises as ``run``, and DeviceError if a library for bags or videos is missing.
    """
    config, options = config or RunConfig(), options or RunOptions()
    if options.shard.whole or options.water:
        command = StereoCommand(inputs, config, options, last="corrected")
        return command.into(out, partial(color, water=options.water, shard=options.shard))
    command = StereoCommand(inputs, config, options, last="range")
    return command.into(out, lambda dive, _, pairing: dive.count(pairing.pairs))


def range_maps(
    left: Path, right: Path, calib: str | Path, out: Path, config: RunConfig | None = None, options: RunOptions | None = None
) -> RunSummary:
    """Write range maps, without colors, into ``out``; arguments and errors as in ``run``."""
    command = StereoCommand(StereoInputs(left, right, calib), config or RunConfig(), options or RunOptions(), last="range")
    return command.into(out, lambda dive, _, pairing: dive.measure(pairing.pairs))


@dataclass(frozen=True, eq=False)
class StereoCommand:
    """A command over stereo pairs. last: the last stage that it does with each pair."""

    inputs: DiveInputs
    config: RunConfig
    options: RunOptions
    last: Stage

    def into(self, out: Path, passes: Passes) -> RunSummary:
        """Open the inputs, take ``out``, make ``passes`` over the pairs, and write the reports.

        Images and bags are opened before OUT is touched. Videos are opened after, since OUT keeps which of their frames are pairs.
        """
        load_beside(self.config, self.options)
        inputs, shard = self.inputs, self.options.shard
        before = inputs.open_first(self.config)
        owner = inputs.owner(KIND if shard.whole else f"{KIND}, shard {shard}", before)
        ranges = before.pipeline.settings if before and not self.config.input.refine else ""
        with RunFolder(out, claim(owner, self.config, self.options, inputs.paths, ranges)) as folder:
            opened = before or inputs.open_in(folder, self.config)
            options = self.options.within_memory(PAIR_BYTES_A_PIXEL * opened.pipeline.pixels)
            with options.compute.sharing(state(folder.root), inputs.paths):
                opened = self._with_room(opened.for_dive(folder, options).part(shard), folder)
                compile_for(self.config, options)
                return replace(self, options=options).conduct(opened, folder, passes)

    def conduct(self, opened: Opened, folder: RunFolder, passes: Passes) -> RunSummary:
        """Write rig.yaml into an output folder that was taken, make ``passes`` over the opened pairs, and write the reports."""
        pairing, pipeline = opened.pairing, opened.pipeline
        description = describe(self.inputs.names, pipeline.config, pairing, self.last, self.options, pipeline.rectification)

        def with_rig_file(dive: Dive, folder: RunFolder) -> None:
            folder.dive.write(RIG, native.to_bytes(pipeline.rig))
            passes(dive, folder, pairing)

        return Job(pipeline, pairing, description, with_rig_file).conduct(folder, self.options)

    def _with_room(self, opened: Opened, folder: RunFolder) -> Opened:
        """Report the disk space that pairs new to OUT need. Returns the inputs, with a note where the disk may be too small."""
        known = set(folder.manifest.names())
        new = sum(name not in known for name in opened.pairing.names)
        room = Room.checked(folder.root, new, need_bytes(self.config.output, opened.pipeline.pixels, self.last == "corrected"))
        if new:
            self.options.notice(room.line)
        return replace(opened, pairing=opened.pairing.with_notes((room.line,))) if room.is_tight else opened


def color(dive: Dive, folder: RunFolder, pairing: Pairing, water: Path | None, shard: Shard = WHOLE) -> None:
    """Make both passes over a dive and write water.json; with a file of waters, ``water``, the second pass alone.

    shard: the part of the dive that the pairs are. The file's waters were then fitted to all parts, and a pair that has none there
    failed in its first pass.
    """
    if water and not shard.whole:
        color_with(dive, folder, pairing, read_known_waters(water, list(pairing.names)))
        return
    waters = read_waters(water, list(pairing.names)) if water else dive.waters(pairing.pairs)
    if waters and (water is None or water.resolve() != (folder.root / WATER).resolve()):
        folder.dive.write(WATER, waters_content(waters, dive.light))
    dive.correct(pairing.pairs, waters)


def color_with(dive: Dive, folder: RunFolder, pairing: Pairing, waters: Mapping[str, Water]) -> None:
    """Write water.json with these waters, by frame name, and make the second pass.

    A pair without a water is measured again, so that its row says why it failed.
    """
    folder.dive.write(WATER, waters_content(waters))
    dive.count([pair for pair in pairing.pairs if pair.name not in waters])
    dive.correct(pairing.pairs, waters)
