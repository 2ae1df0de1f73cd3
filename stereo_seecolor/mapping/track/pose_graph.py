"""The pose graph of all relative poses, by GTSAM's sparse solver with a robust kernel."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import DeviceError
from stereo_seecolor.mapping.track.relative_pose import Edge

REJECT_SIGMAS = 6.0
"""An edge of a loop further off than this is false."""
CAUCHY = 3.0
"""Scale of the Cauchy kernel, in sigmas: edges within three of them keep most of their weight."""
WIDER, DRIFTED = (1000.0, 100.0, 10.0), 10.0
"""Scales before that one, from ten times what loops are usually off at the start, where that is
more than so many sigmas: a narrow kernel leaves out what closes a long dive's drift of meters as it
does what is false.
"""
UNKNOWN = 1e4
"""Standard error of what a prior does not say, meters."""


@dataclass(frozen=True, eq=False)
class Prior:
    """The pose that navigation gives a frame: T_world_camera (4, 4), and its standard errors;
    position_std_m: (3,) in world axes.
    """

    frame: int
    T_world_camera: NDArray[np.float64]
    position_std_m: NDArray[np.float64]
    attitude_std_rad: float


def available() -> bool:
    """Tell whether GTSAM can be imported."""
    try:
        gtsam_library()
    except DeviceError:
        return False
    return True


def solve(
    T_world_camera: NDArray[np.float64],
    frames: Sequence[int],
    edges: Sequence[Edge],
    priors: Sequence[Prior] = (),
) -> tuple[NDArray[np.float64], list[Edge]]:
    """Poses that agree best with edges and priors, and edges that do not fit: false loops.

    T_world_camera: (N, 4, 4) first guess; only ``frames`` are solved for, and the edges must
    connect them all; the first stays put where there are no priors. Levenberg-Marquardt under a
    Cauchy kernel, which false loops hardly bend, and which is narrowed step by step where the first
    guess has drifted; a loop beyond six sigmas is false.

    Raises DeviceError if GTSAM is missing.
    """
    gtsam = gtsam_library()
    solved = T_world_camera
    off = [_sigmas(gtsam, T_world_camera, edge) for edge in edges if edge.loop]
    usual = float(np.median(off)) if off else 0.0
    wider = [scale for scale in WIDER if scale < 10 * usual] if usual > DRIFTED else []
    for scale in (*wider, CAUCHY):
        solved = _optimize(gtsam, solved, frames, edges, priors, scale)
    return solved, [
        edge for edge in edges if edge.loop and _sigmas(gtsam, solved, edge) > REJECT_SIGMAS
    ]


def gtsam_library() -> Any:
    """GTSAM. Raises DeviceError if it is missing."""
    try:
        import gtsam
    except (ImportError, OSError) as error:
        what = "loop closure and navigation as a prior need GTSAM, which is missing"
        raise DeviceError(f"{what} ({error}): pip install 'stereo-seecolor[slam]'") from error
    return gtsam


def _optimize(
    gtsam: Any,
    T: NDArray[np.float64],
    frames: Sequence[int],
    edges: Sequence[Edge],
    priors: Sequence[Prior],
    scale: float,
) -> NDArray[np.float64]:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(scale)
    for frame in frames:
        values.insert(int(frame), gtsam.Pose3(T[frame]))
    noise = gtsam.noiseModel
    for edge in edges:
        gaussian = noise.Gaussian.Covariance(edge.covariance)
        robust = noise.Robust.Create(kernel, gaussian)
        graph.add(gtsam.BetweenFactorPose3(edge.i, edge.j, gtsam.Pose3(edge.T_i_j), robust))
    _add_priors(gtsam, graph, int(frames[0]), T, priors)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    solved = T.copy()
    for frame in frames:
        solved[frame] = result.atPose3(int(frame)).matrix()
    return solved


def _add_priors(
    gtsam: Any, graph: Any, first: int, T: NDArray[np.float64], priors: Sequence[Prior]
) -> None:
    """What is known of frames; without any, the first stays. T: (N, 4, 4) as they are now."""
    noise = gtsam.noiseModel
    for prior in priors:
        pose = gtsam.Pose3(prior.T_world_camera)
        graph.add(
            gtsam.GPSFactor(
                prior.frame, pose.translation(), noise.Diagonal.Sigmas(prior.position_std_m)
            )
        )
        attitude = np.array([prior.attitude_std_rad] * 3 + [UNKNOWN] * 3)
        graph.add(gtsam.PriorFactorPose3(prior.frame, pose, noise.Diagonal.Sigmas(attitude)))
    if not priors:
        graph.add(
            gtsam.PriorFactorPose3(first, gtsam.Pose3(T[first]), noise.Isotropic.Sigma(6, 1e-6))
        )


def _sigmas(gtsam: Any, T: NDArray[np.float64], edge: Edge) -> float:
    """How far an edge is from the solution, in its own standard deviations."""
    between = gtsam.Pose3(T[edge.i]).between(gtsam.Pose3(T[edge.j]))
    off = gtsam.Pose3(edge.T_i_j).localCoordinates(between)
    return float(np.sqrt(off @ np.linalg.solve(edge.covariance, off)))
