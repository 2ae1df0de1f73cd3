"""What a frame's stages work with: what measures a pair, what makes its page, and a pair whose range is known."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.original_view import OriginalView
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.frames import FrameReader
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import FrameRow, Image, Mask, RangeMap
from stereo_seecolor.run_folder.manifest import FrameRecord, StageRecord
from stereo_seecolor.run_folder.products import Files


class Source(Protocol):
    """What measures a pair: a Pipeline, or RangedImages. makes_ranges: whether its range maps are written to OUT."""

    config: RunConfig
    corrector: Corrector
    reader: FrameReader
    geometry: RectifiedPair | None
    makes_ranges: bool
    seen: Mask | None
    original: OriginalView | None
    settings: str

    def inputs(self, pair: Pair) -> dict[str, Path]:
        """The pair's files."""

    def raw(self, pair: Pair, clock: Clock) -> Image:
        """The left image as the camera gave it."""

    def image(self, pair: Pair, clock: Clock) -> Image:
        """The (rectified) left image."""

    def measure(self, pair: Pair, clock: Clock) -> tuple[Image, RangeMap]:
        """That image and its range map."""


class PageMaker(Protocol):
    """Makes what the page shows of the frames of these names."""

    @property
    def names(self) -> frozenset[str]:
        """Of the frames to make."""

    def stage(self, corrected_key: str) -> StageRecord:
        """The record of a frame's page."""

    def files(self, name: str, before: Image, products: Mapping[str, NDArray[Any]]) -> Files:
        """The page's files of a frame, from its rectified image and its products as they are stored."""


@dataclass(frozen=True, eq=False)
class Ranged:
    """A pair whose range is known. record: what OUT knows of it. key: hash of all that its range depends on.

    pixels: its image and range map where this run measured them just now. kept: an earlier run had.
    """

    pair: Pair
    record: FrameRecord
    key: str
    pixels: tuple[Image, RangeMap] | None = None
    kept: bool = True

    @property
    def row(self) -> FrameRow:
        """What is known of the frame so far."""
        stage = self.record.stages["range"]
        hashes = {side: file.sha256 for side, file in self.record.inputs.items()}
        return FrameRow(self.pair.name, kept=self.kept, warnings=stage.warnings, hashes=hashes, facts=dict(stage.facts))
