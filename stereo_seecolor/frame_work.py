"""The work on one pair of a dive, as an object that can be sent to another process with all that it needs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from calibration import CalibrationError
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.errors import ClusterError, DeviceError, OutputError, SeeColorError
from stereo_seecolor.frame_stages import FrameStages
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import SET_ASIDE, Stage

Result = TypeVar("Result")
Work = Callable[[Pair, Clock], tuple[FrameRow, Result]]


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """What became of a pair. result: None where it failed, and failure then says why.

    written: the stages whose files were written for it now. aside: files of somebody else that were moved out of their way.
    """

    row: FrameRow
    result: Result | None
    failure: Exception | None
    written: tuple[Stage, ...]
    aside: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class FrameWork(Generic[Result]):
    """``work`` on a pair; what is wrong with the pair becomes its row."""

    work: Work[Result]
    folder: RunFolder

    def __call__(self, pair: Pair) -> Outcome[Result]:
        """Raises what concerns every pair: OutputError for a full disk, DeviceError for an absent device."""
        clock, result, failure = Clock(), None, None
        try:
            row, result = self.work(pair, clock)
        except (OutputError, DeviceError, ClusterError):
            raise
        except (SeeColorError, CalibrationError) as error:
            kept = f" (what an earlier run made of it is in {SET_ASIDE})" if self.folder.retire(pair.name) else ""
            row, failure = FrameRow(pair.name, status="failed", error=f"{error}{kept}"), error.with_traceback(None)
        named = replace(row, left=str(pair.left), right=str(pair.right), timestamp_s=pair.timestamp_s, seconds=clock.seconds)
        written = tuple(stage for stage, names in self.folder.written.items() if pair.name in names)
        return Outcome(named, result, failure, written, tuple(self.folder.set_aside))


@dataclass(frozen=True, eq=False)
class Correction:
    """The second pass on a pair. usual: the water of all frames but ``others``, so that one water travels, not one a frame."""

    stages: FrameStages
    usual: Water
    others: Mapping[str, Water]

    @classmethod
    def of(cls, stages: FrameStages, waters: Mapping[str, Water]) -> "Correction":
        """For frames by name, of which there must be one."""
        usual = next(iter(waters.values()))
        return cls(stages, usual, {name: water for name, water in waters.items() if water is not usual})

    def __call__(self, pair: Pair, clock: Clock) -> FrameRow:
        """The frame without its water, written; its row."""
        return self.stages.corrected(self.stages.ranged(pair, clock), self.others.get(pair.name, self.usual), clock)


def rows_alone(work: Callable[[Pair, Clock], FrameRow]) -> Work[bool]:
    """Work of which nothing but the rows is wanted."""
    return lambda pair, clock: (work(pair, clock), True)
