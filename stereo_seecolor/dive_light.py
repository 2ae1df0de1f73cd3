"""The light of a dive from what neighboring frames both show: features place the frames, their range maps find the same spots."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration import RectifiedPair
from stereo_seecolor.color.photometry.light_solver import Use
from stereo_seecolor.color.photometry.sightings import KeyFrame, View, look
from stereo_seecolor.color.photometry.survey_light import SeenWindow, SurveyLight, solve_light
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.geometry import estimated_range_std_m
from stereo_seecolor.mapping.track.features import Features, detect
from stereo_seecolor.mapping.track.relative_pose import relative_pose
from stereo_seecolor.records import Image, Map, SurveyFrame

ReadFrame = Callable[[], tuple[Image, Map]]


@dataclass(frozen=True)
class SightingSettings:
    """How spots are found that several frames show."""

    width_px: int = 700
    """Images are reduced to about it: lamps and lenses are smooth, and a fourth of the pixels takes a fourth of the time."""
    patches: int = 800
    """Spots looked for in each frame, on a grid: some 500 are seen again."""
    back: tuple[int, ...] = (1, 2, 4)
    """Frames before that each frame is held against: the farther, the more of the picture a spot has crossed."""
    stretch: int = 5
    """Frames of a stretch where only stretches of a long dive are looked at: one more than the farthest back."""
    most_frames: int = 60
    """Looked at in a dive: 60 frames give 60,000 sightings for at most 150 numbers."""


SETTINGS = SightingSettings()


@dataclass(frozen=True, eq=False)
class Found:
    """light: of the dive; None where no two frames show the same. linked: names of frames that show what frames before them show,
    and of all between those: no cut through the dive separates them from the frame before.
    """

    light: SurveyLight | None
    linked: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Seen:
    """A frame reduced. number: in the dive. view: of the camera at the origin. features: by which it is placed."""

    number: int
    view: View
    features: Features
    geometry: RectifiedPair


@dataclass(frozen=True, eq=False)
class LightSearch:
    """frames: how each frame of the dive is read, and its name, in order. geometry: of the rectified images."""

    frames: Sequence[tuple[str, ReadFrame]]
    geometry: RectifiedPair
    encoding: InputEncoding

    def solve(self, allowed: Use) -> Found:
        """The light of the dive, with terms that are ``allowed``; on this machine, also where others do the frames."""
        names = [name for name, _ in self.frames]
        chosen = looked_at(len(names))
        whole = len(chosen) == len(names)
        windows = list(self._windows(Threads(cores()).each(self._seen, chosen)))
        linked = {k for window in windows for k in range(int(window.frames.min()) + 1, int(window.frames.max()) + 1)}
        allowed = allowed if whole else allowed._replace(gains=False)
        light = solve_light(windows, names, windows_size(self.geometry), allowed)
        return Found(light, tuple(names[k] for k in sorted(linked)))

    def _seen(self, number: int) -> _Seen:
        image, range_m = self.frames[number][1]()
        every = reduction(self.geometry)
        height, width = (side // every for side in range_m.shape)
        small = cv2.resize(image[: height * every, : width * every], (width, height), interpolation=cv2.INTER_AREA)
        ranges = np.ascontiguousarray(range_m[every // 2 :: every, every // 2 :: every][:height, :width])
        geometry = reduced(self.geometry)
        shown = small if small.dtype == np.uint8 else (small >> 8).astype(np.uint8)
        known = np.isfinite(ranges).astype(np.float32)
        frame = SurveyFrame("", None, shown, ranges, estimated_range_std_m(ranges, geometry), known)
        view = View.of(KeyFrame(small, ranges, np.eye(4)), geometry, self.encoding)
        return _Seen(number, view, detect(frame, geometry), geometry)

    def _windows(self, frames: Iterator[_Seen]) -> Iterator[SeenWindow]:
        """One for each frame: its spots, where frames before it show them too."""
        last: list[_Seen] = []
        for frame in frames:
            before = [other for other in last if frame.number - other.number in SETTINGS.back]
            views, numbers = [frame.view], [frame.number]
            for other in before:
                pose = relative_pose(frame.features, other.features, frame.geometry)
                if pose is not None:
                    views.append(replace(other.view, T_world_camera=pose.T_a_b))
                    numbers.append(other.number)
            if len(views) > 1:
                yield SeenWindow(np.array(numbers), look(frame.view.patches_m(SETTINGS.patches), views))
            last = [*last, frame][-max(SETTINGS.back) :]


def looked_at(frames: int) -> list[int]:
    """Which of a dive's frames are looked at: all of a short one, stretches spread over a long one."""
    if frames <= SETTINGS.most_frames:
        return list(range(frames))
    starts = np.linspace(0, frames - SETTINGS.stretch, SETTINGS.most_frames // SETTINGS.stretch).astype(int)
    return sorted({int(start) + k for start in starts for k in range(SETTINGS.stretch)})


def reduction(geometry: RectifiedPair) -> int:
    """Pixels of the image a pixel of the reduced one."""
    return max(1, round(geometry.image_size[0] / SETTINGS.width_px))


def windows_size(geometry: RectifiedPair) -> tuple[int, int]:
    """(width, height) of the reduced images."""
    width, height = geometry.image_size
    return width // reduction(geometry), height // reduction(geometry)


def reduced(geometry: RectifiedPair) -> RectifiedPair:
    """The geometry of the reduced images."""
    every = reduction(geometry)
    cx, cx_right, cy = ((c + 0.5) / every - 0.5 for c in (geometry.cx_left_px, geometry.cx_right_px, geometry.cy_px))
    return RectifiedPair(geometry.focal_px / every, cx, cx_right, cy, geometry.baseline_m, windows_size(geometry))
