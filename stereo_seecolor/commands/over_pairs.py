"""What the commands over all pairs of a dive share: taking OUT, their passes, and the files that describe the run."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calibration import Rectification
from calibration.checks import suspicions
from stereo_seecolor.commands.dive_rig import first_notes, load_rig_for, spread
from stereo_seecolor.commands.pages import drop_live_page, early_frames, end_page, keep_live_page, with_live_page
from stereo_seecolor.commands.planned import Meter
from stereo_seecolor.commands.refine_dive import DiveRefinement
from stereo_seecolor.commands.video_pairs import video_pairing
from stereo_seecolor.compute.names import Names
from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive import Dive
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.reading import read_bytes, special_kind
from stereo_seecolor.frame_source import Source
from stereo_seecolor.inputs.linear_look import encoding_notes
from stereo_seecolor.inputs.listing import folder_of
from stereo_seecolor.inputs.neighbors import misfit_notes
from stereo_seecolor.inputs.pairing import Pair, Pairing, pair_folders
from stereo_seecolor.inputs.stored_pixels import as_stored, stored_notes
from stereo_seecolor.inputs.video import Videos
from stereo_seecolor.inputs.video_images import is_video
from stereo_seecolor.matching.pair_check import NOT_ONE_SCENE
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.progress import RunOptions
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.claim import Claim, Owner
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.layout import Stage
from stereo_seecolor.run_folder.reports import RunDescription, close_run, final_rows, products, write_reports

STORAGE_PAIRS = 6
"""So many pairs are looked at for how images store their pixels: one dark frame must not decide."""

SAMPLE_BYTES = 1 << 20
"""So much of a video's begin tells it from others."""


@dataclass(frozen=True, eq=False)
class StereoInputs:
    """What a command over stereo pairs is given. left, right: folders of images, patterns, videos. calib: as for load_rig."""

    left: Path
    right: Path
    calib: str | Path

    @property
    def names(self) -> dict[str, str]:
        """For run.json."""
        return {"left": str(self.left), "right": str(self.right), "calib": str(self.calib)}

    @property
    def paths(self) -> tuple[Path, ...]:
        """Every file and folder that is read."""
        return (folder_of(self.left), folder_of(self.right), *(Path(part) for part in str(self.calib).split(",")))

    @property
    def is_video(self) -> bool:
        """True for two videos, or one that shows both sides."""
        return is_video(self.left) and is_video(self.right)

    def owner(self, kind: str, pairing: Pairing | None) -> Owner:
        """Whose results these inputs give: recognized by their paths, or by the content of the first file."""
        paths = {"left": str(self.left.resolve()), "right": str(self.right.resolve())}
        return Owner(kind, paths, sample(pairing.pairs[0].left if pairing else self.left))

    def open(self, config: RunConfig) -> "Opened":
        """The pairs of two folders, and the pipeline for their rig. Raises InputError, CalibrationError.

        What looks wrong with the rig, though it can be used, is added to the pairing's notes.
        """
        pairing = pair_folders(self.left, self.right, config.input)
        config, notes = settle_storage(config, pairing.pairs)
        return self._opened(pairing.with_notes(notes), config)

    def open_videos(self, folder: RunFolder, config: RunConfig) -> "Opened":
        """The same of videos; which of their frames are pairs is kept in OUT. Raises as ``open``, and DeviceError."""
        return self._opened(video_pairing(Videos(self.left, self.right), self.calib, folder, config.input), config)

    def _opened(self, pairing: Pairing, config: RunConfig) -> "Opened":
        if config.output.geometry == "original":
            _refuse_equal_names(pairing)
        rig = load_rig_for(self.calib, pairing.pairs, config.input)
        notes = tuple(f"calibration: {suspicion}" for suspicion in suspicions(rig))
        return Opened(pairing.with_notes(notes), Pipeline(rig, config))


def settle_storage(config: RunConfig, pairs: Sequence[Pair]) -> tuple[RunConfig, tuple[str, ...]]:
    """The same with ``input.bayer`` and ``input.significant_bits`` as the pairs' images have them, and what to say of it."""
    images = as_stored(config.input, spread(pairs, STORAGE_PAIRS))
    return config.model_copy(update={"input": images}), stored_notes(config.input, images)


@dataclass(frozen=True, eq=False)
class Opened:
    """What a command over stereo pairs works on."""

    pairing: Pairing
    pipeline: Pipeline

    def for_dive(self, folder: RunFolder, options: RunOptions) -> "Opened":
        """The same with the rig held against the first pairs of a dive, and refined where the settings ask for it."""
        pairing, pipeline = self.pairing, self.pipeline
        images = pipeline.config.input
        if images.refine:
            rig, note = DiveRefinement(folder, pairing, images, options).of(pipeline.rig)
            pairing = pairing.with_notes((note,))
            pipeline = pipeline if rig is pipeline.rig else Pipeline(rig, pipeline.config)
        if not folder.manifest.names():  # a rerun has been told
            notes = first_notes(pipeline, pairing.pairs), encoding_notes(pipeline.config, pairing.pairs)
            pairing = pairing.with_notes((*notes[0], *notes[1]))
        return Opened(pairing, pipeline)

    def part(self, shard: Shard) -> "Opened":
        """A shard's pairs alone. Files without a partner are named by the first shard."""
        if shard.whole:
            return self
        pairs = tuple(shard.part(self.pairing.pairs))
        note = f"shard {shard}: {len(pairs)} of {len(self.pairing.pairs)} pairs; when all shards are done: stereo-seecolor merge"
        unpaired = self.pairing.unpaired if shard.number == 1 else ()
        return replace(self, pairing=Pairing(pairs, unpaired, (*self.pairing.notes, note)))


