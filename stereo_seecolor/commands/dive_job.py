"""One command over all pairs of a dive: it makes its passes, and writes the files that describe the run."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calibration import Rectification
from stereo_seecolor.commands.planned import Meter
from stereo_seecolor.commands.run_page import RunPage
from stereo_seecolor.compute.names import Names
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.passes import Dive
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.dive.source import Source
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.inputs.neighbors import misfit_notes
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.matching.pair_check import NOT_ONE_SCENE
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.claim import Claim, Owner
from stereo_seecolor.run_folder.current_frames import CurrentFrames
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import FrameTable, RunSummary
from stereo_seecolor.run_folder.layout import RIG, RUN, WATER, Stage
from stereo_seecolor.run_folder.reports import FinalRows, RunDescription, close_run, products, write_reports


@dataclass(frozen=True, eq=False)
class Job:
    """One command over all pairs of a dive.

    source: reads and measures a pair. description: of the command, for run.json. passes: makes the passes over the dive.
    """

    source: Source
    pairing: Pairing
    description: RunDescription
    passes: Callable[[Dive, RunFolder], None]

    def conduct(self, folder: RunFolder, options: RunOptions) -> RunSummary:
        """Make all passes; Ctrl-C ends them early. run.json and frames.csv are written at the end, also after an error."""
        page, meter = RunPage(options, folder, self.description), Meter(options.compute)
        dive = Dive(self.source, folder, page.listening(), self.description.last)
        start, complete = time.perf_counter(), False
        dive.show(page.early_frames())
        earlier = earlier_config(folder)
        folder.dive.update(replace(folder.dive.record, state="running"))
        try:
            self.passes(dive, folder)
            complete = True
        except KeyboardInterrupt:
            pass
        except BaseException:
            page.drop()
            raise
        finally:
            dive.end()
            page.keep()
            description = self._described(folder, earlier)
            current = close_run(folder, description, complete, options.compute)
            summary = replace(self._summary(folder, dive, current), wall_seconds=time.perf_counter() - start, stopped=not complete)
            write_reports(folder, description, summary)
        page.end(stopped=not complete)
        summary = meter.compared(summary, folder.root, len(self.pairing.pairs), description.config)
        return replace(summary, products=products(folder, current))

    def _described(self, folder: RunFolder, earlier: RunConfig | None) -> RunDescription:
        """The description for run.json.

        Where ``range`` alone was run and corrected frames of an earlier run are still current, it states that run's settings.
        """
        if self.description.last == "range" and "corrected" in folder.dive.record.settings and earlier:
            return replace(self.description, config=earlier)
        return self.description

    def _summary(self, folder: RunFolder, dive: Dive, current: CurrentFrames) -> RunSummary:
        unpaired = [
            FrameRow(file.name, status="unpaired", left=str(file.path), error=f"{file.path}: {file.reason}")
            for file in self.pairing.unpaired
        ]
        aside = [f"{path}: was changed since the program wrote it, and is kept here" for path in folder.owned.set_aside]
        notes = (*self.pairing.notes, *dive.notes, *aside, *folder.dive.removed, *self._misfit_notes(dive.table))
        return RunSummary(FinalRows(dive.table, current.done, unpaired), notes, missing_shards=self.pairing.missing_shards)

    def _misfit_notes(self, table: FrameTable) -> tuple[str, ...]:
        rectification = self.description.rectification
        failed = {name for name, error in table.failed.items() if NOT_ONE_SCENE in error}
        if rectification is None or not failed:
            return ()
        return misfit_notes(self.pairing.pairs, failed, rectification, self.description.config.input)


def earlier_config(folder: RunFolder) -> RunConfig | None:
    """The settings of the run that OUT already holds; None where it holds none."""
    try:
        return open_run(folder.root).config
    except (InputError, OutputError):  # the second: a result that the user replaced by a link, which this run sets aside
        return None


def claim(owner: Owner, config: RunConfig, options: RunOptions, inputs: Sequence[Path], ranges: str = "") -> Claim:
    """The claim of a command on OUT, in which all that it reads is protected from deletion: its inputs, and what its settings and
    options name. ranges: as in Claim.
    """
    given = (*inputs, *config.files, options.config_file, options.water, *options.also_read)
    unchanged = () if options.overwrite else (WATER, RUN) if config.input.refine else (WATER, RUN, RIG)
    return Claim(owner, options.overwrite, tuple(path for path in given if path is not None), unchanged, ranges)


def describe(
    inputs: dict[str, str],
    config: RunConfig,
    pairing: Pairing,
    last: Stage,
    options: RunOptions,
    rectification: Rectification | None = None,
) -> RunDescription:
    """The description of a command for run.json. rectification: None where the command has no calibration."""
    names = Names(pairing.names)
    return RunDescription(inputs, config, names, last, rectification, command_line=options.command_line)
