"""The progress of a run, kept in OUT while it works, for ``status``."""

import json
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

from stereo_seecolor.files.atomic import write_replaceable
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.layout import PROGRESS, state

EVERY_S = 2.0
"""Seconds between two writings: often enough for a person who looks on, and nothing beside the
files of a pair.
"""


@dataclass(frozen=True)
class ExpectedPasses:
    """The expected passes of a run. seconds: of one core for each pair, by pass in their order.
    planned: whether ``plan`` measured them on this dive.
    """

    seconds: dict[str, float]
    planned: bool = False

    def of(self, *passes: str) -> "ExpectedPasses":
        """Select these passes."""
        return ExpectedPasses(
            {name: self.seconds[name] for name in passes if name in self.seconds}, self.planned
        )


USUAL = ExpectedPasses({"ranges": 0.19, "light": 0.07, "waters": 0.01, "colors": 0.14})
"""Of pairs of 1280x1024 (docs/fleets.md). Larger pairs take longer, but about the same shares,
which are all that is used of it.
"""


@dataclass(frozen=True)
class RunProgress:
    """The progress of a pass over a dive. began_s, updated_s: seconds since 1970. failures: reason,
    how often, first frame.

    new: of the pairs that are done, those that no earlier run had done. earlier: passes before this
    one: name, new pairs, seconds.
    """

    stage: str
    total: int
    done: int
    failed: int
    began_s: float
    updated_s: float
    new: int
    earlier: list[tuple[str, int, float]]
    expected: ExpectedPasses
    failures: list[tuple[str, int, str]] = field(default_factory=list)


class ProgressFile:
    """A listener that writes the progress of passes every few seconds. expected: those to come."""

    def __init__(self, root: Path, expected: ExpectedPasses | None = None) -> None:
        self._root, self._expected = root, expected or ExpectedPasses({})
        self._failed: list[FrameRow] = []
        self._earlier: list[tuple[str, int, float]] = []
        self._stage, self._total, self._done, self._new = "", 0, Counter[str](), 0
        self._began_s = self._written_s = 0.0

    def begin(self, stage: str, total: int) -> None:
        """A pass over ``total`` pairs begins. Raises OutputError."""
        now_s = time.time()
        if self._stage:
            self._earlier.append((self._stage, self._new, now_s - self._began_s))
        self._stage, self._total, self._done, self._new = stage, total, Counter(), 0
        self._failed, self._began_s = [], now_s
        self._write()

    def advance(self, row: FrameRow) -> None:
        """Count a pair that is through the pass. Raises OutputError."""
        self._done[row.status] += 1
        self._new += not row.kept
        self._failed += [row] if row.status == "failed" else []
        if time.time() - self._written_s >= EVERY_S or self._done.total() == self._total:
            self._write()

    def _write(self) -> None:
        self._written_s = time.time()
        done, failed = self._done.total(), self._done["failed"]
        counts = self._stage, self._total, done, failed, self._began_s, self._written_s, self._new
        progress = RunProgress(
            *counts, self._earlier, self._expected, RunSummary(self._failed).problems()
        )
        write_replaceable(state(self._root, PROGRESS), json.dumps(asdict(progress)).encode())
