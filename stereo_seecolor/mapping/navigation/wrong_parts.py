"""A part of given poses that contradicts the images while the rest fits them: rows of a track in
reverse order, or of another time.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import rotation_vector
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.motions import Motions
from stereo_seecolor.mapping.navigation.seen_motion import SeenMotion
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array

LEAST_FRAMES = 3
"""Of a part: one or two are single wrong fixes, which the others outweigh."""
LEAST_FIT = 0.15
"""Fraction of relative poses that fit, at least: else the whole track is wrong."""
TIMES = 6.0
"""A relative pose contradicts the images where it is off by so many times what so many of them
is off by less: errors of a fix, the same in all directions, reach 4 times that once in a
thousand."""
OF_MOTION = 0.5
"""And by so much of what the images show: navigation as good as that is no wrong order."""
MOST_OF = 0.7
"""Of a frame's relative poses that contradict, within a part; among others than the part's, less
than the rest may."""
HALF = 0.5
"""The same of a frame between two others of the part."""
REVERSED = 0.3
"""Reversed, the poses of a part must leave less than this of what they leave as given."""
STAYS = 0.2
"""Positions and attitudes that move by less of what the images do stay,"""
LEAST_TURN_DEG = 10.0
"""where those turn by so much at least."""


def wrong_parts(T_world_camera: Array, seen: SeenMotion, index: FrameIndex) -> list[str]:
    """A line for each part of the track whose poses contradict the images: its first and last
    frame, by how much, and what would explain it: the reverse order, positions or attitudes that
    stay.

    T_world_camera: (N, 4, 4). Empty for a track that fits as a whole, or as a whole does not.
    """
    edges = seen.edges
    bad = _contradicting(T_world_camera, edges)
    if bad.all() or not bad.any():
        return []
    ends = np.array([[edge.i, edge.j] for edge in edges])
    frames = np.unique(ends)
    times_s = index.timestamps_s[frames]
    if np.isfinite(times_s).all():  # names may run otherwise
        frames = frames[np.argsort(times_s, kind="stable")]
    fraction = np.array([bad[(ends == frame).any(axis=1)].mean() for frame in frames])
    is_bad = fraction > MOST_OF
    # in reverse order the middle frames of a part fit each other
    is_bad[1:-1] |= (fraction[1:-1] >= HALF) & is_bad[:-2] & is_bad[2:]
    runs = np.split(np.arange(len(frames)), np.flatnonzero(np.diff(is_bad)) + 1)
    parts = [frames[run].tolist() for run in runs if is_bad[run[0]] and len(run) >= LEAST_FRAMES]
    inside = np.isin(ends, [frame for part in parts for frame in part]).any(axis=1)
    if not parts or bad[~inside].mean() > 1 - MOST_OF:
        return []
    return [
        _line(T_world_camera, seen, part, index) for part in parts if _is_inner(part, ends, bad)
    ]


def _contradicting(T_world_camera: Array, edges: Sequence[Edge]) -> NDArray[np.bool_]:
    """(E,) relative poses that are off by far more than some of them are, and than they move."""
    motions = Motions.of(T_world_camera, edges)
    off_m = motions.position_m
    if not len(off_m):
        return np.zeros(0, np.bool_)
    moved_m = np.linalg.norm(motions.measured[:, :3, 3], axis=1)
    usual_m = float(np.quantile(off_m, LEAST_FIT))
    return np.asarray(off_m > np.maximum(TIMES * usual_m, OF_MOTION * np.median(moved_m)))


def _is_inner(part: Sequence[int], ends: NDArray[np.int64], bad: NDArray[np.bool_]) -> bool:
    """Tell whether relative poses between frames of the part contradict, too: those of a jump, or
    of an offset for a while, do not.
    """
    within = np.isin(ends, part).all(axis=1)
    return bool(within.any() and bad[within].mean() > MOST_OF)


def _line(T_world_camera: Array, seen: SeenMotion, part: Sequence[int], index: FrameIndex) -> str:
    within = [edge for edge in seen.edges if edge.i in part and edge.j in part]
    given_m = float(np.median(Motions.of(T_world_camera, within).position_m))
    return (
        f"the given poses from {index.names[part[0]]} to {index.names[part[-1]]} contradict the "
        f"images, by {given_m:.2f} m per relative pose (median), and the others do not; "
        f"{_cause(T_world_camera, seen, part, within)}"
    )


def _cause(
    T_world_camera: Array, seen: SeenMotion, part: Sequence[int], within: Sequence[Edge]
) -> str:
    turned = T_world_camera.copy()
    turned[part] = T_world_camera[part[::-1]]
    given_m, reversed_m = (
        float(np.median(Motions.of(T, within).position_m)) for T in (T_world_camera, turned)
    )
    causes = []
    if reversed_m < REVERSED * given_m:
        causes.append(
            f"in reverse order they would fit ({reversed_m:.2f} m): sort the rows of the track by "
            "time"
        )
    far = [edge for edge in seen.spans if edge.i in part and edge.j in part] or within
    motions = Motions.of(T_world_camera, far)
    moved_m = [
        float(np.median(np.linalg.norm(T[:, :3, 3], axis=1)))
        for T in (motions.given, motions.measured)
    ]
    if moved_m[0] < STAYS * moved_m[1]:
        causes.append(
            f"there the positions stay at one place (they move by {moved_m[0]:.2f} m where the "
            f"images move by {moved_m[1]:.2f} m): a sensor that repeats its last fix?"
        )
    to_others = [edge for edge in seen.spans if edge.i in part or edge.j in part] or within
    motions = Motions.of(T_world_camera, to_others)
    turned_deg = [
        float(np.degrees(np.linalg.norm(rotation_vector(T[:, :3, :3]), axis=1)).max())
        for T in (motions.given, motions.measured)
    ]
    if turned_deg[0] < STAYS * turned_deg[1] and turned_deg[1] > LEAST_TURN_DEG:
        causes.append(
            f"there the attitudes or headings stay (they turn by {turned_deg[0]:.0f} degrees at "
            f"most where the images turn by {turned_deg[1]:.0f}): a sensor that stopped?"
        )
    none = "neither the reverse order nor a sensor that stopped explains it"
    return "; or, as likely, ".join(causes) or none
