"""Nearest neighbors in a cloud."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereo_seecolor.compute.threads import cores


def nearest_distance_m(queries_m: NDArray[np.floating], points_m: NDArray[np.floating], reach_m: float) -> NDArray[np.float64]:
    """Distance of each query (N, 3) to the nearest of the points (M, 3), meters; infinite beyond ``reach_m``."""
    tree = cKDTree(points_m, balanced_tree=False, compact_nodes=False)
    bound = np.nextafter(reach_m, np.inf)  # scipy leaves out what lies exactly at its bound
    return np.asarray(tree.query(queries_m, distance_upper_bound=bound, workers=cores())[0], np.float64)
