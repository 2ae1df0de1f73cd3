"""Runs the matcher on a noise image, so that it is compiled (``compute/compiled.py``)."""

import numpy as np

from calibration import RectifiedPair
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.matching import diagnostics
from stereo_seecolor.matching.disparity import MatchedDisparity
from stereo_seecolor.matching.gray import GrayPair, shrink
from stereo_seecolor.matching.matcher import Matcher, disparity_limits
from stereo_seecolor.matching.sgm.search import SemiGlobalMatching, is_first_run
from stereo_seecolor.records import StereoFrame

PAIR = RectifiedPair(
    focal_px=160, cx_left_px=96, cx_right_px=96, cy_px=64, baseline_m=0.1, image_size=(192, 128)
)
SHIFT_PX = 5


def warm_up_matching() -> None:
    """Run smoothing, census, search and its diagnostics on noise, so that they are compiled."""
    frame = _noise()
    pair = GrayPair.from_frame(frame, 2)
    found = SemiGlobalMatching(*disparity_limits(PAIR, MatchingConfig())).find(frame, pair)
    diagnostics.vertical_disparity_px(pair.left, pair.right, found.disparity)


def load_search() -> None:
    """Load the compiled search from disk, if there; else each process compiles it."""
    if not is_first_run():
        warm_up_matching()


def warm_up_quality() -> None:
    """Run all steps after the search on noise, so that they are compiled."""
    frame = _noise()
    # gray() is compiled elsewhere
    left, right = (image[..., 1].astype(np.uint16) * 256 for image in (frame.left, frame.right))
    pair = GrayPair(left, right, shrink(left, 2), shrink(right, 2), 2)
    disparity = np.full(pair.left.shape, SHIFT_PX, np.float32)
    found = MatchedDisparity(disparity, disparity.copy(), np.ones_like(disparity))
    Matcher(PAIR, MatchingConfig()).range_map(found, pair)


def _noise() -> StereoFrame:
    width, height = PAIR.image_size
    left = np.random.default_rng(0).integers(30, 220, (height, width, 3), np.uint8)
    return StereoFrame("noise", left, np.roll(left, -SHIFT_PX, axis=1))
