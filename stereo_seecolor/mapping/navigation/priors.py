"""Given poses as priors: how far each is trusted, by what the track of the images shows."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from calibration.robust_statistics import ROBUST_DEVIATION, deviation_about_zero
from calibration.transforms import inverse, nearest_rotation, rigid_transform, rotation_vector
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.navigation.corrections import MAX_TURN_RAD
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.records import Array

FAR_OFF, ROUNDS = 8.0, 5
"""Standard deviations by which a position along an axis is far off: an outlier is no prior. They
are found in so many rounds.
"""
LEAST_OFF_M = 0.05
"""Standard deviation of positions, at least: less is no more than navigation's noise."""
MIN_FRAMES = 5
"""Fewer do not tell standard errors: the configuration's, or these, are taken."""
UNKNOWN_STD = (0.5, 0.05, np.radians(1.0))
"""Position east and north, depth (meters) and attitude (radians): a vehicle with USBL, a pressure
sensor and a compass.
"""
LEAST_STD = (0.005, 0.005, np.radians(0.05))
"""The same: better than this, voxels cannot tell."""


def priors(own: Placement, given: Placement, config: MappingConfig) -> list[Prior]:
    """The given poses as priors, with the configuration's standard errors, or those that the dive
    itself shows; without positions that are far off by these.

    own: placed by the images alone. Each of its components is brought to the given poses by one
    rigid motion; what is left is their error, the own track's drift included.
    """
    offsets, turns = [], []
    used = given.components >= 0
    for frames, offsets_m, turns_rad, kept in _left_by_components(own, given):
        used[frames[~kept]] = False
        scale = np.sqrt(kept.sum() / (kept.sum() - 2))  # six of the numbers are fitted
        offsets.append(scale * offsets_m[kept])
        turns.append(scale * turns_rad[kept])
    estimated = np.array(UNKNOWN_STD)
    if offsets:
        off, turn = np.concatenate(offsets), np.concatenate(turns)
        estimated = np.array(
            [
                deviation_about_zero(off[:, :2]),
                deviation_about_zero(off[:, 2:]),
                deviation_about_zero(turn),
            ]
        )
    position, depth, attitude = np.maximum(estimated, LEAST_STD)
    position = config.prior_position_std_m or position
    return [
        Prior(
            int(i), given.T_world_camera[i], np.array([position, position, depth]), float(attitude)
        )
        for i in np.flatnonzero(used)
    ]


def turned_frames(own: Placement, given: Placement) -> NDArray[np.int64]:
    """Frames whose given attitude is off by more than a compass is, once the track of the images is
    brought to the given poses of most.
    """
    turned = [np.zeros(0, np.int64)]
    for frames, _, turns_rad, _ in _left_by_components(own, given):
        turned.append(frames[np.linalg.norm(turns_rad, axis=1) > MAX_TURN_RAD])
    return np.concatenate(turned)


def _left_by_components(
    own: Placement, given: Placement
) -> Iterator[tuple[NDArray[np.int64], Array, Array, NDArray[np.bool_]]]:
    """For each component the frames (n,) with a given pose, what is left of their positions (n, 3)
    and attitudes (n, 3), meters and radians, once it is brought to them; and which of them it was
    brought to.
    """
    for component in range(len(own.sizes)):
        frames = own.frames_of(component)
        frames = frames[given.components[frames] >= 0]
        if len(frames) < MIN_FRAMES:
            continue
        moved, kept = _moved_to_given(own.T_world_camera, given.T_world_camera, frames)
        there, here = given.T_world_camera[frames], moved[frames]
        turns = np.swapaxes(here[:, :3, :3], 1, 2) @ there[:, :3, :3]
        yield frames, there[:, :3, 3] - here[:, :3, 3], rotation_vector(turns), kept


def _moved_to_given(
    T: Array, given: Array, frames: NDArray[np.int64]
) -> tuple[Array, NDArray[np.bool_]]:
    """T (N, 4, 4) as a whole brought to the given poses of some frames: mean turn, then mean
    position; and which of the frames have positions that are not far off by that.
    """
    kept = np.ones(len(frames), np.bool_)
    for _ in range(ROUNDS):
        chosen = frames[kept]
        R = nearest_rotation((given[chosen] @ inverse(T[chosen]))[:, :3, :3].mean(axis=0))
        shifts = given[frames, :3, 3] - T[frames, :3, 3] @ R.T
        off = shifts - np.median(shifts[kept], axis=0)
        std_m = np.maximum(ROBUST_DEVIATION * np.median(np.abs(off[kept]), axis=0), LEAST_OFF_M)
        now = np.asarray((np.abs(off) < FAR_OFF * std_m).all(axis=1))
        if now.sum() < MIN_FRAMES or (now == kept).all():
            break
        kept = now
    return np.asarray(rigid_transform(R, shifts[kept].mean(axis=0)) @ T), kept
