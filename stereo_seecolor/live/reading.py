"""Both images of a pair at once: a pair that is waited for uses all cores."""

from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import StereoFrame


def read_sides(pair: Pair, config: InputConfig) -> StereoFrame:
    """The images of a pair's two files, not rectified. Raises InputError if one cannot be read."""
    left, right = core_pool().map(lambda path: read_image(path, config), (pair.left, pair.right))
    return StereoFrame(pair.name, left, right, pair.timestamp_s)
