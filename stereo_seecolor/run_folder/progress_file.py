"""How far a run is, kept in OUT while it works, for ``status``."""

import json
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

from stereo_seecolor.files.atomic import write_replaceable
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.layout import progress_file

EVERY_S = 2.0
"""Seconds between two writings: often enough for a person who looks on, and nothing beside the files of a pair."""


@dataclass(frozen=True)
class Progress:
    """How far a pass over a dive is. began_s, updated_s: seconds since 1970. failures: reason, how often, first frame."""

    stage: str
    total: int
    done: int
    failed: int
    began_s: float
    updated_s: float
    failures: list[tuple[str, int, str]] = field(default_factory=list)

    @property
    def ends_s(self) -> float | None:
        """When the pass will end at the rate so far, seconds since 1970; None before its first pair."""
        if not self.done:
            return None
        return self.began_s + (self.updated_s - self.began_s) * self.total / self.done

    @classmethod
    def load(cls, root: Path) -> "Progress | None":
        """The latest that was written; None where there is none, or it is damaged."""
        try:
            content = json.loads(progress_file(root).read_bytes())
            return cls(**{**content, "failures": [(str(a), int(b), str(c)) for a, b, c in content["failures"]]})
        except (OSError, ValueError, TypeError, KeyError):
            return None


class ProgressFile:
    """Hears of every pair of a pass, as a listener does, and writes now and then how far it is."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._failed: list[FrameRow] = []
        self._stage, self._total, self._done = "", 0, Counter[str]()
        self._began_s = self._written_s = 0.0

    def begin(self, stage: str, total: int) -> None:
        """A pass over ``total`` pairs begins. Raises OutputError."""
        self._stage, self._total, self._failed, self._done = stage, total, [], Counter()
        self._began_s = time.time()
        self._write()

    def advance(self, row: FrameRow) -> None:
        """One more pair is through the pass. Raises OutputError."""
        self._done[row.status] += 1
        self._failed += [row] if row.status == "failed" else []
        if time.time() - self._written_s >= EVERY_S or self._done.total() == self._total:
            self._write()

    def _write(self) -> None:
        self._written_s = time.time()
        failures = RunSummary(self._failed).problems()
        done, failed = self._done.total(), self._done["failed"]
        progress = Progress(self._stage, self._total, done, failed, self._began_s, self._written_s, failures)
        write_replaceable(progress_file(self._root), json.dumps(asdict(progress)).encode())
