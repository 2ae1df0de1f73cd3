"""Finds spots that a frame shows with frames before it, or frames of other survey lines."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import cv2
import numpy as np

from calibration import RectifiedPair
from calibration.transforms import inverse
from stereo_seecolor.color.photometry.observations import (
    KeyFrame,
    Observations,
    PhotometricView,
    observations_of,
)
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.mapping.track.features import Features, FeatureSettings, detect
from stereo_seecolor.mapping.track.relative_pose import RelativePose, relative_pose
from stereo_seecolor.records import Array, Image, Map, SurveyFrame

Shown = TypeVar("Shown")
ReadFrame = Callable[[Any], tuple[Image, Map]]


@dataclass(frozen=True)
class OverlapSettings:
    """Settings of the search for spots that several frames show."""

    width_px: int = 480
    """Images are reduced to about this width: lamps and lenses are smooth. With 700, a real dive's
    pattern is the same to 0.01.
    """
    back: tuple[int, ...] = (1, 2, 4)
    """Frames back that each frame is compared with: the farther back, the more of the image a spot
    has crossed. Without the fourth frame back, gains drift (offsets of 0.11 instead of 0.09 on a
    real dive).
    """
    patches: int = 800
    """Spots looked for in each frame, on a grid: some 500 are seen again."""
    loops: int = 3
    """Frames farther back that each frame is compared with too, the nearest of those that by the
    chain of poses show the same: another line of the survey, other altitudes. Along one line a
    slope of the pattern and a drift of the gains look alike: on a synthetic night dive 4.2 % of
    pattern and 10 % between frames are left without loops, 1.9 and 3.1 % with them. More leave no
    less: eight left 0.5 and 1.0 % of a synthetic night of four lines, three 0.35 and 0.7 %; by day
    both 1.2 and 1.9 %. Each takes 7 ms.
    """
    loop_reach: float = 1.0
    """Distance of middles of two images, in widths shown, up to which they may show the same."""
    loop_detour: float = 1.5
    """Length of the track between two frames of a loop, in distances between them, at least: on one
    line it is 1.
    """


LOOK = OverlapSettings()

FEATURES = FeatureSettings(max_features=600, max_width_px=240)
"""Features for relative poses. A pose among neighbors needs some 50 matches, a map's track many
more: on a real dive the light (logarithm) is the same to 0.03 as with 800 features at 360 pixels,
and how much it helps is the same to noise.
"""


@dataclass(frozen=True, eq=False)
class Segment:
    """Successive frames of a dive. frames: number in the dive and key of each. before: the first so
    many belong to the segment before, and are only compared with.
    """

    before: int
    frames: Iterable[tuple[int, Any]]


@dataclass(frozen=True, eq=False)
class _Seen:
    """A frame at reduced size. number: in the dive. key: image and ranges, with the camera at the
    origin. features: for poses.
    """

    number: int
    key: KeyFrame
    features: Features


@dataclass(frozen=True, eq=False)
class _Placed:
    """A frame in the chain of poses that begins with frame ``chain``.

    T_chain_camera: (4, 4). path_m: length of the chain up to it. middle_m: (3,) point in the middle
    of the image. width_m: width of the field of view on the bottom. view: None once it is far back.
    """

    seen: _Seen
    chain: int
    T_chain_camera: Array
    path_m: float
    middle_m: Array
    width_m: float
    view: PhotometricView | None

    @property
    def number(self) -> int:
        """The frame's number in the dive."""
        return self.seen.number


_Others = Sequence[tuple[_Placed, RelativePose]]
_Near = tuple[_Seen, PhotometricView, Sequence[tuple[int, RelativePose]]]


