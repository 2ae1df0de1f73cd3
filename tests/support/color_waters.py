"""Waters that several tests of color begin from."""

import numpy as np

from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.records import Water


def clear_water(encoding: InputEncoding) -> Water:
    """Water that changes nothing."""
    return Water(*np.zeros((8, 3)), input_encoding=encoding)
