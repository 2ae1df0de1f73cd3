"""Placement of a survey's frames: by their images, by given poses, or by both."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.navigation.assignment import place
from stereo_seecolor.mapping.navigation.comparison import (
    ComparedNavigation,
    Navigation,
    examine,
)
from stereo_seecolor.mapping.navigation.corrections import MAX_TURN_RAD
from stereo_seecolor.mapping.navigation.fixes import at_fixes
from stereo_seecolor.mapping.navigation.motions import misfit
from stereo_seecolor.mapping.navigation.priors import priors, turned_frames
from stereo_seecolor.mapping.navigation.spot_check import spot_check
from stereo_seecolor.mapping.navigation.unmoved import ALIKE, attitudes_equal
from stereo_seecolor.mapping.navigation.upright import upright
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track import odometry, pose_graph
from stereo_seecolor.mapping.track.fiducials import Marks
from stereo_seecolor.mapping.track.marker_fit import MarkersFit, fit_to_fiducials
from stereo_seecolor.mapping.track.placement_refinement import refined
from stereo_seecolor.records import GeoOrigin, Trajectory

NOT_HELD = (
    "mapping.markers do not constrain the map: this needs GTSAM and, if poses are given, "
    "mapping.poses=prior"
)

FIXES_NOT_USED = "mapping.fixes are not used: the poses are georeferenced already"

WRONG = 0.5
"""Misfit, in steps between frames: attitudes that turn away from a track over hundreds of meters
fit from frame to frame.
"""


@dataclass(frozen=True, eq=False)
class PlacedSurvey:
    """A survey's placement.

    navigation: the outcome of given poses, None without any. position_residual_m,
    attitude_residual_deg: (N,) of each frame, NaN where unknown. origin: of the placement's world
    on Earth, None if unknown. markers: how it fits the markers that constrain it.
    """

    placement: Placement
    navigation: Navigation | None
    position_residual_m: NDArray[np.float64]
    attitude_residual_deg: NDArray[np.float64]
    origin: GeoOrigin | None = None
    markers: MarkersFit | None = None

    @classmethod
    def compared(
        cls, placement: Placement, verdict: ComparedNavigation, trajectory: Trajectory
    ) -> "PlacedSurvey":
        """A placement in the world of given poses, and how these compare with the images."""
        residuals = verdict.position_residual_m, verdict.attitude_residual_deg
        return cls(placement, verdict.navigation, *residuals, trajectory.origin)

    def with_warnings(self, *warnings: str) -> "PlacedSurvey":
        """Add warnings to the placement's."""
        return replace(self, placement=self.placement.with_warnings(*warnings))

    @property
    def range_scale(self) -> float:
        """The factor by which ranges exceed the rig's; 1 without markers of known size."""
        return self.markers.scale if self.markers and self.markers.before else 1.0


LEAST_TURNED, MOST_TURNED = 3, 0.1
"""Frames, and their fraction, whose attitudes are far off where the others fit: single ones are
noise.
"""


def place_survey(
    survey: Survey, config: MappingConfig, trajectory: Trajectory | None
) -> PlacedSurvey:
    """Place the frames.

    Without a trajectory by the images alone. With one, its poses are measured against the
    images, at a few places if they are exact there; then they are taken as they are (exact, or
    config.poses "given", or where GTSAM is missing), or the frames are placed by images and poses
    together, each weighted by its errors ("prior"), or, where the poses contradict the images, by
    the images alone. Positions alone move the track by the images as a whole.

    Raises MappingError if nothing can be placed, or for given poses upside down.
    """
    placed = _on_earth(_placed(survey, config, trajectory), survey, config, trajectory)
    warnings = (
        placed.markers.warnings if placed.markers else (NOT_HELD,) if config.markers.known else ()
    )
    notes = trajectory.notes if trajectory else ()
    return placed.with_warnings(*warnings, *notes)


def _on_earth(
    placed: PlacedSurvey, survey: Survey, config: MappingConfig, trajectory: Trajectory | None
) -> PlacedSurvey:
    """Move a placement without a place on Earth to the fixes beside its poses."""
    if trajectory is None or trajectory.absolute is None:
        return placed
    if placed.origin:
        return placed.with_warnings(FIXES_NOT_USED)
    return replace(
        placed,
        placement=at_fixes(placed.placement, survey.index, trajectory.absolute, config),
        origin=_origin_of(trajectory.absolute),
    )


