"""The light of a dive from what neighboring frames both show: features place the frames, their range maps find the same spots."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.color.photometry.gain_chain import Difference, differences, solve_chain
from stereo_seecolor.color.photometry.light_solver import Use
from stereo_seecolor.color.photometry.recorded_exposure import explains, log_exposures, solve_recorded, worth_a_look
from stereo_seecolor.color.photometry.sightings import KeyFrame, View, look
from stereo_seecolor.color.photometry.survey_light import SeenWindow, SurveyLight, solve_light
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.geometry import estimated_range_std_m
from stereo_seecolor.mapping.track.features import Features, FeatureSettings, detect
from stereo_seecolor.mapping.track.relative_pose import relative_pose
from stereo_seecolor.records import Capture, Image, Map, SurveyFrame

Array = NDArray[np.float64]
ReadFrame = Callable[[], tuple[Image, Map]]


@dataclass(frozen=True)
class Look:
    """How spots are found that several frames show."""

    width_px: int
    """Images are reduced to about it: lamps and lenses are smooth, and a fourth of the pixels takes a fourth of the time."""
    back: tuple[int, ...]
    """Frames before that each frame is held against."""
    patches: int = 800
    """Spots looked for in each frame, on a grid: some 500 are seen again."""


WHOLE = Look(width_px=700, back=(1, 2, 4))
"""For the pattern: the farther back, the more of the picture a spot has crossed."""
NEIGHBORS = Look(width_px=480, back=(1, 2, 4))
"""For the gains of a long dive, of every frame: a third of the time. Without the fourth before gains drift (offsets of 0.11 instead
of 0.09 on a real dive)."""

FEATURES = FeatureSettings(max_features=800, max_width_px=360)
"""By which a frame is placed against another. A pose among neighbors needs some 50 matches, a map's track many more: on a real dive
and on half of it the light, and how much it helps, are the same to noise as with 480 pixels, and as with 2000 features at 960.
"""


@dataclass(frozen=True)
class SampleSettings:
    """Of which frames of a long dive the pattern is solved."""

    stretch: int = 5
    """Frames of a stretch: one more than the farthest back."""
    most_frames: int = 60
    """In all: 60 frames give 60,000 sightings for at most 150 numbers."""


SAMPLE = SampleSettings()


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


@dataclass(frozen=True, eq=False)
class LightSearch:
    """frames: how each frame of the dive is read, and its name, in order. captures: what the camera recorded of each.
    geometry: of the rectified images.
    """

    frames: Sequence[tuple[str, ReadFrame]]
    captures: Sequence[Capture]
    geometry: RectifiedPair
    encoding: InputEncoding

    def solve(self, allowed: Use) -> Found:
        """The light of the dive, with terms that are ``allowed``; on this machine, also where others do the frames.

        The pattern of a long dive is solved from a part of it, and then all frames are looked at for their gains.
        """
        names = [name for name, _ in self.frames]
        chosen = looked_at(len(names))
        windows = list(self._windows(chosen, WHOLE))
        links = _Links()
        for window in windows:
            links.add(window)
        size = reduced(self.geometry, WHOLE).image_size
        light = solve_light(windows, names, size, allowed)
        recorded = self._recorded(light, windows) if light and allowed.gains else None
        if recorded is not None:
            light = solve_light(windows, names, size, allowed, recorded)
        if light and len(chosen) < len(names) and allowed.gains:
            light = self._followed(light, self._windows(range(len(names)), NEIGHBORS), NEIGHBORS, links, recorded)
        elif light and (light.solved.gains or light.recorded):
            light = self._followed(light, windows, WHOLE, links, recorded)
        return Found(light, tuple(names[k] for k in sorted(links.frames)))

    def _recorded(self, light: SurveyLight, windows: Iterable[SeenWindow]) -> Array | None:
        """(F,) logarithms of the recorded exposures; None where they do not explain how frames differ."""
        recorded = log_exposures(self.captures)
        if not worth_a_look(recorded):
            return None
        size = reduced(self.geometry, WHOLE).image_size
        found = [difference for window in windows for difference in differences(window, light, size)]
        return recorded if explains(found, recorded) else None

    def _followed(
        self, light: SurveyLight, windows: Iterable[SeenWindow], how: Look, links: "_Links", recorded: Array | None
    ) -> SurveyLight:
        """With the gains of all frames; with none where they do not help."""
        size = reduced(self.geometry, how).image_size
        found: list[Difference] = []
        for window in windows:
            links.add(window)
            found.extend(differences(window, light, size))
        chosen = light.luminance.use.gains, light.color.use.gains
        solved = solve_chain(found, len(self.frames), chosen) if recorded is None else solve_recorded(found, recorded, chosen)
        measured = np.flatnonzero(solved.measured).tolist() if solved.gains.any() else []
        return light.with_gains({self.frames[k][0]: solved.gains[k] for k in measured}, solved.offsets)

    def _windows(self, numbers: Sequence[int], how: Look) -> Iterator[SeenWindow]:
        """One for each frame: its spots, where frames before it show them too."""
        geometry = reduced(self.geometry, how)
        last: list[_Seen] = []
        for frame in Threads(cores()).each(partial(self._seen, how), numbers):
            before = [other for other in last if frame.number - other.number in how.back]
            views, seen_by = [frame.view], [frame.number]
            for other in before:
                pose = relative_pose(frame.features, other.features, geometry)
                if pose is not None:
                    views.append(replace(other.view, T_world_camera=pose.T_a_b))
                    seen_by.append(other.number)
            if len(views) > 1:
                yield SeenWindow(np.array(seen_by), look(frame.view.patches_m(how.patches), views))
            last = [*last, frame][-max(how.back) :]

    def _seen(self, how: Look, number: int) -> _Seen:
        image, range_m = self.frames[number][1]()
        every, geometry = reduction(self.geometry, how), reduced(self.geometry, how)
        height, width = (side // every for side in range_m.shape)
        small = cv2.resize(image[: height * every, : width * every], (width, height), interpolation=cv2.INTER_AREA)
        ranges = np.ascontiguousarray(range_m[every // 2 :: every, every // 2 :: every][:height, :width])
        shown = small if small.dtype == np.uint8 else (small >> 8).astype(np.uint8)
        known = np.isfinite(ranges).astype(np.float32)
        frame = SurveyFrame("", None, shown, ranges, estimated_range_std_m(ranges, geometry), known)
        view = View.of(KeyFrame(small, ranges, np.eye(4)), geometry, self.encoding)
        return _Seen(number, view, detect(frame, geometry, FEATURES))


class _Links:
    """frames: numbers of those that show what a frame before them shows, and of all between."""

    def __init__(self) -> None:
        self.frames: set[int] = set()

    def add(self, window: SeenWindow) -> None:
        """The frames of one more window."""
        self.frames.update(range(int(window.frames.min()) + 1, int(window.frames.max()) + 1))


def looked_at(frames: int) -> list[int]:
    """Of which of a dive's frames the pattern is solved: all of a short one, stretches spread over a long one."""
    if frames <= SAMPLE.most_frames:
        return list(range(frames))
    starts = np.linspace(0, frames - SAMPLE.stretch, SAMPLE.most_frames // SAMPLE.stretch).astype(int)
    return sorted({int(start) + k for start in starts for k in range(SAMPLE.stretch)})


def reduction(geometry: RectifiedPair, how: Look) -> int:
    """Pixels of the image a pixel of the reduced one."""
    return max(1, round(geometry.image_size[0] / how.width_px))


def reduced(geometry: RectifiedPair, how: Look) -> RectifiedPair:
    """The geometry of the reduced images."""
    every = reduction(geometry, how)
    cx, cx_right, cy = ((c + 0.5) / every - 0.5 for c in (geometry.cx_left_px, geometry.cx_right_px, geometry.cy_px))
    size = geometry.image_size[0] // every, geometry.image_size[1] // every
    return RectifiedPair(geometry.focal_px / every, cx, cx_right, cy, geometry.baseline_m, size)
