"""Where a survey's frames are: by their pictures, by given poses, or by both."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track import odometry, pose_graph
from stereo_seecolor.mapping.track.fixes import at_fixes
from stereo_seecolor.mapping.track.marks import Marks
from stereo_seecolor.mapping.track.marks_fit import MarkersFit, fitted_to_marks
from stereo_seecolor.mapping.track.navigation import ALIKE, MAX_TURN_RAD, Navigation, Verdict, attitudes_alike, examine, priors
from stereo_seecolor.mapping.track.placement import place
from stereo_seecolor.mapping.track.readings import misfit
from stereo_seecolor.mapping.track.refinement import refined
from stereo_seecolor.mapping.track.spot_check import spot_check
from stereo_seecolor.mapping.track.upright import upright
from stereo_seecolor.records import GeoOrigin, Trajectory

NOT_HELD = (
    "mapping.markers do not constrain the map: that needs GTSAM, mapping.bundle_adjustment, and, where poses are given, "
    "mapping.poses=prior"
)

WRONG = 0.5
"""Misfit, in steps between frames: attitudes that turn away from a track over hundreds of meters fit from frame to frame."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A survey's placement; the outcome of given poses, None without any; and each frame's residuals (N,), NaN where unknown.

    origin: where the placement's world lies on Earth, None if unknown. markers: how it fits the markers that constrain it.
    """

    placement: Placement
    navigation: Navigation | None
    position_residual_m: NDArray[np.float64]
    attitude_residual_deg: NDArray[np.float64]
    origin: GeoOrigin | None = None
    markers: MarkersFit | None = None

    @property
    def range_scale(self) -> float:
        """How many times as long ranges are than the rig says."""
        return self.markers.scale if self.markers and self.markers.before else 1.0


class _Used(NamedTuple):
    """A placement, the outcome of the poses for it, whether its world is theirs, and the markers that constrain it."""

    placement: Placement
    navigation: Navigation
    in_their_world: bool = True
    markers: MarkersFit | None = None


def place_survey(survey: Survey, config: MappingConfig, trajectory: Trajectory | None) -> Placed:
    """Place the frames.

    Without a trajectory by the pictures alone. With one, its poses are measured against the pictures, at a few places if they
    are exact there; then they are taken as they are (exact, or config.poses "given", or where GTSAM is missing), or the frames
    are placed by pictures and poses together, each weighted by its errors ("prior"), or, where the poses contradict the pictures,
    by the pictures alone. Positions alone move the track by the pictures as a whole.

    Raises MappingError if nothing can be placed, or for given poses upside down.
    """
    placed = _placed(survey, config, trajectory)
    warnings = placed.markers.warnings if placed.markers else (NOT_HELD,) if config.markers.known else ()
    return replace(placed, placement=placed.placement.with_warnings(*warnings))


def show_first(survey: Survey, config: MappingConfig, trajectory: Trajectory | None, known: Placement | None) -> None:
    """Show the frames where they are known to be, where their poses say, or where each one's picture lies beside the last.

    Raises MappingError if no frame has a pose.
    """
    if known:
        _show(survey, known, "unknown")
    elif trajectory and not trajectory.fixes:
        _show(survey, place(survey.index, trajectory, config), trajectory.up)
    elif placement := odometry.first_places(survey):
        _show(survey, placement, "unknown")


def _placed(survey: Survey, config: MappingConfig, trajectory: Trajectory | None) -> Placed:
    unknown = np.full(len(survey.index.names), np.nan)
    if trajectory is None or trajectory.fixes:
        track = odometry.follow(survey, lambda placement: _show(survey, placement, "unknown"))
        own, markers = _upright(track, _own(track, config), config)
        if trajectory is None or (markers and markers.control):
            return Placed(own, None, unknown, unknown, markers=markers)
        return Placed(at_fixes(own, survey.index, trajectory, config), None, unknown, unknown, trajectory.origin, markers)
    given = place(survey.index, trajectory, config)
    _show(survey, given, trajectory.up)
    spots = spot_check(survey, given, config.voxel_edge_m)
    exact = _as_given_or_none(given, survey, trajectory) if spots.exact and not config.markers.known else None
    if exact is not None:
        verdict = examine(given, survey, spots.edges, trajectory, config)
        if not verdict.navigation.advice:
            return Placed(exact, verdict.navigation, verdict.position_residual_m, verdict.attitude_residual_deg, trajectory.origin)
    track = odometry.follow(survey)
    verdict = examine(given, survey, track.edges, trajectory, config)
    if config.poses == "given" or not verdict.navigation.relative_poses:
        used = _Used(_as_given(given, survey, trajectory), verdict.navigation)
    elif not pose_graph.available():
        missing = "the given poses were taken as they are: to fit them to the pictures, pip install 'stereo-seecolor[slam]' (GTSAM)"
        used = _Used(_as_given(verdict.placement, survey, trajectory).with_warnings(missing), verdict.navigation)
    else:
        used = _fitted(track, verdict, trajectory, config)
    placement, navigation, in_their_world, markers = used
    if navigation.advice:
        placement = placement.with_warnings(navigation.advice)
    origin = trajectory.origin if in_their_world else None
    return Placed(placement, navigation, verdict.position_residual_m, verdict.attitude_residual_deg, origin, markers)


def _show(survey: Survey, placement: Placement, up: str) -> None:
    if survey.look is None:
        return
    with suppress(MappingError):  # poses upside down: there is nothing to show yet
        survey.look(upright(placement, survey.index, up))


def _as_given(given: Placement, survey: Survey, trajectory: Trajectory) -> Placement:
    return upright(given, survey.index, trajectory.up)


def _as_given_or_none(given: Placement, survey: Survey, trajectory: Trajectory) -> Placement | None:
    """None for poses that are upside down: these are recognized from the whole track."""
    try:
        return _as_given(given, survey, trajectory)
    except MappingError:
        return None


def _fitted(track: odometry.Track, verdict: Verdict, trajectory: Trajectory, config: MappingConfig) -> _Used:
    """By pictures and poses together, or by pictures alone where the poses contradict them or are upside down."""
    navigation, index = verdict.navigation, track.survey.index
    own = _own(track, config)
    if navigation.fits:
        try:
            upright(verdict.placement, index, trajectory.up)
        except MappingError:
            down = "the given poses' z axis points down: they would fit as north-east-down, or with z negated"
            advice = ALIKE if attitudes_alike(verdict.placement.T_world_camera) else down
            navigation = replace(navigation, fits=False, advice=advice)
    known = priors(own, verdict.placement, config) if navigation.fits else []
    if known and known[0].attitude_std_rad > MAX_TURN_RAD and misfit(verdict.placement.T_world_camera, track.edges) > WRONG:
        off_deg = np.degrees(known[0].attitude_std_rad)
        advice = f"the given attitudes are {off_deg:.0f} degrees off those of the pictures: are they radians, taken for degrees?"
        navigation = replace(navigation, fits=False, advice=advice)
    if not navigation.fits:
        alone, (own, markers) = "the map was made by the pictures alone", _upright(track, own, config)
        return _Used(own.with_warnings(alone), navigation, in_their_world=False, markers=markers)
    position, _, depth = known[0].position_std_m
    navigation = replace(
        navigation,
        position_std_m=float(position),
        depth_std_m=float(depth),
        attitude_std_deg=float(np.degrees(known[0].attitude_std_rad)),
    )
    fitted, markers = _to_marks(
        track, _adjusted(track, odometry.fit(track, verdict.placement, known), config, known), config, known
    )
    return _Used(upright(fitted, index, trajectory.up), navigation, markers=markers)


def _own(track: odometry.Track, config: MappingConfig) -> Placement:
    """By the pictures alone."""
    return _adjusted(track, odometry.solve(track, config.loop_closure), config)


def _upright(track: odometry.Track, own: Placement, config: MappingConfig) -> tuple[Placement, MarkersFit | None]:
    """A track by the pictures, held to markers; z up by the surveyed places of these, if there are any, else by the bottom."""
    own, markers = _to_marks(track, own, config)
    return own if markers and markers.control else upright(own, track.survey.index, "unknown"), markers


def _adjusted(
    track: odometry.Track, placement: Placement, config: MappingConfig, known: Sequence[pose_graph.Prior] = ()
) -> Placement:
    return refined(track, placement, known) if config.bundle_adjustment and pose_graph.available() else placement


def _to_marks(
    track: odometry.Track, placement: Placement, config: MappingConfig, known: Sequence[pose_graph.Prior] = ()
) -> tuple[Placement, MarkersFit | None]:
    """Held to what is known of markers."""
    if not config.markers.known or not config.bundle_adjustment or not pose_graph.available():
        return placement, None
    return fitted_to_marks(track, placement, Marks.found(track.survey, config.markers), known)
