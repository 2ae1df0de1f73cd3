"""Relative poses that are known before the track is followed: rough, but enough for a first look at a map."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.components import chain
from stereo_seecolor.mapping.track.relative_pose import Edge

STEP = np.dtype([("i", np.int64), ("j", np.int64), ("T_i_j", np.float32, (4, 4)), ("inliers", np.int32)])
"""A pose of frame j in frame i, and how many points agree with it."""


def placed_by(steps: NDArray[np.void], count: int) -> Placement | None:
    """Chain the strongest steps to poses of the frames; None without any. count: number of frames."""
    edges = [Edge(int(s["i"]), int(s["j"]), s["T_i_j"].astype(np.float64), np.eye(6), int(s["inliers"])) for s in steps]
    return Placement(*chain(edges, np.arange(count))) if edges else None