@dataclass(frozen=True, eq=False)
class Job:
    """One command over all pairs of a dive. description: what it was given. passes: what it does with the dive."""

    source: Source
    pairing: Pairing
    description: RunDescription
    passes: Callable[[Dive, RunFolder], None]

    def conduct(self, folder: RunFolder, options: RunOptions) -> RunSummary:
        """All passes; Ctrl-C ends them early. run.json and frames.csv are written at the end, however it comes."""
        watched = with_live_page(options, folder, self.description)
        start, dive, complete = time.perf_counter(), Dive(self.source, folder, watched), False
        meter = Meter(options.compute)
        dive.show(early_frames(options, self.description))
        earlier = earlier_config(folder)
        folder.update(replace(folder.dive, state="running"))
        try:
            self.passes(dive, folder)
            complete = True
        except KeyboardInterrupt:
            pass
        except BaseException:
            drop_live_page(options, folder)
            raise
        finally:
            dive.end()
            description = self.description
            if description.last == "range" and "corrected" in folder.dive.settings and earlier:
                description = replace(description, config=earlier)  # corrected frames of an earlier run are still current
            keep_live_page(options, folder)
            close_run(folder, description, complete)
            summary = self._summary(folder, dive, time.perf_counter() - start, not complete)
            write_reports(folder, description, summary)
        end_page(options, folder, description, not complete)
        summary = meter.compared(summary, folder.root, len(self.pairing.pairs), description.config)
        return replace(summary, products=products(folder))

    def _summary(self, folder: RunFolder, dive: Dive, seconds: float, stopped: bool) -> RunSummary:
        rows = dive.table.rows
        unpaired = [
            FrameRow(file.name, status="unpaired", left=str(file.path), error=f"{file.path}: {file.reason}")
            for file in self.pairing.unpaired
        ]
        aside = [f"{path}: was changed since the program wrote it, and is kept here" for path in folder.set_aside]
        notes = (*self.pairing.notes, *dive.notes, *aside, *folder.removed, *self._misfit_notes(rows))
        return RunSummary(final_rows(folder, self.description, dive.table, unpaired), notes, seconds, stopped)

    def _misfit_notes(self, rows: Sequence[FrameRow]) -> tuple[str, ...]:
        rectification = self.description.rectification
        failed = {row.name for row in rows if NOT_ONE_SCENE in row.error}
        if rectification is None or not failed:
            return ()
        return misfit_notes(self.pairing.pairs, failed, rectification, self.description.config.input)


def _refuse_equal_names(pairing: Pairing) -> None:
    """Products in the camera's own pixels are called as its images are, so that these must differ in name."""
    seen: dict[str, Path] = {}
    for pair in pairing.pairs:
        other = seen.setdefault(pair.left.stem.casefold(), pair.left)
        if other != pair.left:
            raise InputError(
                f"{other} and {pair.left}: would both be {other.stem} in OUT/original: rename one, or set output.geometry=rectified"
            )


def earlier_config(folder: RunFolder) -> RunConfig | None:
    """The settings of the run that OUT holds already, if it holds one."""
    try:
        return open_run(folder.root).config
    except InputError:
        return None


def claim(owner: Owner, options: RunOptions, inputs: Sequence[Path | None]) -> Claim:
    """How a command takes OUT, with all that it reads protected."""
    given = (*inputs, options.config_file)
    return Claim(owner, options.overwrite, tuple(path for path in given if path is not None))


def describe(inputs: dict[str, str], config: RunConfig, pairing: Pairing, last: Stage, options: RunOptions) -> RunDescription:
    """What run.json says of a command."""
    names = Names(pair.name for pair in pairing.pairs)
    return RunDescription(inputs, config, names, last, command_line=options.command_line)


def with_rig(description: RunDescription, rectification: Rectification) -> RunDescription:
    """The same, for a command that knows the cameras."""
    return replace(description, rectification=rectification)


def sample(path: Path) -> str:
    """Hash by which a dive is recognized that was moved: of its first image, or of its video's begin. Raises InputError."""
    if not is_video(path):
        return content_key(read_bytes(path))
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a video")
        with path.open("rb") as file:
            return content_key(file.read(SAMPLE_BYTES), path.stat().st_size)
    except OSError as error:
        raise InputError(f"{path}: the video cannot be read: {error.strerror}") from error