def _origin_of(fixes: Trajectory) -> GeoOrigin | None:
    """The origin of positions whose heights mean nothing."""
    return replace(fixes.origin, depth_known=False) if fixes.origin else None


def _placed(survey: Survey, config: MappingConfig, trajectory: Trajectory | None) -> PlacedSurvey:
    if trajectory is None or trajectory.fixes:
        return _placed_by_pictures(survey, config, trajectory)
    given = place(survey.index, trajectory)
    exact = _placed_exactly(survey, config, trajectory, given)
    return _placed_by_poses(survey, config, trajectory, given) if exact is None else exact


def _placed_by_pictures(
    survey: Survey, config: MappingConfig, trajectory: Trajectory | None
) -> PlacedSurvey:
    """Place the frames by the images alone; positions without attitudes, if there are any, move
    the track as a whole.
    """
    unknown = np.full(len(survey.index.names), np.nan)
    track = odometry.follow(survey)
    own, markers = _upright(track, by_pictures(track), config)
    if trajectory is None or (markers and markers.control):
        origin = markers.origin if markers else None
    else:
        own, origin = at_fixes(own, survey.index, trajectory, config), _origin_of(trajectory)
    return PlacedSurvey(own, None, unknown, unknown, origin, markers)


def _placed_exactly(
    survey: Survey, config: MappingConfig, trajectory: Trajectory, given: Placement
) -> PlacedSurvey | None:
    """Take the given poses as they are if a few places of the dive show that they are as exact as
    the map; None if not.
    """
    edges, are_exact = spot_check(survey, given, config.voxel_edge_m)
    if not are_exact or config.markers.known:
        return None
    try:
        exact = _as_given(given, survey, trajectory)
    except MappingError:  # poses upside down: these are recognized from the whole track
        return None
    verdict = examine(given, survey, edges, trajectory, config)
    if verdict.navigation.advice:
        return None
    return PlacedSurvey.compared(exact, verdict, trajectory)


def _placed_by_poses(
    survey: Survey, config: MappingConfig, trajectory: Trajectory, given: Placement
) -> PlacedSurvey:
    """Compare the given poses with the whole track, and take them as they are, together with the
    images, or not at all.
    """
    track = odometry.follow(survey)
    edges = [*track.edges]
    own = by_pictures(track) if edges else None
    verdict = examine(given, survey, edges, trajectory, config, own)
    as_they_are = replace(verdict, navigation=verdict.navigation.unchanged(config.voxel_edge_m))
    if config.poses == "given" or own is None or not verdict.navigation.relative_poses:
        as_given = _as_given(given, survey, trajectory)
        placed = PlacedSurvey.compared(as_given, as_they_are, trajectory)
    elif not pose_graph.available():
        missing = (
            "the given poses were used unchanged: to fit them to the images, pip install "
            "'stereo-seecolor[slam]' (GTSAM)"
        )
        as_given = _as_given(verdict.placement, survey, trajectory).with_warnings(missing)
        placed = PlacedSurvey.compared(as_given, as_they_are, trajectory)
    else:
        placed = _fitted(track, own, verdict, trajectory, config)
    advice = placed.navigation and placed.navigation.advice
    return placed.with_warnings(advice) if advice else placed


def _as_given(given: Placement, survey: Survey, trajectory: Trajectory) -> Placement:
    return upright(given, survey.index, trajectory.up)


def _fitted(
    track: odometry.Track,
    own: Placement,
    verdict: ComparedNavigation,
    trajectory: Trajectory,
    config: MappingConfig,
) -> PlacedSurvey:
    """Place the frames by images and poses together, or by images alone where the poses
    contradict them or are upside down.
    """
    placed = PlacedSurvey.compared(verdict.placement, verdict, trajectory)
    navigation = _checked_up(verdict, track.survey, trajectory)
    known = priors(own, verdict.placement, config) if navigation.fits else []
    if known:
        navigation = _checked_attitudes(
            navigation, verdict.placement, own, track, known[0].attitude_std_rad
        )
    if not navigation.fits:
        own, markers = _upright(track, own, config)
        own = own.with_warnings("the map was made from the images alone")
        return replace(placed, placement=own, navigation=navigation, origin=None, markers=markers)
    position_m, _, depth_m = known[0].position_std_m
    attitude_deg = np.degrees(known[0].attitude_std_rad)
    navigation = replace(
        navigation,
        position_std_m=float(position_m),
        depth_std_m=float(depth_m),
        attitude_std_deg=float(attitude_deg),
    )
    fitted = _adjusted(track, odometry.fit(track, verdict.placement, known), known)
    fitted, markers = _to_fiducials(track, fitted, config, known)
    fitted = fitted.with_warnings(*_without_prior(verdict.placement, fitted, known, track.survey))
    fitted = upright(fitted, track.survey.index, trajectory.up)
    return replace(placed, placement=fitted, navigation=navigation, markers=markers)


