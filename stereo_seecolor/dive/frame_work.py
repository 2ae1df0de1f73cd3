"""The work on one pair of a dive, as an object that can be sent to another process with all that it needs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from calibration import CalibrationError
from stereo_seecolor.color.photometry.survey import CountedFrames
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.names import ByName
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.dive.frame_stages import FrameStages
from stereo_seecolor.errors import ClusterError, DeviceError, OutputError, SeeColorError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import SET_ASIDE, Stage

Result = TypeVar("Result")
Work = Callable[[Pair, Clock], tuple[FrameRow, Result]]


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """The outcome of a pair. result: None where it failed; failure: the error then, else None.

    written: the stages whose files were written now. aside: files of the user that were moved to OUT/set_aside to make room.
    """

    row: FrameRow
    result: Result | None
    failure: Exception | None
    written: tuple[Stage, ...]
    aside: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class FrameWork(Generic[Result]):
    """``work`` on a pair; an error that concerns this pair alone goes into its row."""

    work: Work[Result]
    folder: RunFolder

    def __call__(self, pair: Pair) -> Outcome[Result]:
        """Do the work. Raises errors that concern every pair: OutputError (a full disk), DeviceError, ClusterError."""
        clock, result, failure = Clock(), None, None
        try:
            row, result = self.work(pair, clock)
        except (OutputError, DeviceError, ClusterError):
            raise
        except (SeeColorError, CalibrationError) as error:
            kept = f" (what an earlier run made of it is in {SET_ASIDE})" if self.folder.frames.retire(pair.name) else ""
            row, failure = FrameRow(pair.name, status="failed", error=f"{error}{kept}"), error.with_traceback(None)
        named = replace(row, left=str(pair.left), right=str(pair.right), timestamp_s=pair.timestamp_s, seconds=clock.seconds)
        return Outcome(named, result, failure, self.folder.frames.written.stages(pair.name), tuple(self.folder.owned.set_aside))


@dataclass(frozen=True, eq=False)
class GroupCount:
    """Counts the colors of neighboring pairs over range, and adds up their moment tables.

    known: an earlier pass has made the rows of these pairs, so that only times and errors are sent back.
    """

    work: FrameWork[MomentTable]
    config: ColorConfig
    known: bool = False

    def __call__(self, pairs: Sequence[Pair]) -> tuple[list[Outcome[bool]], CountedFrames]:
        """The outcome of each pair, and the sum over those that did not fail. Raises as the work on one pair."""
        outcomes: list[Outcome[bool]] = []

        def tables() -> Iterator[tuple[str, MomentTable]]:
            for pair in pairs:
                outcome = self.work(pair)
                row = replace(outcome.row, hashes={}, facts={}, left="", right="") if self.known else outcome.row
                outcomes.append(replace(outcome, row=row, result=outcome.result is not None))  # type: ignore[arg-type]
                if outcome.result is not None:
                    yield pair.name, outcome.result

        return outcomes, CountedFrames.of(tables(), self.config)


@dataclass(frozen=True, eq=False)
class CorrectFrame:
    """The second pass on a pair. usual: the water of all frames but ``others``: a worker is sent one water, not one a frame."""

    stages: FrameStages
    usual: Water
    others: Mapping[str, Water]

    @classmethod
    def of(cls, stages: FrameStages, waters: Mapping[str, Water]) -> "CorrectFrame":
        """The second pass with these waters, by frame name; at least one."""
        usual = next(iter(waters.values()))
        return cls(stages, usual, ByName((name, water) for name, water in waters.items() if water is not usual))

    def __call__(self, pair: Pair, clock: Clock) -> FrameRow:
        """Correct and write the frame; returns its row."""
        return self.stages.corrected(self.stages.ranged(pair, clock), self.others.get(pair.name, self.usual), clock)


def rows_alone(work: Callable[[Pair, Clock], FrameRow]) -> Work[bool]:
    """``work`` as a pass takes it, with True as its result."""
    return lambda pair, clock: (work(pair, clock), True)
