"""The work on frames and on pairs of frames of a track, which can be sent to another process."""

from collections.abc import Sequence

from calibration.geometry import RectifiedPair
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.mapping.track.feature_store import FeatureStore
from stereo_seecolor.mapping.track.features import (
    FEATURE_SETTINGS,
    Features,
    FeatureSettings,
    detect,
)
from stereo_seecolor.mapping.track.image_errors import FramePair
from stereo_seecolor.mapping.track.image_space import Observed
from stereo_seecolor.mapping.track.relative_pose import (
    ExpectedPose,
    RelativePose,
    fit_pose,
    relative_pose,
)
from stereo_seecolor.records import SurveyFrame

Ends = tuple[int, int]
"""Two positions on the track."""


def store_features(
    frames: Frames,
    geometry: RectifiedPair,
    order: Sequence[int],
    store: FeatureStore,
    position: int,
) -> str:
    """Find the features of the frame at a position on the track, for the store; why there are none,
    "" where there are. Raises OutputError.

    order: the frames by position.
    """
    frame = frames[order[position]]
    lost = frame.reason if isinstance(frame, Unplaced) else ""
    if lost or not store.has(position):
        store.save(position, features_of(frame, geometry))
    return lost


def features_of(
    frame: SurveyFrame | Unplaced,
    geometry: RectifiedPair,
    settings: FeatureSettings = FEATURE_SETTINGS,
) -> Features:
    """As ``detect``; of a frame that is lost, none."""
    return Features.none() if isinstance(frame, Unplaced) else detect(frame, geometry, settings)


def relate(
    features: Sequence[Features], geometry: RectifiedPair, pair: tuple[Ends, ExpectedPose | None]
) -> RelativePose | None:
    """The ``relative_pose`` of the frames at two positions, with what is expected of it."""
    (a, b), expected = pair
    return relative_pose(features[a], features[b], geometry, expected)


def refit(features: Sequence[Features], known: tuple[Ends, RelativePose]) -> RelativePose:
    """Fit a relative pose again to the same points of other features."""
    (a, b), relation = known
    pair = seen(features[a], features[b], relation)
    T, covariance, kept = fit_pose(pair.T_a_b, pair.a, pair.b)
    return RelativePose(T, covariance, relation.index_a[kept], relation.index_b[kept])


def seen_pair(features: Sequence[Features], known: tuple[Ends, RelativePose]) -> FramePair:
    """The points that both frames of a pair see, by ranges that are hardly averaged: of flattened
    relief, a perfect lens seems to be off.
    """
    (a, b), relation = known
    return seen(features[a].unflattened(), features[b].unflattened(), relation)


def seen(a: Features, b: Features, relation: RelativePose) -> FramePair:
    """The points of two frames that agree with their relative pose."""
    return FramePair(
        relation.T_a_b,
        Observed(a.points[relation.index_a], a.std[relation.index_a]),
        Observed(b.points[relation.index_b], b.std[relation.index_b]),
    )
