"""Reading of pairs: two files to one StereoFrame, with what the cameras recorded of them."""

from pathlib import Path

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import find_contained
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.capture import read_capture
from stereo_seecolor.inputs.exposure_table import ExposureTable
from stereo_seecolor.inputs.images import decode_image, read_image_bytes
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.seams import seam_row, seam_text
from stereo_seecolor.records import Capture, Image, StereoFrame

RAW_SUFFIX = ".tif"
"""Of what is raw pixels in a bag, or a video's frame: nothing is recorded beside them, so they need
not be read for that.
"""


class FrameReader:
    """Reads pairs, from any thread. Raises InputError for an exposure table that cannot be read.

    settings: hash of the settings and of the table.
    """

    def __init__(self, config: InputConfig) -> None:
        self._config = config
        self._exposures = (
            ExposureTable.read(config.exposures) if config.exposures else ExposureTable({})
        )
        rows = sorted(
            (name, row.exposure_s, row.gain) for name, row in self._exposures.rows.items()
        )
        self.settings = content_key(config.model_dump(), rows)

    def read(self, pair: Pair) -> StereoFrame:
        """Read both images, not rectified. Raises InputError if one is unreadable or damaged."""
        contents = {path: read_image_bytes(path) for path in (pair.left, pair.right)}
        images = [decode_image(content, path, self._config) for path, content in contents.items()]
        _refuse_damage(dict(zip(contents, images, strict=True)), contents)
        captures = [self._captured(path, content) for path, content in contents.items()]
        return StereoFrame(
            pair.name, images[0], images[-1], pair.timestamp_s, captures[0], captures[-1]
        )

    def capture(self, path: Path) -> Capture:
        """What the camera recorded beside the pixels. Raises InputError if it cannot be read."""
        is_raw = path.suffix == RAW_SUFFIX and find_contained(path)
        return self._captured(path, b"" if is_raw else read_image_bytes(path))

    def _captured(self, path: Path, content: bytes) -> Capture:
        return self._exposures.applied(read_capture(content), path)


def _refuse_damage(images: dict[Path, Image], contents: dict[Path, bytes]) -> None:
    """Raise InputError where one image of a pair begins anew at a row, and the other does not."""
    rows = {path: seam_row(image, contents[path]) for path, image in images.items()}
    found = [path for path, row in rows.items() if row is not None]
    if len(found) == 1:
        raise InputError(f"{found[0]}: {seam_text(rows[found[0]] or 0)}")
