"""The interfaces of a frame's stages: Source measures a pair, PageMaker makes its page; and Ranged, a pair with a known range."""

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
    """Reads and measures a pair: a Pipeline, or RangedImages.

    geometry: of the rectified images, None without calibration. makes_ranges: whether its range maps are written to OUT.
    seen: where rectified images show something, None = everywhere. original: the view of the unrectified left camera, None where
    nothing is written in it. settings: hash of all that a range map depends on besides its files.
    """

    config: RunConfig
    corrector: Corrector
    reader: FrameReader
    geometry: RectifiedPair | None
    makes_ranges: bool
    seen: Mask | None
    original: OriginalView | None
    settings: str

    def inputs(self, pair: Pair) -> dict[str, Path]:
        """The pair's files, by side."""

    def raw(self, pair: Pair, clock: Clock) -> Image:
        """The left image as the camera gave it."""

    def image(self, pair: Pair, clock: Clock) -> Image:
        """The (rectified) left image."""

    def measure(self, pair: Pair, clock: Clock) -> tuple[Image, RangeMap]:
        """The (rectified) left image and its range map."""


class PageMaker(Protocol):
    """Makes the page's files of some frames."""

    @property
    def names(self) -> frozenset[str]:
        """Names of the frames whose files are made."""

    def stage(self, corrected_key: str) -> StageRecord:
        """The record of a frame's files on the page. corrected_key: key of the corrected frame that they are made from."""

    def files(self, name: str, before: Image, products: Mapping[str, NDArray[Any]]) -> Files:
        """The page's files of a frame. before: its rectified image, uncorrected. products: product -> array, as it is stored."""


@dataclass(frozen=True, eq=False)
class Ranged:
    """A pair whose range is known. record: OUT's record of it. key: hash of all that its range depends on.

    pixels: its left image and range map, where they were measured just now. kept: True where an earlier run had measured them.
    """

    pair: Pair
    record: FrameRecord
    key: str
    pixels: tuple[Image, RangeMap] | None = None
    kept: bool = True

    @property
    def row(self) -> FrameRow:
        """The frame's row after the range stage."""
        stage = self.record.stages["range"]
        hashes = {side: file.sha256 for side, file in self.record.inputs.items()}
        return FrameRow(self.pair.name, kept=self.kept, warnings=stage.warnings, hashes=hashes, facts=dict(stage.facts))
