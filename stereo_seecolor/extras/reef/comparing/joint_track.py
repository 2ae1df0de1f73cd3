"""Joint optimization of both surveys' tracks: matches between frames of both dives remove the
bending of the second track.

A registration is one motion; two tracks without loops bend against each other by millimeters
over tens of meters. The first survey stays as it is mapped. The second must be fused again by the
track that is found here.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.transforms import transform_points
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.errors import ComparingError
from stereo_seecolor.extras.reef.comparing.registration import Registration
from stereo_seecolor.extras.reef.site_surface import Site
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.survey_frames import ReadableFrames
from stereo_seecolor.mapping.track import loops, odometry, pose_graph
from stereo_seecolor.mapping.track.placement_refinement import refined
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.records import SurveyFrame, Trajectory
from stereo_seecolor.run_folder.posed_run import PosedRun


@dataclass(frozen=True)
class JointSettings:
    """How far the first survey may give way, and when its frames constrain the second's."""

    position_std_m: float = 2e-4  # of the first's frames: its map is there, and stays
    attitude_std_rad: float = 1e-4
    loose_m: float = 0.1  # of the second's, by the registration: far more than tracks bend
    loose_rad: float = 0.02
    fewest: int = 5  # pairs of frames, one of each dive, that see the same


SETTINGS = JointSettings()


@dataclass(frozen=True, eq=False)
class JointTrack:
    """The second survey's track in the first's world.

    trajectory: of the second's frames. pairs: of frames across the dives. bent_m: RMS by which it
    moved.
    """

    trajectory: Trajectory
    pairs: int
    bent_m: float


def joint_track(a: Site, b: Site, registration: Registration, compute: Compute) -> JointTrack:
    """Optimize both tracks together. Raises ComparingError where too few frames of one dive match
    frames of the other; DeviceError without GTSAM.
    """
    T_b, count = registration.T_a_b @ b.posed.T_map_camera, len(a.posed.frames)
    T_b[:, :3, :3] /= registration.scale
    frames, T = (
        ReadableFrames(_BothDives(a.posed, b.posed)),
        np.concatenate([a.posed.T_map_camera, T_b]),
    )
    index = FrameIndex.build(frames, a.posed.geometry, compute=compute)
    survey = Survey(
        frames,
        a.posed.geometry,
        replace(index, timestamps_s=np.full(len(T), np.nan)),
        compute=compute,
    )
    track = odometry.follow(survey)
    points = ((i, transform_points(T[i], index.points_m[i])) for i in range(len(T)))
    pairs = [(i, j) for i, j in loops.by_overlap(points, odometry.SETTINGS.window) if j >= count]
    track.edges = [edge for edge in track.edges if min(edge.i, edge.j) >= count]
    track.edges += track.measure(pairs, "frames of both dives", loop=True)
    fixed, loose = (
        (SETTINGS.position_std_m, SETTINGS.attitude_std_rad),
        (SETTINGS.loose_m, SETTINGS.loose_rad),
    )
    stds = [fixed if i < count else loose for i in range(len(T))]
    priors = [
        Prior(i, T[i], np.full(3, position), attitude)
        for i, (position, attitude) in enumerate(stds)
    ]
    T_solved, false = pose_graph.solve(T, range(len(T)), track.edges, priors)
    track.edges = [edge for edge in track.edges if edge not in false]
    across = sum(edge.i < count <= edge.j for edge in track.edges)
    if across < SETTINGS.fewest:
        raise ComparingError(
            f"the second track cannot be bent onto the first: {across} pairs of frames of both "
            f"dives match (needed: {SETTINGS.fewest}): were they taken from similar "
            "positions, and corrected with the same settings?"
        )
    better = refined(track, Placement(T_solved, np.zeros(len(T), np.int64)), priors).T_world_camera[
        count:
    ]
    bent_m = float(np.sqrt(((better - T_b)[:, :3, 3] ** 2).sum(axis=1).mean()))
    better[:, :3, 3] += a.posed.offset_m
    names = tuple(frame.name for frame in b.posed.frames)
    times = np.array(
        [np.nan if frame.timestamp_s is None else frame.timestamp_s for frame in b.posed.frames]
    )
    return JointTrack(Trajectory(names, times, better, origin=a.posed.origin), across, bent_m)


class _BothDives(Lazy[SurveyFrame]):
    """The frames of two maps, one after the other, with their maps' ranges."""

    def __init__(self, a: PosedRun, b: PosedRun) -> None:
        self._a, self._b = a.survey, b.survey

    def __len__(self) -> int:
        return len(self._a) + len(self._b)

    def item(self, number: int) -> SurveyFrame:
        """A frame. Raises FrameError if one of its files is gone or damaged."""
        return self._a[number] if number < len(self._a) else self._b[number - len(self._a)]
