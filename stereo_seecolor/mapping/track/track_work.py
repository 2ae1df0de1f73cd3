"""The work on frames and on pairs of frames of a track, as objects that can be sent to another
process.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.mapping.track.feature_store import FeatureStore
from stereo_seecolor.mapping.track.features import (
    FEATURE_SETTINGS,
    Features,
    FeatureSettings,
    detect,
)
from stereo_seecolor.mapping.track.image_errors import FramePair, ImageErrors
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


@dataclass(frozen=True, eq=False)
class Detection:
    """Finds the features of the frame at a position on the track, for the store; why there are
    none, "" where there are.

    order: the frames by position.
    """

    frames: Frames
    geometry: RectifiedPair
    order: Sequence[int]
    store: FeatureStore

    def __call__(self, position: int) -> str:
        """Raises OutputError."""
        frame = self.frames[self.order[position]]
        lost = frame.reason if isinstance(frame, Unplaced) else ""
        if lost or not self.store.has(position):
            self.store.save(position, features_of(frame, self.geometry))
        return lost


def features_of(
    frame: SurveyFrame | Unplaced,
    geometry: RectifiedPair,
    settings: FeatureSettings = FEATURE_SETTINGS,
) -> Features:
    """As ``detect``; of a frame that is lost, none."""
    return Features.none() if isinstance(frame, Unplaced) else detect(frame, geometry, settings)


@dataclass(frozen=True, eq=False)
class Relating:
    """The relative pose of the frames at two positions, with what is expected of it; None where
    they do not see the same.
    """

    features: Sequence[Features]
    geometry: RectifiedPair

    def __call__(self, pair: tuple[Ends, ExpectedPose | None]) -> RelativePose | None:
        """As ``relative_pose``."""
        (a, b), expected = pair
        return relative_pose(self.features[a], self.features[b], self.geometry, expected)


@dataclass(frozen=True, eq=False)
class Refitting:
    """A relative pose fitted again to the same points of other features."""

    features: Sequence[Features]

    def __call__(self, known: tuple[Ends, RelativePose]) -> RelativePose:
        """As ``fit_pose``."""
        (a, b), relation = known
        pair = seen(self.features[a], self.features[b], relation)
        T, covariance, kept = fit_pose(pair.T_a_b, pair.a, pair.b)
        return RelativePose(T, covariance, relation.index_a[kept], relation.index_b[kept])


class CorrectedFeatures(Lazy[Features]):
    """Features without the errors that all images have."""

    def __init__(self, features: Sequence[Features], errors: ImageErrors) -> None:
        self._features, self._errors = features, errors

    def __len__(self) -> int:
        return len(self._features)

    def item(self, number: int) -> Features:
        """Read the features of the frame at a position."""
        return self._errors.corrected(self._features[number])


class ScaledFeatures(Lazy[Features]):
    """Features whose ranges are scaled by this factor."""

    def __init__(self, features: Sequence[Features], scale: float) -> None:
        self._features, self._scale = features, scale

    def __len__(self) -> int:
        return len(self._features)

    def item(self, number: int) -> Features:
        """Read the features of the frame at a position."""
        return self._features[number].scaled(self._scale)


class SeenPairs(Lazy[FramePair]):
    """The points that both frames see, for each pair of a track that was measured, by ranges that
    are hardly averaged: of flattened relief, a perfect lens seems to be off.
    """

    def __init__(
        self, features: Sequence[Features], known: Sequence[tuple[Ends, RelativePose]]
    ) -> None:
        self._features, self._known = features, known

    def __len__(self) -> int:
        return len(self._known)

    def item(self, number: int) -> FramePair:
        """The pair of a number."""
        (a, b), relation = self._known[number]
        return seen(self._features[a].unflattened(), self._features[b].unflattened(), relation)


def seen(a: Features, b: Features, relation: RelativePose) -> FramePair:
    """The points of two frames that agree with their relative pose."""
    return FramePair(
        relation.T_a_b,
        Observed(a.points[relation.index_a], a.std[relation.index_a]),
        Observed(b.points[relation.index_b], b.std[relation.index_b]),
    )
