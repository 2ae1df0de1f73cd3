"""The session of a run over pairs: it locks OUT, and writes run.json, frames.csv, the page."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from calibration.formats import native
from stereo_seecolor.commands.run_page import RunPage
from stereo_seecolor.commands.stereo_inputs import DiveInputs, Opened
from stereo_seecolor.commands.warm_up import compile_for, load_in_background
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.names import Names
from stereo_seecolor.compute.process import peak_bytes
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.dive_run import DiveRun
from stereo_seecolor.dive.frames import PairSource
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.inputs.pairing import NO_PARTNER, Pairing
from stereo_seecolor.matching.pair_check import NO_OVERLAP, ROWS_OFF
from stereo_seecolor.pipeline import PAIR_BYTES_A_PIXEL
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.cache import Compared, Cost, KeptPlan, used_bytes
from stereo_seecolor.run_folder.current_frames import CurrentFrames
from stereo_seecolor.run_folder.disk_space import check_disk, need_bytes
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.layout import RIG, RUN, WATER, Stage, state
from stereo_seecolor.run_folder.ownership import FolderRequest, Owner
from stereo_seecolor.run_folder.reports import (
    FinalRows,
    RunDescription,
    close_run,
    products,
    write_reports,
)

KIND = "stereo"
"""The kind of output folder that a command over stereo pairs writes, in its manifest."""


@contextmanager
def stereo_run(
    inputs: DiveInputs,
    out: Path,
    config: RunConfig,
    options: RunOptions,
    last: Stage,
    passes: Sequence[str],
) -> Iterator[DiveRun]:
    """Open the pairs and the calibration, take ``out``, and write the reports at the end. last: the
    last stage of each pair.

    Images and bags are opened before OUT is touched. Videos are opened after, since OUT keeps which
    of their frames are pairs.
    """
    before = inputs.open_first(config)
    # not before: imports and opening would wait for each other, for Python's global lock
    load_in_background(config, options)
    shard = options.shard
    owner = inputs.owner(KIND if shard.whole else f"{KIND}, shard {shard}", before)
    ranges = before.pipeline.settings if before and not config.input.refine else ""
    request = folder_request(owner, config, options, inputs.paths, ranges)
    with RunFolder(out, request) as folder:
        opened = before or inputs.open_in(folder, config)
        options = options.within_memory(PAIR_BYTES_A_PIXEL * opened.pipeline.pixels)
        with options.compute.sharing(state(folder.root), inputs.paths):
            opened = opened.for_dive(folder, options).part(shard)
            opened = _with_disk_space(opened, folder, options, last)
            compile_for(config, options)
            with run_session(
                opened.pipeline, opened.pairing, inputs.names, folder, options, last, passes
            ) as run:
                folder.dive.write(RIG, native.to_bytes(opened.pipeline.rig))
                yield run


def _with_disk_space(opened: Opened, folder: RunFolder, options: RunOptions, last: Stage) -> Opened:
    """Report the disk space that new pairs need. Returns the inputs, with a note if it is short."""
    known = set(folder.manifest.names())
    new = sum(name not in known for name in opened.pairing.names)
    pipeline = opened.pipeline
    each = need_bytes(pipeline.config.output, pipeline.pixels, last == "corrected")
    line, is_low = check_disk(folder.root, new, each, pipeline.config.output)
    if new:
        options.notice(line)
    return replace(opened, pairing=opened.pairing.with_notes((line,))) if is_low else opened


@contextmanager
def run_session(
    source: PairSource,
    pairing: Pairing,
    inputs: dict[str, str],
    folder: RunFolder,
    options: RunOptions,
    last: Stage,
    passes: Sequence[str],
) -> Iterator[DiveRun]:
    """A run over the pairs: Ctrl-C ends it early. run.json, frames.csv and the page are written at
    its end, the first two also after an error. inputs: by name, for run.json.
    """
    names, rectification = Names(pairing.names), source.rectification
    description = RunDescription(
        inputs, source.config, names, last, rectification, options.command_line
    )
    page, meter = RunPage(options, folder, description), _Meter(options.compute)
    run = DiveRun(source, folder, page.listening(), pairing, passes, page.early_files())
    start, complete = time.perf_counter(), False
    earlier = _earlier_config(folder)
    folder.dive.update(replace(folder.dive.record, state="running"))
    try:
        yield run
        complete = True
    except KeyboardInterrupt:
        pass
    except BaseException:
        page.drop()
        raise
    finally:
        run.frames.pixels.clear()
        page.keep()
        if last == "range" and "corrected" in folder.dive.record.settings and earlier:
            # corrected frames of an earlier run are still current
            description = replace(description, config=earlier)
        current = close_run(folder, description, complete, options.compute)
        seconds = time.perf_counter() - start
        run.summary = replace(
            _summary(run, pairing, description, current),
            wall_seconds=seconds,
            stopped=not complete,
            wrong=pairing.wrong if "waters" in passes else pairing.wrong - {"colors"},
        )
        write_reports(folder, description, run.summary)
    page.end(stopped=not complete)
    summary = meter.compared(run.summary, folder.root, run.plan)
    run.summary = replace(summary, products=products(folder, current))


class _Meter:
    """Measures a run: processor time of this process and its workers, elapsed, memory, disk."""

    def __init__(self, compute: Compute) -> None:
        self._compute = compute
        self._began_s, self._core_s = time.perf_counter(), self._used_s()

    def _used_s(self) -> float:
        return time.process_time() + self._compute.usage.core_seconds

    def compared(self, summary: RunSummary, root: Path, plan: KeptPlan | None) -> RunSummary:
        """The summary with the planned and the measured cost.

        Unchanged where OUT holds no plan for this dive, or the run did not do all of it.
        """
        if plan is None or summary.kept or summary.stopped:
            return summary
        usage, wall_s = self._compute.usage, time.perf_counter() - self._began_s
        memory = usage.memory_bytes or peak_bytes()
        measured = Cost(
            (self._used_s() - self._core_s) / 3600, wall_s / 3600, used_bytes(root), memory
        )
        return replace(summary, plan=Compared(usage.cores, plan.cost(usage.cores), measured))


def _summary(
    run: DiveRun, pairing: Pairing, description: RunDescription, current: CurrentFrames
) -> RunSummary:
    unpaired = [
        FrameRow(
            file.name, status="unpaired", left=str(file.path), error=f"{file.path}: {file.reason}"
        )
        for file in pairing.unpaired
    ]
    aside = [
        f"{path}: was changed after the program wrote it, and is kept here"
        for path in run.folder.owned.set_aside
    ]
    failed = {
        name for name, error in run.table.failed.items() if NO_OVERLAP in error or ROWS_OFF in error
    }
    misfits: tuple[str, ...] = ()
    if failed and description.rectification:
        from stereo_seecolor.checks.neighbors import misfit_notes

        left, right = (
            [
                file.path
                for file in pairing.unpaired
                if file.reason.startswith(NO_PARTNER.format(other))
            ]
            for other in ("right", "left")
        )
        config, rectification = description.config.input, description.rectification
        misfits = misfit_notes(pairing.pairs, failed, rectification, config, (left, right))
    notes = (*pairing.notes, *run.notes, *aside, *run.folder.dive.removed, *misfits)
    return RunSummary(
        FinalRows(run.table, current.done, unpaired),
        notes,
        of_dive=pairing.of_dive,
        missing_shards=pairing.missing_shards,
        ranges=pairing.ranges,
    )


def _earlier_config(folder: RunFolder) -> RunConfig | None:
    """The settings of the run that OUT already holds; None where it holds none."""
    try:
        return open_run(folder.root).config
    except (InputError, OutputError):
        # the second: a result that the user replaced by a link, which this run sets aside
        return None


def folder_request(
    owner: Owner, config: RunConfig, options: RunOptions, inputs: Sequence[Path], ranges: str = ""
) -> FolderRequest:
    """What a command asks of OUT. All that it reads is protected from deletion: its inputs, and
    what its settings and options name. ranges: as in FolderRequest.
    """
    given = (*inputs, *config.files, options.config_file, options.water, *options.also_read)
    unchanged = (
        () if options.overwrite else (WATER, RUN) if config.input.refine else (WATER, RUN, RIG)
    )
    return FolderRequest(
        owner,
        options.overwrite,
        tuple(path for path in given if path is not None),
        unchanged,
        ranges,
    )
