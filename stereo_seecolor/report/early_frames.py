"""Makes the page's files of frames while the run has their pixels in memory, so that they need not
be decoded again.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.records import Image
from stereo_seecolor.report.frame_files import Files, Pixels, contents_of
from stereo_seecolor.run_folder.layout import page_path
from stereo_seecolor.run_folder.manifest import StageRecord

FORMAT = "6"
"""Version of the files of a frame; increased when their content changes, so that those of an
earlier program are made again.
"""


def page_stage(corrected_key: str, with_before: bool) -> StageRecord:
    """The record of a frame's files on the page, made from a corrected frame of that key.
    with_before: with its input image.
    """
    settings = content_key(FORMAT)
    return StageRecord(content_key(settings, corrected_key, with_before), settings)


@dataclass(frozen=True)
class EarlyFrames:
    """Makes the page's files of frames. geometry: of the rectified images."""

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
