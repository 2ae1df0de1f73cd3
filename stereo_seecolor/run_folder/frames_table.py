"""frames.csv: a row for each pair and each file without a partner; nothing is left out."""

import csv
import io
import pickle
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.errors import printable

Status = Literal["ok", "failed", "unpaired"]
_PATH = re.compile(r"^\S*/.*?: ")
_NUMBER = re.compile(r"[-+]?\d[\d.]*")


@dataclass(frozen=True, slots=True)
class FrameRow:
    """What became of one pair, or of one file without a partner.

    kept: an earlier run had finished it. hashes: SHA-256 of its files, by side. seconds: a stage's name -> seconds.
    facts: shares and parameters, by column.
    """

    name: str
    status: Status = "ok"
    left: str = ""
    right: str = ""
    timestamp_s: float | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()
    kept: bool = False
    hashes: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)

    @property
    def line(self) -> str:
        """What became of it, for a person: the name once, also where the error begins with it."""
        return f"{self.status}: {self.name}: {self.error.removeprefix(f'{self.name}: ')}"

    def then(self, later: "FrameRow") -> "FrameRow":
        """This row after a later stage: times add up, what a stage says again is said once, kept only if both were."""
        seconds = {key: self.seconds.get(key, 0.0) + later.seconds.get(key, 0.0) for key in self.seconds | later.seconds}
        return replace(
            later,
            left=later.left or self.left,
            right=later.right or self.right,
            timestamp_s=self.timestamp_s if later.timestamp_s is None else later.timestamp_s,
            warnings=tuple(dict.fromkeys(self.warnings + later.warnings)),
            kept=self.kept and later.kept,
            hashes=self.hashes | later.hashes,
            seconds=seconds,
            facts=self.facts | later.facts,
        )


_NOTHING: dict[str, Any] = {}


class FrameTable(Lazy[FrameRow]):
    """A dive's rows in the order they came; each is made anew when asked for.

    There are thousands of them, so numbers and hashes are kept packed, in blocks of at most 512 bytes: those have memory of their
    own in Python, where they do not hold up what images leave.
    """

    def __init__(self) -> None:
        self._texts: list[FrameRow] = []
        self._numbers: list[bytes] = []
        self._places: dict[str, int] = {}

    def add(self, row: FrameRow) -> None:
        """The row of a pair or a file, which its left path tells from the others; or what a later stage has to say of it."""
        place = self._places.setdefault(row.left, len(self))
        if place == len(self):
            self._texts.append(row)
            self._numbers.append(b"")
        else:
            row = self[place].then(row)
        self._texts[place] = replace(row, hashes=_NOTHING, seconds=_NOTHING, facts=_NOTHING)
        self._numbers[place] = pickle.dumps((row.hashes, row.seconds, row.facts))

    def __len__(self) -> int:
        return len(self._texts)

    def item(self, number: int) -> FrameRow:
        """A row."""
        hashes, seconds, facts = pickle.loads(self._numbers[number])
        return replace(self._texts[number], hashes=hashes, seconds=seconds, facts=facts)


@dataclass(frozen=True)
class RunSummary:
    """The end of a run. wall_seconds: from start to end; stopped: it was interrupted; notes: what concerns the whole dive."""

    rows: Sequence[FrameRow]
    notes: tuple[str, ...] = ()
    wall_seconds: float = 0.0
    stopped: bool = False

    @property
    def all_done(self) -> bool:
        """True if every file found its partner and every pair went through."""
        return not self.stopped and all(row.status == "ok" for row in self.rows)

    def count(self, status: Status) -> int:
        """Rows of that status."""
        return sum(row.status == status for row in self.rows)

    @property
    def kept(self) -> int:
        """Pairs that an earlier run had finished."""
        return sum(row.kept for row in self.rows)

    def totals(self) -> dict[str, Any]:
        """The numbers that a script wants, as JSON holds them."""
        return {
            "pairs": self.count("ok") + self.count("failed"),
            "ok": self.count("ok"),
            "failed": self.count("failed"),
            "unpaired_files": self.count("unpaired"),
            "kept": self.kept,
            "stopped": self.stopped,
            "wall_seconds": round(self.wall_seconds, 3),
            "stage_seconds": {stage: round(seconds, 3) for stage, seconds in self.stage_seconds().items()},
            "notes": list(self.notes),
        }

    def problems(self) -> list[tuple[str, int, str]]:
        """(what, how often, first name) of errors and warnings, the most frequent first; those that differ in numbers are one."""
        seen: Counter[str] = Counter()
        first: dict[str, tuple[str, str]] = {}
        for row in self.rows:
            for text in (*((row.error,) if row.error else ()), *row.warnings):
                what = _PATH.sub("", text).removeprefix(f"{row.name}: ")
                kind = _NUMBER.sub("", what)
                seen[kind] += 1
                first.setdefault(kind, (what, row.name))
        return [(first[kind][0], often, first[kind][1]) for kind, often in seen.most_common()]

    def stage_seconds(self) -> dict[str, float]:
        """Seconds a stage over all pairs, the slowest first."""
        total: Counter[str] = Counter()
        for row in self.rows:
            total.update(row.seconds)
        return dict(total.most_common())


def frames_csv(rows: Sequence[FrameRow]) -> Iterator[bytes]:
    """The rows as lines of UTF-8 CSV, columns in a fixed order, one ``<stage>_s`` column a stage."""
    facts = sorted({key for row in rows for key in row.facts})
    stages = sorted({key for row in rows for key in row.seconds})
    columns = ["name", "status", "kept", "left", "right", "timestamp_s", "error", "warnings"]
    yield _csv_line([*columns, *facts, *(f"{stage}_s" for stage in stages)])
    for row in rows:
        yield _csv_line(
            [row.name, row.status, int(row.kept), row.left, row.right, "" if row.timestamp_s is None else f"{row.timestamp_s:.9f}"]
            + [row.error, "; ".join(row.warnings)]
            + [f"{row.facts[key]:.6g}" if key in row.facts else "" for key in facts]
            + [f"{row.seconds[stage]:.4f}" if stage in row.seconds else "" for stage in stages]
        )


def _csv_line(cells: Sequence[object]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(printable(cell) if isinstance(cell, str) else cell for cell in cells)
    return text.getvalue().encode()
