"""A command at work on the pairs of a dive: passes over all pairs, and records so far."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

from calibration import CalibrationError
from stereo_seecolor.checks.repeated_images import RepeatedImages
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.dive.frames import Frames, PageFiles, PairSource
from stereo_seecolor.dive.pair_sequences import chosen
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import ClusterError, DeviceError, OutputError, SeeColorError
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.cache import KeptPlan
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import FrameTable, RunSummary
from stereo_seecolor.run_folder.kept_pixels import KeptPixels
from stereo_seecolor.run_folder.layout import SET_ASIDE, Stage
from stereo_seecolor.run_folder.run_progress import USUAL, ExpectedPasses, ProgressFile

Result = TypeVar("Result")
Item = TypeVar("Item")
Work = Callable[[Pair, Clock], tuple[FrameRow, Result]]


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """The outcome of a pair. result: None where it failed, or is not kept; failure: the error of a
    pair that failed, else None.

    written: the stages whose files were written now. aside: files of the user that were moved to
    OUT/set_aside to make room.
    """

    row: FrameRow
    result: Result | None
    failure: Exception | None
    written: tuple[Stage, ...]
    aside: tuple[Path, ...]


def attempt(work: Work[Result], folder: RunFolder, keep: bool, pair: Pair) -> Outcome[Result]:
    """Do ``work`` on a pair; an error that concerns this pair alone goes into its row. keep: its
    result, and not its row alone.

    Raises errors that concern every pair: OutputError (a full disk), DeviceError, ClusterError.
    """
    clock, result, failure = Clock(), None, None
    try:
        row, result = work(pair, clock)
    except (OutputError, DeviceError, ClusterError):
        raise
    except (SeeColorError, CalibrationError) as error:
        kept = (
            f" (results of an earlier run are in {SET_ASIDE})"
            if folder.frames.remove_stale(pair.name)
            else ""
        )
        row = FrameRow(pair.name, status="failed", error=f"{error}{kept}")
        failure = error.with_traceback(None)
    named = replace(
        row,
        left=str(pair.left),
        right=str(pair.right),
        timestamp_s=pair.timestamp_s,
        seconds=clock.seconds,
    )
    return Outcome(
        named,
        result if keep else None,
        failure,
        folder.frames.written.stages(pair.name),
        tuple(folder.owned.set_aside),
    )


class DiveRun:
    """A command at work on the pairs of a dive.

    pairs: of the dive. plan: of their cost, None where OUT holds none. frames: what work on a pair
    needs. page: makes the page's files of frames with their colors.
    table: the outcome of each pair so far. notes: remarks on the dive as a whole. summary: of the
    run, once it has ended.
    """

    def __init__(
        self,
        source: PairSource,
        folder: RunFolder,
        options: RunOptions,
        pairing: Pairing,
        passes: Sequence[str],
        page: PageFiles | None = None,
    ) -> None:
        """passes: of the command, over the pairs. Pixels are kept from one to the next."""
        self.pairs: Sequence[Pair] = pairing.pairs
        self.plan = KeptPlan.load(folder.root, KeptPlan.key(len(self.pairs), source.config))
        self.folder, self.options, self.page = folder, options, page
        self.frames = Frames(
            source,
            folder,
            KeptPixels(folder.root if len(passes) > 1 else None),
            options.verify,
            pairing.left_out,
        )
        self.table, self.summary = FrameTable(), RunSummary(())
        self.notes: tuple[str, ...] = ()
        self._repeated = RepeatedImages()
        expected = ExpectedPasses(self.plan.pass_seconds, planned=True) if self.plan else USUAL
        self._progress = ProgressFile(folder.root, expected.of(*passes))

    @property
    def good_pairs(self) -> Sequence[Pair]:
        """The pairs that have not failed so far."""
        return (
            chosen(self.pairs, lambda pair: pair.name not in self.table.failed)
            if self.table.failed
            else self.pairs
        )

    def begin(self, stage: str, pairs: int) -> None:
        """Say that a pass over so many pairs begins."""
        self.options.listener.begin(stage, pairs)
        self._progress.begin(stage, pairs)

    def advance(self, row: FrameRow) -> None:
        """Say that a pair is through the pass."""
        self._progress.advance(row)
        self.options.listener.advance(row)

    def map(
        self, stage: str, work: Work[Result], pairs: Sequence[Pair], keep: bool = False
    ) -> Iterator[Outcome[Result]]:
        """Do ``work`` on these pairs, in a pass of its own; the outcomes of those that did not
        fail, in order. keep: with the results, and not the rows alone.
        """
        of_pair = partial(attempt, work, self.folder, keep)
        return filter(None, map(self.note, self.outcomes(stage, of_pair, pairs, len(pairs))))

    def outcomes(
        self, stage: str, work: Callable[[Item], Result], items: Sequence[Item], pairs: int
    ) -> Iterator[Result]:
        """``work`` on each item, a pair or a group, where the run works; ``pairs`` in all."""
        self.begin(stage, pairs)
        return self.options.compute.each(work, items)

    def note(self, outcome: Outcome[Result]) -> Outcome[Result] | None:
        """Note the outcome of a pair, and return it unless the pair failed. Raises its error where
        the run is to stop at the first bad pair.
        """
        row = outcome.row
        self.folder.frames.note(row.name, outcome.written, outcome.aside)
        if self.table.row(row.name) is None and (again := self._repeated.warning(row)):
            row = replace(row, warnings=(*row.warnings, again))
        self.table.add(row)
        self.advance(row)
        if outcome.failure and self.options.strict:
            raise outcome.failure
        return None if outcome.failure else outcome
