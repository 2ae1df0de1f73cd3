"""Poses from relative poses of a simulated dive, some of which are false."""

import numpy as np
import pytest

from calibration.transforms import inverse, rigid_transform, rotation_from_vector
from stereo_seecolor.mapping.track.pose_graph import available, solve
from stereo_seecolor.mapping.track.relative_pose import Edge

LINES, LINE_FRAMES, STD_M, STD_RAD = 10, 200, 0.003, 0.002


def lawnmower() -> np.ndarray:
    """(N, 4, 4) cameras half a meter apart, on lines a meter apart."""
    line, along = np.divmod(np.arange(LINES * LINE_FRAMES), LINE_FRAMES)
    T = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(line), 1, 1))
    T[:, 0, 3] = 0.5 * np.where(line % 2 == 0, along, LINE_FRAMES - 1 - along)
    T[:, 1, 3], T[:, 2, 3] = line, 2
    return T


@pytest.mark.slow
@pytest.mark.skipif(not available(), reason="needs GTSAM")
def test_false_loops_are_told_from_the_drift_of_a_long_dive() -> None:
    T, rng = lawnmower(), np.random.default_rng(0)
    ends = [(j - back, j, False) for j in range(len(T)) for back in (1, 2, 3) if j >= back]
    ends += [
        (2 * LINE_FRAMES * (j // LINE_FRAMES) - 1 - j, j, True) for j in range(LINE_FRAMES, len(T))
    ]
    false_numbers = range(
        next(number for number, (*_, loop) in enumerate(ends) if loop), len(ends), 100
    )
    covariance = np.diag([STD_RAD**2] * 3 + [STD_M**2] * 3)
    edges = []
    for number, (i, j, loop) in enumerate(ends):
        false_m = rng.normal(0, 3, 3) if number in false_numbers else np.zeros(3)
        error = rigid_transform(
            rotation_from_vector(rng.normal(0, STD_RAD, 3)), rng.normal(0, STD_M, 3) + false_m
        )
        edges.append(Edge(i, j, inverse(T[i]) @ T[j] @ error, covariance, 100, loop))
    start = T.copy()
    for edge in (edge for edge in edges if edge.j - edge.i == 1):
        start[edge.j] = start[edge.i] @ edge.T_i_j
    solved, false = solve(start, range(len(T)), edges)
    assert [id(edge) for edge in false] == [id(edges[number]) for number in false_numbers]
    off_m = np.linalg.norm(solved[:, :3, 3] - T[:, :3, 3], axis=1)
    assert np.linalg.norm(start[:, :3, 3] - T[:, :3, 3], axis=1).max() > 0.5
    assert off_m.max() < 0.3