def _without_prior(
    given: Placement, fitted: Placement, known: Sequence[pose_graph.Prior], survey: Survey
) -> list[str]:
    """Lines for frames placed by images alone: without a given pose, or with one far off."""
    used = np.isin(np.arange(len(given.components)), [prior.frame for prior in known])
    has_pose = given.components >= 0
    lines = []
    for frames, what in (
        ((fitted.components >= 0) & ~has_pose, "no pose in the trajectory"),
        (has_pose & ~used, "a given position far from those of the others, which was not used"),
    ):
        if frames.any():
            first = next(survey.index.names[i] for i in survey.index.order if frames[i])
            number = counted(int(frames.sum()), "frame")
            lines.append(f"{number}, first {first}, placed by the images alone: {what}")
    return lines


def _checked_up(verdict: ComparedNavigation, survey: Survey, trajectory: Trajectory) -> Navigation:
    """The navigation, which does not fit if its poses are upside down."""
    if not verdict.navigation.fits:
        return verdict.navigation
    try:
        upright(verdict.placement, survey.index, trajectory.up)
    except MappingError:
        down = (
            "the z axis of the given poses points down: they would fit as north-east-down, or "
            "with z negated"
        )
        advice = ALIKE if attitudes_equal(verdict.placement.T_world_camera) else down
        return replace(verdict.navigation, fits=False, advice=advice)
    return verdict.navigation


def _checked_attitudes(
    navigation: Navigation, given: Placement, own: Placement, track: odometry.Track, std_rad: float
) -> Navigation:
    """The navigation, which does not fit if its attitudes are too far off, or those of some frames
    are where the others fit. own: placed by the images alone. std_rad: their standard error
    against the images.
    """
    turned, posed = turned_frames(own, given), np.count_nonzero(given.components >= 0)
    if len(turned) >= max(LEAST_TURNED, MOST_TURNED * posed):
        names = track.survey.index.names
        advice = (
            f"the given attitudes of {len(turned)} of {posed} frames, first {names[turned.min()]}, "
            f"are more than {np.degrees(MAX_TURN_RAD):.0f} degrees off those of the images where "
            "the others fit: rows of the track are in another order or of another time"
        )
        return replace(navigation, fits=False, advice=advice)
    if not (std_rad > MAX_TURN_RAD and misfit(given.T_world_camera, track.edges) > WRONG):
        return navigation
    off_deg = np.degrees(std_rad)
    advice = (
        f"the given attitudes are {off_deg:.0f} degrees off those of the images (standard "
        "deviation), under every interpretation that was tested"
    )
    return replace(navigation, fits=False, advice=advice)


def by_pictures(track: odometry.Track) -> Placement:
    """Place the frames of a track by the images alone, and add the loops to its edges.

    Raises MappingError if no two frames match.
    """
    return _adjusted(track, odometry.solve(track))


def _upright(
    track: odometry.Track, own: Placement, config: MappingConfig
) -> tuple[Placement, MarkersFit | None]:
    """A track by the images and markers; z is up by surveyed places, else by the bottom."""
    own, markers = _to_fiducials(track, own, config)
    return own if markers and markers.control else upright(
        own, track.survey.index, "unknown"
    ), markers


def _adjusted(
    track: odometry.Track, placement: Placement, known: Sequence[pose_graph.Prior] = ()
) -> Placement:
    return refined(track, placement, known) if pose_graph.available() else placement


def _to_fiducials(
    track: odometry.Track,
    placement: Placement,
    config: MappingConfig,
    known: Sequence[pose_graph.Prior] = (),
) -> tuple[Placement, MarkersFit | None]:
    """Constrain a track by the known sizes and positions of markers."""
    if not config.markers.known or not pose_graph.available():
        return placement, None
    return fit_to_fiducials(track, placement, Marks.found(track.survey, config.markers), known)
