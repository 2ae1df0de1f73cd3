"""The table of a run: a row for each pair and unpaired file; problems, and summary."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from calibration.rig_errors import RangeError
from stereo_seecolor.compute.names import Names
from stereo_seecolor.compute.packed import Packed
from stereo_seecolor.records import FrameRow, Numbers, Status
from stereo_seecolor.run_folder.cache import Compared

_PATH = re.compile(r"^[^\s/]*/.*?: ")
_NUMBER = re.compile(r"[-+]?\d[\d.]*")


class FrameTable:
    """The rows of a dive in order of arrival. failed: name of a pair that failed -> why."""

    def __init__(self) -> None:
        self.failed: dict[str, str] = {}
        self._rows: Packed[FrameRow] = Packed()
        self._names = Names()

    def add(self, row: FrameRow) -> None:
        """Add the row of a pair, or extend the row that it has by what a later stage found."""
        if row.status == "failed":
            self.failed[row.name] = row.error
        place = self._names.add(row.name)
        if place == len(self._rows):
            self._rows.append(row)
        else:
            self._rows.replace(place, self._rows[place].then(row))

    @property
    def rows(self) -> Sequence[FrameRow]:
        """All rows."""
        return self._rows

    def row(self, name: str) -> FrameRow | None:
        """Find the row of a pair; None where there is none."""
        place = self._names.number(name)
        return None if place is None else self._rows[place]


@dataclass(frozen=True)
class ProductSummary:
    """A product in OUT. path: where. what: what it holds. source: whether this run wrote it."""

    path: Path
    what: str
    source: Literal["written", "kept from an earlier run", "partly kept from an earlier run"]


@dataclass(frozen=True)
class RunSummary:
    """The end of a run.

    notes: what concerns the whole dive. wall_seconds: from start to end. stopped: it was
    interrupted. products: what is current.
    plan: what was planned, and what it took, where a plan of these pairs and settings lay in OUT.
    of_dive: pairs of the whole dive, for a shard of it. missing_shards: of the dive, which were not
    merged. wrong: numbers of the dive as a whole that
    are wrong, as notes say. ranges: the error of ranges, where the check of the dive measured it.
    """

    rows: Sequence[FrameRow]
    notes: tuple[str, ...] = ()
    wall_seconds: float = 0.0
    stopped: bool = False
    products: tuple[ProductSummary, ...] = ()
    plan: Compared | None = None
    of_dive: int = 0
    missing_shards: tuple[str, ...] = ()
    wrong: frozenset[Numbers] = frozenset()
    ranges: RangeError | None = None

    @property
    def all_done(self) -> bool:
        """Tell whether every file of the whole dive found its partner, every pair went through, and
        no check found numbers of the dive wrong.
        """
        unfinished = self.stopped or self.missing_shards or self.count("ok") != len(self.rows)
        return not unfinished and not self.wrong

    def count(self, status: Status) -> int:
        """The number of rows of that status."""
        return self._tally.counts[status]

    @property
    def kept(self) -> int:
        """The number of pairs that an earlier run had finished."""
        return self._tally.kept

    @cached_property
    def _tally(self) -> "_Tally":
        """The sums over all rows, in one pass: the rows of a large dive are unpacked one by one."""
        counts, seconds, kept = Counter[str](), Counter[str](), 0
        for row in self.rows:
            counts[row.status] += 1
            seconds.update(row.seconds)
            kept += row.kept
        return _Tally(counts, kept, seconds)

    def totals(self) -> dict[str, Any]:
        """The totals of the run as JSON stores them."""
        return {
            "pairs": self.count("ok") + self.count("failed"),
            "ok": self.count("ok"),
            "failed": self.count("failed"),
            "unpaired_files": self.count("unpaired"),
            "pending": self.count("pending"),
            "kept": self.kept,
            "stopped": self.stopped,
            "wall_seconds": round(self.wall_seconds, 3),
            "stage_seconds": {
                stage: round(seconds, 3) for stage, seconds in self.stage_seconds().items()
            },
            "notes": list(self.notes),
            **{f"{numbers}_are_wrong": True for numbers in sorted(self.wrong)},
            **({"range_error": asdict(self.ranges)} if self.ranges else {}),
            **({"pairs_of_dive": self.of_dive} if self.of_dive else {}),
            **({"missing_shards": list(self.missing_shards)} if self.missing_shards else {}),
            **({"plan": asdict(self.plan)} if self.plan else {}),
        }

    def problems(self) -> list[tuple[str, int, str]]:
        """List errors and warnings, the most frequent first, as (what, how often, first name);
        those that differ in numbers alone count as one.
        """
        return [
            (problem.what, len(problem.names), problem.names[0])
            for problem in problems_of(self.rows)
        ]

    def stage_seconds(self) -> dict[str, float]:
        """Sum the seconds of each stage over all pairs, the slowest first."""
        return dict(self._tally.seconds.most_common())


@dataclass(frozen=True)
class _Tally:
    """counts: rows of each status. kept: pairs that an earlier run had finished. seconds: of each
    stage, over all rows.
    """

    counts: Counter[str]
    kept: int
    seconds: Counter[str]


@dataclass(frozen=True)
class Problem:
    """A kind of error or warning. what: its first text. names: of its frames, in order."""

    what: str
    names: tuple[str, ...]


def kind_of(text: str) -> str:
    """The same for texts that differ in numbers alone."""
    return _NUMBER.sub("", text)


def problems_of(rows: Sequence[FrameRow]) -> list[Problem]:
    """Group errors and warnings by text without numbers, the most frequent first."""
    seen: dict[str, tuple[str, list[str]]] = {}
    for row in rows:
        for text in (*((row.error,) if row.error else ()), *row.warnings):
            what = _PATH.sub("", text).removeprefix(f"{row.name}: ")
            seen.setdefault(kind_of(what), (what, []))[1].append(row.name)
    return sorted(
        (Problem(what, tuple(names)) for what, names in seen.values()),
        key=lambda problem: -len(problem.names),
    )
