"""OUT/index.html while a run works: its progress, problems so far, and its latest pair."""

import base64
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.files.previews import LIVE, preview, range_picture
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import FrameRow
from stereo_seecolor.report.facts import RowFacts
from stereo_seecolor.report.overview import NAMED_FRAMES, Fact
from stereo_seecolor.report.templates import render_template
from stereo_seecolor.report.texts import STATIC, length, phrase
from stereo_seecolor.report.verdict import judge_so_far
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import FrameTable
from stereo_seecolor.run_folder.layout import INDEX, PAGE

ASSETS = ("page.css", "live.js")
MADE_LIVE = "live"
"""Source of the page in the manifest: a finished run always replaces it."""


@dataclass(frozen=True)
class LivePace:
    """How often the page is written."""

    every_s: float = 5.0  # as a person looks on; the browser loads the page as often
    # of the run's time goes into its page: large images are shown less often
    most_of_time: float = 0.01


PACE = LivePace()


@dataclass(eq=False)
class LivePage:
    """A listener that writes the page every few seconds. dive: the name of the dive."""

    folder: RunFolder
    dive: str
    images: InputConfig
    _table: FrameTable = field(default_factory=FrameTable)
    _stage: str = ""
    _total: int = 0
    _done: int = 0
    _next_s: float = 0.0
    _latest: FrameRow | None = None

    def begin(self, stage: str, total: int) -> None:
        """A pass over ``total`` pairs begins. Raises OutputError."""
        self._stage, self._total, self._done = stage, total, 0
        for name in ASSETS:
            self.folder.dive.write(f"{PAGE}/{name}", (STATIC / name).read_bytes())
        self._write()
        self._next_s = 0.0  # the first pair is shown at once

    def advance(self, row: FrameRow) -> None:
        """Count a finished pair; write the page if it is time. Raises OutputError."""
        self._table.add(row)
        self._done += 1
        if time.monotonic() >= self._next_s:
            self._latest = row
            self._write()

    def _write(self) -> None:
        began_s = time.monotonic()
        self.folder.dive.write(INDEX, self._render(), made_from=MADE_LIVE)
        ended_s = time.monotonic()
        self._next_s = ended_s + max(PACE.every_s, (ended_s - began_s) / PACE.most_of_time)

    def _render(self) -> bytes:
        facts, now_s = RowFacts(tuple(self._table.rows)), time.time()
        return render_template(
            "live.html.j2",
            t=phrase,
            dive=self.dive,
            stage=self._stage,
            done=self._done,
            total=self._total,
            clock=time.strftime("%H:%M:%S", time.localtime(now_s)),
            updated_s=round(now_s),
            reload_s=PACE.every_s,
            verdict=judge_so_far(facts),
            dive_facts=self._facts(facts),
            latest=self._latest.name if self._latest else "",
            pictures=self._pictures(self._latest) if self._latest else [],
            problems=facts.problems,
            named_frames=NAMED_FRAMES,
        )

    def _facts(self, facts: RowFacts) -> list[Fact]:
        range_m, coverage = facts.typical("median_range_m"), facts.typical("coverage")
        values = {
            "live.pairs": phrase("live.pairs_value", done=self._done, total=self._total),
            "live.failed": str(facts.count("failed")),
            "fact.range": range_m and length(range_m),
            "fact.coverage": coverage and phrase("fact.coverage_value", percent=f"{coverage:.0%}"),
        }
        return [Fact(phrase(key), value) for key, value in values.items() if value]

    def _pictures(self, row: FrameRow) -> list[tuple[str, str]]:
        """(label, data address) of a pair's images so far; unreadable ones are left out."""
        made: list[tuple[str, str]] = []
        record = self.folder.manifest.frame(row.name)
        dive = self.folder.dive.record
        current = [one for one in record.stages if dive.is_current(record, one)] if record else []
        try:
            made.append((phrase("live.left"), _address(read_image(Path(row.left), self.images))))
            if record and "range" in current:
                picture, near_m, far_m = range_picture(self.folder.frames.read(record, "range"))
                label = phrase("view.unknown")
                if np.isfinite(near_m):
                    label = phrase("live.range", low=length(near_m), high=length(far_m))
                made.append((label, _address(picture)))
            if record and "corrected" in current:
                corrected = self.folder.frames.read(record, "corrected")
                made.append((phrase("live.corrected"), _address(corrected)))
        except (InputError, FrameError):
            pass
        return made


def _address(pixels: NDArray[Any]) -> str:
    """A data address, which holds an image within the page: both are always written together."""
    return f"data:image/jpeg;base64,{base64.b64encode(preview(pixels, LIVE)).decode('ascii')}"
