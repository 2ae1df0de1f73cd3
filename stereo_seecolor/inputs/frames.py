"""A pair's two files as one StereoFrame: pixels, and what the cameras recorded of them."""

from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.capture import read_capture
from stereo_seecolor.inputs.exposure import ExposureTable
from stereo_seecolor.inputs.images import decode_image, read_image_bytes
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Capture, StereoFrame


class FrameReader:
    """Reads pairs, from any thread. Raises InputError for an exposure table that cannot be read."""

    def __init__(self, config: InputConfig) -> None:
        self._config = config
        self._exposures = ExposureTable.read(config.exposures) if config.exposures else ExposureTable({})

    def read(self, pair: Pair) -> StereoFrame:
        """Both images, not rectified. Raises InputError if one cannot be read."""
        return self.decode(pair, read_image_bytes(pair.left), read_image_bytes(pair.right))

    def decode(self, pair: Pair, left: bytes, right: bytes) -> StereoFrame:
        """As read, from the contents of both files."""
        images = decode_image(left, pair.left, self._config), decode_image(right, pair.right, self._config)
        captures = self.captures(pair, left, right)
        return StereoFrame(pair.name, *images, pair.timestamp_s, *captures)

    def captures(self, pair: Pair, left: bytes, right: bytes) -> tuple[Capture, Capture]:
        """What the left and the right camera recorded."""
        return self._exposures.applied(read_capture(left), pair.left), self._exposures.applied(read_capture(right), pair.right)
