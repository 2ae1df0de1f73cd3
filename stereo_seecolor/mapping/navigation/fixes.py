"""Alignment of a track by the images to positions that are far less accurate than it is, such as
a buoy's satellite fixes.

A prior so loose moves and turns a track about the vertical as a whole, and does not bend it.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.robust_statistics import TUKEY, biweight, deviation_about_zero
from calibration.transforms import rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import assign, clock_difference
from stereo_seecolor.mapping.navigation.clocks import of_other_clocks
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.survey_frames import Unplaced
from stereo_seecolor.records import Array, Trajectory


@dataclass(frozen=True)
class FixSettings:
    """When fixes determine where a track lies."""

    fewest: int = 5  # frames with a fix
    rounds: int = 10  # of weighted least squares; it takes 4
    # standard error of the heading: they scatter by half of what the track reaches from its middle
    most_heading_deg: float = 30.0
    # of what a track reaches, fixes that lie closer to it need no other reading; another one must
    # leave so much of what they are off at most, and so much of what the track reaches
    contradicts: float = 0.1
    better: float = 0.4
    fits: float = 0.25
    alike: float = 1.15  # another reading that leaves so many times as much is as likely
    least_m: float = 1e-3


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
    read = assign(index, trajectory).T_world_camera
    fixes = read[:, :3, 3]
    T = own.T_world_camera.copy()
    components = own.components.copy()
    unplaced = [*own.unplaced]
    warnings = []
    for component in range(len(own.sizes)):
        frames = own.frames_of(component)
        fixed = frames[np.isfinite(fixes[frames]).all(axis=1)]
        fit = fit_to_fixes(T[fixed, :3, 3], fixes[fixed], config.prior_position_std_m)
        if component == 0 and (reading := _other_reading(T, read, index, trajectory)):
            raise MappingError(
                f"the fixes contradict the images: {reading}; or make the map without --poses"
            )
        if fit is not None:
            T[frames] = fit.T @ T[frames]
            warnings.append(
                f"the track is aligned to {len(fixed)} fixes, which scatter around it by "
                f"{fit.scatter_m:.1f} m; the standard error of its heading is "
                f"{fit.heading_std_deg:.0f} degrees; its depth is unknown: heights count from its "
                "mean height"
            )
            continue
        reason = f"{len(fixed)} fixes along its track do not determine its heading"
        if not len(fixed) and (fix := clock_difference(index, trajectory)):
            raise MappingError(f"no frame has a fix at its time: {fix}")
        if component == 0:
            scatter = _scatter_text(T[fixed, :3, 3], fixes[fixed])
            raise MappingError(f"{reason}{scatter}: make the map without --poses")
        unplaced += [Unplaced(index.names[i], reason) for i in frames]
        T[frames], components[frames] = np.nan, -1
    kept = components >= 0
    components[kept] = np.unique(components[kept], return_inverse=True)[1]
    placed = replace(own, T_world_camera=T, components=components, unplaced=tuple(unplaced))
    return placed.with_warnings(*warnings[:1])


def _scatter_text(track_m: Array, fixes_m: Array) -> str:
    if len(track_m) < SETTINGS.fewest:
        return ""
    scatter_m, reach_m = _off(track_m, fixes_m)
    return (
        f": they scatter by {scatter_m:.1f} m around it, and it reaches {reach_m:.1f} m from its "
        "middle; no other unit, sign, order or clock that was tested fits better: they are too "
        "inaccurate for so short a dive, or of another one"
    )


def _off(track_m: Array, fixes_m: Array, scaled: bool = False) -> tuple[float, float]:
    """How far fixes (n, 3) lie from a track, median, and how far that reaches, meters. scaled: the
    track first enlarged to them.
    """
    if scaled:
        track_m = track_m * _scale(track_m, fixes_m)
    T, arms = _weighted(track_m, fixes_m, np.ones(len(track_m)))
    for _ in range(SETTINGS.rounds):
        off_m = np.linalg.norm((transform_points(T, track_m) - fixes_m)[:, :2], axis=1)
        weights = 1 / np.maximum(off_m, SETTINGS.least_m)  # the least sum of distances
        T, arms = _weighted(track_m, fixes_m, weights)
    return float(np.median(off_m)), float(np.sqrt((arms**2).sum(axis=1).mean()))


def _scale(track_m: Array, fixes_m: Array) -> float:
    """How many times as far apart fixes are: the median of pairs half of them apart."""
    half = len(track_m) // 2
    apart = [
        np.linalg.norm((one[half:] - one[:-half])[:, :2], axis=1) for one in (fixes_m, track_m)
    ]
    return float(np.median(apart[0]) / max(np.median(apart[1]), SETTINGS.least_m))


def _other_reading(T: Array, read: Array, index: FrameIndex, trajectory: Trajectory) -> str:
    """What to say of fixes (N, 4, 4) that fit a track far better in another unit, mirrored, in the
    opposite order or by another clock; "" of others.
    """

    def off(fixes: Array, scaled: bool = False) -> tuple[float, float]:
        known = np.flatnonzero(np.isfinite(fixes[:, :3, 3]).all(axis=1) & np.isfinite(T[:, 0, 3]))
        if len(known) < max(SETTINGS.fewest, len(T) // 2):
            return np.inf, np.nan
        return _off(T[known, :3, 3], fixes[known, :3, 3], scaled)

    plain_m, reach_m = off(read)
    if not plain_m > SETTINGS.contradicts * reach_m:
        return ""
    known = np.isfinite(read[:, :3, 3]).all(axis=1) & np.isfinite(T[:, 0, 3])
    backwards = np.full_like(read, np.nan)
    backwards[index.order] = read[index.order[::-1]]
    mirrored = read * np.array([-1.0, 1, 1, 1])[:, None]
    scale = _scale(T[known, :3, 3], read[known, :3, 3])
    readings = [
        ("mirrored (longitudes or latitudes of the other sign, or exchanged)", off(mirrored)[0]),
        ("in the opposite order", off(backwards)[0]),
        (f"divided by {scale:.3g} (another unit)", off(read, scaled=True)[0]),
    ]
    if np.isfinite(trajectory.timestamps_s).all() and np.isfinite(index.timestamps_s).any():
        clocks = of_other_clocks(index, trajectory, lambda fixes: off(fixes)[0])
        by_clock = [(f"with {name}", off(fixes)[0]) for name, fixes in clocks]
        # of many clocks one fits by chance
        readings += [one for one in by_clock if one[1] < SETTINGS.contradicts * reach_m]
    readings.sort(key=lambda one: one[1])
    least_m = readings[0][1]
    if least_m > min(SETTINGS.better * plain_m, SETTINGS.fits * reach_m):
        return ""
    alike = [name for name, off_m in readings if off_m <= SETTINGS.alike * least_m]
    return (
        f"they lie {plain_m:.2f} m from the track (median), and {least_m:.2f} m if read "
        f"{'; or, as likely, '.join(alike)}"
    )


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
        off = (transform_points(T, track_m) - fixes_m)[:, :2]
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
    return rigid_transform(R, there - R @ middle), a