@dataclass(frozen=True, eq=False)
class FrameMatcher:
    """Examines frames; picklable. geometry: of images reduced ``every`` times."""

    read: ReadFrame
    geometry: RectifiedPair
    every: int
    encoding: InputEncoding

    def of_windows(
        self, segment: Segment, loops: int, work: Callable[[Observations], Shown]
    ) -> Iterator[Shown]:
        """``work`` on each window of a segment's own frames, with at most ``loops`` frames of other
        survey lines. All but the chain of poses is done on all cores.
        """
        on_cores = Threads(cores())
        seen = on_cores.each(self._seen, segment.frames)
        chain = self._chain(on_cores.each(self._near, _with_before(seen)), segment.before, loops)
        return on_cores.each(lambda placed: work(self._window(*placed)), chain)

    def _chain(
        self, frames: Iterable[_Near], before: int, loops: int
    ) -> Iterator[tuple[_Placed, _Others]]:
        """Each frame after the first ``before``, with near frames and at most ``loops`` loops."""
        past: dict[int, _Placed] = {}
        for place, (seen, view, poses) in enumerate(frames):
            near = [(past[number], pose) for number, pose in poses]
            placed = self._placed(seen, view, near)
            others = list(past.values())
            if place >= before:
                far = [
                    (other, pose)
                    for other in _loops(placed, others)[:loops]
                    if (pose := self._pose(seen, other.seen))
                ]
                if near or far:
                    yield placed, [*near, *far]
            past = {other.number: _far_back(other, seen.number) for other in others} | {
                seen.number: placed
            }

    def _near(self, frame: tuple[_Seen, PhotometricView, Sequence[_Seen]]) -> _Near:
        """The frame, and its poses relative to earlier frames that show the same spots."""
        seen, view, before = frame
        return (
            seen,
            view,
            [(other.number, pose) for other in before if (pose := self._pose(seen, other))],
        )

    def _window(self, frame: _Placed, others: _Others) -> Observations:
        """The observations of spots that a frame and others, placed by features, show."""
        view = frame.view or self._view(frame.seen)
        views = [
            replace(other.view or self._view(other.seen), T_world_camera=pose.T_a_b)
            for other, pose in others
        ]
        seen_by = [frame.number, *(other.number for other, _ in others)]
        return observations_of(view.patches_m(LOOK.patches), [view, *views], seen_by)

    def _placed(
        self, seen: _Seen, view: PhotometricView, near: Sequence[tuple[_Placed, RelativePose]]
    ) -> _Placed:
        """The frame placed by the nearest frame before it; without one, it starts a chain."""
        chain, T, path_m = seen.number, np.eye(4), 0.0
        if near:
            other, pose = near[-1]
            chain, T = other.chain, other.T_chain_camera @ inverse(pose.T_a_b)
            path_m = other.path_m + float(np.linalg.norm(pose.T_a_b[:3, 3]))
        known = seen.key.range_m[np.isfinite(seen.key.range_m)]
        range_m = float(np.median(known)) if known.size else np.nan
        width_m = range_m * self.geometry.image_size[0] / self.geometry.focal_px
        return _Placed(seen, chain, T, path_m, T[:3, 3] + range_m * T[:3, 2], width_m, view)

    def _pose(self, frame: _Seen, other: _Seen) -> RelativePose | None:
        return relative_pose(frame.features, other.features, self.geometry)

    def _view(self, frame: _Seen) -> PhotometricView:
        return PhotometricView.of(frame.key, self.geometry, self.encoding)

    def _seen(self, frame: tuple[int, Any]) -> tuple[_Seen, PhotometricView]:
        number, source = frame
        image, range_m = self.read(source)
        every, geometry = self.every, self.geometry
        height, width = (side // every for side in range_m.shape)
        small = cv2.resize(
            image[: height * every, : width * every], (width, height), interpolation=cv2.INTER_AREA
        )
        ranges = np.ascontiguousarray(
            range_m[every // 2 :: every, every // 2 :: every][:height, :width]
        )
        shown = small if small.dtype == np.uint8 else (small >> 8).astype(np.uint8)
        known = np.isfinite(ranges).astype(np.uint8) * np.uint8(255)
        shown_frame = SurveyFrame(
            "", None, shown, ranges, geometry.estimated_range_std_m(ranges), known
        )
        seen = _Seen(
            number, KeyFrame(small, ranges, np.eye(4)), detect(shown_frame, geometry, FEATURES)
        )
        return seen, self._view(seen)


def _with_before(
    frames: Iterable[tuple[_Seen, PhotometricView]],
) -> Iterator[tuple[_Seen, PhotometricView, Sequence[_Seen]]]:
    """Each frame with the frames before it that it is compared with."""
    past: deque[_Seen] = deque(maxlen=max(LOOK.back))
    for seen, view in frames:
        yield seen, view, [other for other in past if seen.number - other.number in LOOK.back]
        past.append(seen)


def _loops(frame: _Placed, past: Sequence[_Placed]) -> list[_Placed]:
    """Frames of other lines whose images overlap by the chain, the nearest first."""
    found = [
        other
        for other in past
        if frame.number - other.number > max(LOOK.back) and _is_loop(frame, other)
    ]
    return sorted(found, key=lambda other: _apart_m(frame, other))


def _is_loop(frame: _Placed, other: _Placed) -> bool:
    """Whether the frames' images overlap because the track came back, not by going on."""
    distance_m = float(np.linalg.norm(frame.T_chain_camera[:3, 3] - other.T_chain_camera[:3, 3]))
    came_back = (
        frame.chain == other.chain and frame.path_m - other.path_m > LOOK.loop_detour * distance_m
    )
    return came_back and _apart_m(frame, other) < LOOK.loop_reach * min(
        frame.width_m, other.width_m
    )


def _apart_m(frame: _Placed, other: _Placed) -> float:
    """Distance between the middles of what two frames show, meters."""
    return float(np.linalg.norm(other.middle_m - frame.middle_m))


def _far_back(frame: _Placed, number: int) -> _Placed:
    """The frame without its view, which takes five times the memory of its image, once only loops
    come back to it.
    """
    return frame if number - frame.number < max(LOOK.back) else replace(frame, view=None)


def reduction(geometry: RectifiedPair) -> int:
    """Pixels of the image in a pixel of the reduced image, along each side."""
    return max(1, round(geometry.image_size[0] / LOOK.width_px))
