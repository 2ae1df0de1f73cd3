"""A placement made better by bundle adjustment: what its relative poses saw, taken all at once instead of pair by pair."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.bundle_adjustment import adjust
from stereo_seecolor.mapping.track.odometry import Track
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.mapping.track.sightings import sightings

MOST_SIGHTINGS = 1_000_000
"""Of a component: 2.4 GB, a minute. Frames have some 1,000 each; of longer dives than 1,000 frames, the points seen most often."""
MOST_FRAMES = MOST_SIGHTINGS // 400
"""With fewer sightings a frame a pose graph, which is made from all of them, is as true."""


def refined(track: Track, placement: Placement, priors: Sequence[Prior] = ()) -> Placement:
    """The placement's frames where all sightings and the priors agree best, with standard errors.

    track: it holds the relative poses that the placement was made from; loops that turned out false are no longer among them.
    Components of very many frames stay as they are, and it is said.
    Raises DeviceError if GTSAM is missing.
    """
    index, T, warnings = track.survey.index, placement.T_world_camera, []
    std = np.full((len(T), 2), np.nan)
    for component, size in enumerate(placement.sizes):
        if size > MOST_FRAMES:
            warnings.append(
                f"a track of {size} frames is too long for bundle adjustment (at most {MOST_FRAMES}): its poses are the graph's"
            )
            continue
        chosen = set(placement.frames_of(component).tolist())
        relations = [track.relation(edge) for edge in track.edges if edge.i in chosen and edge.j in chosen]
        if not relations:
            continue
        track.survey.progress("adjusting the track", component, len(placement.sizes))
        found = sightings(track.features, relations, MOST_SIGHTINGS)
        found = replace(found, frame=index.order[found.frame])
        adjusted = adjust(T, found, [prior for prior in priors if prior.frame in chosen])
        T, std = adjusted.T_world_camera, np.where(np.isfinite(adjusted.std), adjusted.std, std)
    placement = placement.with_warnings(*warnings)
    return replace(placement, T_world_camera=T, position_std_m=std[:, 0], attitude_std_deg=np.degrees(std[:, 1]))
