"""OUT/index.html while a run works: its progress, problems so far, and its latest pair."""

import base64
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.previews import LIVE, preview, range_picture
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import FrameRow, Image
from stereo_seecolor.report.frame_files import Files, Pixels, contents_of
from stereo_seecolor.report.overview import NAMED_FRAMES, Fact, RowFacts, judge_so_far
from stereo_seecolor.report.texts import STATIC, filled_in, length, phrase
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import FrameTable
from stereo_seecolor.run_folder.layout import INDEX, PAGE, page_path
from stereo_seecolor.run_folder.manifest import StageRecord

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
        return filled_in(
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
        """(label, data address) of the images that a pair has so far; images that cannot be read
        are left out.
        """
        made: list[tuple[str, str]] = []
        record = self.folder.manifest.frame(row.name)
        current = (
            [stage for stage in record.stages if self.folder.dive.record.is_current(record, stage)]
            if record
            else []
        )
        try:
            made.append((phrase("live.left"), _address(read_image(Path(row.left), self.images))))
            if record and "range" in current:
                picture, near_m, far_m = range_picture(self.folder.frames.read(record, "range"))
                label = (
                    phrase("live.range", low=length(near_m), high=length(far_m))
                    if np.isfinite(near_m)
                    else phrase("view.unknown")
                )
                made.append((label, _address(picture)))
            if record and "corrected" in current:
                made.append(
                    (
                        phrase("live.corrected"),
                        _address(self.folder.frames.read(record, "corrected")),
                    )
                )
        except (InputError, FrameError):
            pass
        return made


def _address(pixels: NDArray[Any]) -> str:
    """A data address, which holds an image within the page, so that page and image are always
    written together.
    """
    return f"data:image/jpeg;base64,{base64.b64encode(preview(pixels, LIVE)).decode('ascii')}"


# Makes the page's files of some frames while the run has their pixels in memory, so that they
# need not be decoded again.

FORMAT = "2"
"""Version of the files of a frame; increased when their content changes, so that those of an
earlier program are made again.
"""
BRIEF_FRAMES = 24
"""Frames, spread over the dive, that a brief page shows in full; of the others it shows only the
corrected images.

A pair of 1280x1024 takes some 50 ms of processor time while the run has it in memory: 1 % of a run
over 500 pairs.
"""


def page_stage(corrected_key: str, with_before: bool) -> StageRecord:
    """The record of a frame's files on the page, made from a corrected frame of that key.
    with_before: with its input image.
    """
    settings = content_key(FORMAT)
    return StageRecord(content_key(settings, corrected_key, with_before), settings)


def frames_in_full(names: Sequence[str]) -> list[str]:
    """The frames of a dive that a brief page shows in full, besides the examples."""
    return list(names[:: -(-len(names) // BRIEF_FRAMES) or 1])


@dataclass(frozen=True)
class EarlyFrames:
    """Makes the page's files of the frames of these names. geometry: of the rectified images."""

    names: frozenset[str]
    geometry: RectifiedPair | None

    def stage(self, corrected_key: str) -> StageRecord:
        """The record of a frame's files on the page, made from a corrected frame of that key."""
        return page_stage(corrected_key, with_before=True)

    def files(self, name: str, before: Image, products: Mapping[str, NDArray[Any]]) -> Files:
        """The page's files of a frame. before: its rectified image, uncorrected. products: product
        -> array, as it is stored.
        """
        contents = contents_of(Pixels(name, products, products.__getitem__), before, self.geometry)
        return {
            product: (page_path(product, name), content) for product, content in contents.items()
        }
