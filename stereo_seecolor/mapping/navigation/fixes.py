"""Alignment of a track by the pictures to positions that are far less accurate than it is, such as
a buoy's satellite fixes.

A prior so loose moves and turns a track about the vertical as a whole, and does not bend it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.geometry import (
    pose,
    rotation_from_vector,
)
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import assign, clock_difference
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.survey_frames import Unplaced
from stereo_seecolor.records import Trajectory
from stereo_seecolor.robust_statistics import TUKEY, biweight, deviation_about_zero

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FixSettings:
    """When fixes determine where a track lies."""

    fewest: int = 5  # frames with a fix
    rounds: int = 10  # of weighted least squares; it takes 4
    # standard error of the heading: they scatter by half of what the track reaches from its middle
    most_heading_deg: float = 30.0


SETTINGS = FixSettings()


@dataclass(frozen=True, eq=False)
class FixFit:
    """T: (4, 4) to the fixes' world. scatter_m: of a fix, east or north. heading_std_deg: as if all
    fixes shared one error, which those of one buoy on one rope nearly do: more of them do not make
    the heading surer, a longer track does.
    """

    T: Array
    scatter_m: float
    heading_std_deg: float


def at_fixes(
    own: Placement, index: FrameIndex, trajectory: Trajectory, config: MappingConfig
) -> Placement:
    """The track, level and z up, where the fixes say. Its mean height becomes theirs.

    Components for which they do not tell are left out, and named. Raises MappingError if that is
    the largest one.
    """
    fixes = assign(index, trajectory, config).T_world_camera[:, :3, 3]
    T, components, unplaced, warnings = (
        own.T_world_camera.copy(),
        own.components.copy(),
        [*own.unplaced],
        [],
    )
    for component in range(len(own.sizes)):
        frames = own.frames_of(component)
        fixed = frames[np.isfinite(fixes[frames]).all(axis=1)]
        fit = fit_to_fixes(T[fixed, :3, 3], fixes[fixed], config.prior_position_std_m)
        if fit is not None:
            T[frames] = fit.T @ T[frames]
            warnings.append(
                f"the track is aligned to {len(fixed)} fixes, which scatter around it by "
                f"{fit.scatter_m:.1f} m; the standard error of its heading is "
                f"{fit.heading_std_deg:.0f} degrees"
            )
            continue
        reason = f"{len(fixed)} fixes along its track do not determine its heading"
        if not len(fixed) and (fix := clock_difference(index, trajectory)):
            raise MappingError(f"no frame has a fix at its time: {fix}")
        if component == 0:
            raise MappingError(
                f"{reason}: the dive must be longer than their scatter; make the map without "
                "--poses"
            )
        unplaced += [Unplaced(index.names[i], reason) for i in frames]
        T[frames], components[frames] = np.nan, -1
    kept = components >= 0
    components[kept] = np.unique(components[kept], return_inverse=True)[1]
    placed = replace(own, T_world_camera=T, components=components, unplaced=tuple(unplaced))
    return placed.with_warnings(*warnings[:1])


def fit_to_fixes(track_m: Array, fixes_m: Array, std_m: float | None) -> FixFit | None:
    """The motion that keeps the vertical, from a track (n, 3) to fixes (n, 3), outliers apart; None
    where they do not tell it.

    std_m: standard error of a fix, east or north; None: from how they scatter.
    """
    if len(track_m) < SETTINGS.fewest:
        return None
    weights, known_m = np.ones(len(track_m)), std_m
    for _ in range(SETTINGS.rounds):
        T, arms = _weighted(track_m, fixes_m, weights)
        off = (track_m @ T[:3, :3].T + T[:3, 3] - fixes_m)[:, :2]
        scatter_m = known_m or max(deviation_about_zero(off), 1e-3)
        weights = biweight(np.linalg.norm(off, axis=1) / (TUKEY * scatter_m))
        if np.count_nonzero(weights) < SETTINGS.fewest:
            return None
    reach_m = float(np.sqrt((weights[:, None] * arms**2).sum() / weights.sum()))
    heading_deg = float(np.degrees(scatter_m / max(reach_m, 1e-9)))
    return FixFit(T, scatter_m, heading_deg) if heading_deg <= SETTINGS.most_heading_deg else None


def _weighted(track_m: Array, fixes_m: Array, weights: Array) -> tuple[Array, Array]:
    """The best turn about the vertical and shift, and where the track lies about its middle, east
    and north (n, 2).
    """
    middle, there = (np.average(points, axis=0, weights=weights) for points in (track_m, fixes_m))
    a, b = (track_m - middle)[:, :2], (fixes_m - there)[:, :2]
    yaw = np.arctan2(
        weights @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), weights @ (a * b).sum(axis=1)
    )
    R = rotation_from_vector(np.array([0.0, 0.0, float(yaw)]))
    return pose(R, there - R @ middle), a
