"""Deviations in given positions that are read rightly: their scale, and their jumps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from calibration.robust_statistics import weighted_median_and_error
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.motions import Motions
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class DeviationSettings:
    """When a deviation is reported.

    On a real dive of 20 pairs (steps of 0.13 m) noise of 20 cm gives at most 2.6 times the median
    between two frames, and a scale 0.6 standard errors off; a drift of half a meter looks like a
    scale 2.8 standard errors off.
    """

    min_edges: int = 8  # fewer do not tell their scatter
    least_scale: float = 0.02  # calibrations in water are known to a percent or better
    sigmas: float = 4.0
    least_jump_m: float = 0.05  # less is no more than navigation's noise
    times_median: float = 6.0  # of what frames that follow each other are off
    # of what a single position is off: frames before and after it tell the same to so much
    alike: float = 0.5
    most_frames: int = 3  # an edge over more frames does not tell between which of them


SETTINGS = DeviationSettings()


def deviations(T_world_camera: Array, edges: Sequence[Edge], index: FrameIndex) -> list[str]:
    """A line for the scale of given positions, T (N, 4, 4), and one for their jumps, where the
    edges of the images show them.
    """
    motions = Motions.of(T_world_camera, edges)
    if len(motions.edges) < SETTINGS.min_edges:
        return []
    return [*_scale(motions), *jumps(T_world_camera, motions, index)]


def _scale(motions: Motions) -> list[str]:
    """Long steps count most. Noise of positions lengthens steps, noise of attitudes shortens what
    lies along the measured one: the scale is what both show.
    """
    given, measured = motions.given[:, :3, 3], motions.measured[:, :3, 3]
    squared = (measured**2).sum(axis=1)
    along = (given * measured).sum(axis=1) / squared
    length = np.sqrt((given**2).sum(axis=1) / squared)
    found = [
        weighted_median_and_error(ratios, squared, motions.frames) for ratios in (along, length)
    ]
    scale, std = min(found, key=lambda one: abs(one[0] - 1))
    one_way = (found[0][0] - 1) * (found[1][0] - 1) > 0
    if not one_way or abs(scale - 1) < max(SETTINGS.least_scale, SETTINGS.sigmas * std):
        return []
    return [
        f"the given positions are {scale:.3f} ± {std:.3f} times as far apart as in the images: "
        "their scale is wrong, or the scale of the calibration (square size, baseline, "
        "calibrated in air)"
    ]


def without_jumps(
    T_world_camera: Array, edges: Sequence[Edge], index: FrameIndex, most: int
) -> Array:
    """Poses (N, 4, 4) with their largest jumps, so many at most, taken out of all that follows. A
    frame whose position was interpolated over a jump makes two of it.
    """
    result = T_world_camera.copy()
    for _ in range(most):
        motions = Motions.of(result, edges)
        if len(motions.edges) < SETTINGS.min_edges:
            break
        shifts = _shifts(result, motions, index)
        if not shifts.places:
            break
        worst = shifts.places[0]
        result[index.order[worst + 1 :], :3, 3] -= shifts.between_m[worst + 1]
    return result


class _Shifts(NamedTuple):
    """How far given positions are off between neighboring frames.

    between_m: (N + 1, 3) at 1 + the rank of the frame before, 0 at both ends. places: ranks of the
    frames before jumps, the largest first. limit_m: less is no jump. first, last, off_m: of E
    edges, the ranks of their frames and (E, 3) how far they are off.
    """

    between_m: Array
    places: list[int]
    limit_m: float
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    off_m: Array


def _shifts(T: Array, motions: Motions, index: FrameIndex) -> _Shifts:
    """Between neighboring frames, by all edges over them."""
    rank = index.rank[[[e.i, e.j] for e in motions.edges]]
    given_m, measured_m = motions.shifts_in_world(T)
    off_m = given_m - measured_m
    off_m *= np.sign(rank[:, 1] - rank[:, 0])[:, None]
    first, last = rank.min(axis=1), rank.max(axis=1)
    between_m = np.zeros((len(index.order) + 1, 3))
    if (last - first > SETTINGS.most_frames).all():
        return _Shifts(between_m, [], np.inf, first, last, off_m)
    steps = [
        np.flatnonzero((last - first > step) & (last - first <= SETTINGS.most_frames))
        for step in range(SETTINGS.most_frames)
    ]
    edge = np.concatenate(steps)
    place = np.concatenate([first[over] + step for step, over in enumerate(steps)])
    by_place = np.argsort(place, kind="stable")
    places, starts = np.unique(place[by_place], return_index=True)
    between_m[1 + places] = [
        np.median(off_m[own], axis=0) for own in np.split(edge[by_place], starts[1:])
    ]
    jump_m = np.linalg.norm(between_m, axis=1)
    limit_m = max(
        SETTINGS.least_jump_m, SETTINGS.times_median * float(np.median(jump_m[1 + places]))
    )
    peak = (jump_m[1:-1] > limit_m) & (jump_m[1:-1] >= jump_m[:-2]) & (jump_m[1:-1] > jump_m[2:])
    found = sorted(np.flatnonzero(peak).tolist(), key=lambda one: -jump_m[one + 1])
    return _Shifts(between_m, found, limit_m, first, last, off_m)


def jumps(T_world_camera: Array, motions: Motions, index: FrameIndex) -> list[str]:
    """A line for the jumps of given positions, T (N, 4, 4), between neighboring frames."""
    shifts = _shifts(T_world_camera, motions, index)
    if not shifts.places:
        return []
    worst = shifts.places[0]
    for frame in (worst, worst + 1):
        alone_m = _alone_m(shifts.off_m[shifts.last == frame], -shifts.off_m[shifts.first == frame])
        if alone_m > shifts.limit_m:
            others = len(set(shifts.places) - {frame - 1, frame})
            line = (
                f"the given position of {index.names[index.order[frame]]} is {alone_m:.2f} m off "
                "relative to the images"
            )
            return [line + (f", and more jump at {counted(others, 'place')}" if others else "")]
    a, b = (index.names[index.order[place]] for place in (worst, worst + 1))
    others = len(shifts.places) - 1
    more = f", and more at {counted(others, 'place')}" if others else ""
    return [
        f"the given positions jump by {np.linalg.norm(shifts.between_m[worst + 1]):.2f} m "
        f"relative to the images between {a} and {b}{more}"
    ]


def _alone_m(before: Array, after: Array) -> float:
    """How far a single position is off, by the edges (n, 3) to frames before it and after it; 0
    where they do not tell the same.
    """
    if not len(before) or not len(after):
        return 0.0
    both = np.median(before, axis=0), np.median(after, axis=0)
    off_m = float(np.linalg.norm(both[0] + both[1]) / 2)
    return off_m if np.linalg.norm(both[0] - both[1]) < SETTINGS.alike * off_m else 0.0
