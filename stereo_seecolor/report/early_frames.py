"""What the page shows of a frame, made while the run has its pixels in memory: afterwards all of them had to be decoded again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.records import Image
from stereo_seecolor.report.frame_files import Files, Pixels, contents_of
from stereo_seecolor.run_folder.layout import page_path
from stereo_seecolor.run_folder.manifest import StageRecord

FORMAT = "2"
"""Raised where the files of a frame change their content: those of an earlier program are then made again."""
BRIEF_FRAMES = 24
"""Frames, spread over the dive, that a brief page shows whole; of the others it shows the corrected images themselves.

Of a pair of 1280x1024 this takes some 50 ms of processor time while the run has it in memory: 1 % of a run over 500 pairs.
"""


def page_stage(corrected_key: str, with_before: bool) -> StageRecord:
    """The record of a frame's page, made of a corrected frame of that key. with_before: its input image was there."""
    settings = content_key(FORMAT)
    return StageRecord(content_key(settings, corrected_key, with_before), settings)


def spread(names: Sequence[str]) -> list[str]:
    """The frames of a dive that a brief page shows whole, but for the examples."""
    return list(names[:: -(-len(names) // BRIEF_FRAMES) or 1])


@dataclass(frozen=True)
class EarlyFrames:
    """Makes the page's files of the frames of these names. geometry: of the rectified images."""

    names: frozenset[str]
    geometry: RectifiedPair | None

    def stage(self, corrected_key: str) -> StageRecord:
        """The record of a frame's page, made of a corrected frame of that key."""
        return page_stage(corrected_key, with_before=True)

    def files(self, name: str, before: Image, products: Mapping[str, NDArray[Any]]) -> Files:
        """before: the rectified image as the camera saw it. products: the frame's, as stored, by name."""
        contents = contents_of(Pixels(name, products, products.__getitem__), before, self.geometry)
        return {product: (page_path(product, name), content) for product, content in contents.items()}
