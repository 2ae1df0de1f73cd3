"""The light of a dive from what neighboring frames both show: features place the frames, their range maps find the same spots."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.color.photometry.gain_chain import Differences, DifferenceTable, differences, solve_chain
from stereo_seecolor.color.photometry.light_model import FrameGains
from stereo_seecolor.color.photometry.light_solver import Use
from stereo_seecolor.color.photometry.recorded_exposure import explain, log_exposures, offsets_about, solve_recorded, worth_a_look
from stereo_seecolor.color.photometry.sightings import KeyFrame, View, look
from stereo_seecolor.color.photometry.survey_light import SeenWindow, SurveyLight, solve_light
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.geometry import estimated_range_std_m
from stereo_seecolor.mapping.track.features import Features, FeatureSettings, detect
from stereo_seecolor.mapping.track.relative_pose import relative_pose
from stereo_seecolor.records import Capture, Image, Map, SurveyFrame

Array = NDArray[np.float64]
ReadFrame = Callable[[Any], tuple[Image, Map]]
Shown = TypeVar("Shown")
Differing = tuple[NDArray[np.int64], Differences]
"""A window's frames, and how they differ."""


@dataclass(frozen=True)
class Look:
    """How spots are found that several frames show."""

    width_px: int = 480
    """Images are reduced to about it: lamps and lenses are smooth. With 700 pixels a real dive's pattern is the same to 0.01."""
    back: tuple[int, ...] = (1, 2, 4)
    """Frames before that each frame is held against: the farther back, the more of the picture a spot has crossed. Without the
    fourth before, gains drift (offsets of 0.11 instead of 0.09 on a real dive)."""
    patches: int = 800
    """Spots looked for in each frame, on a grid: some 500 are seen again."""


LOOK = Look()

FEATURES = FeatureSettings(max_features=600, max_width_px=240)
"""By which a frame is placed against another. A pose among neighbors needs some 50 matches, a map's track many more: on a real dive
the light (logarithm) is the same to 0.03 as with 800 features at 360 pixels, and how much it helps is the same to noise.
"""


@dataclass(frozen=True)
class SampleSettings:
    """Of which frames of a long dive the pattern is solved."""

    stretch: int = 5
    """Frames of a stretch: one more than the farthest back."""
    most_frames: int = 60
    """In all: 60 frames give 60,000 sightings for at most 150 numbers."""


SAMPLE = SampleSettings()


@dataclass(frozen=True)
class StretchSettings:
    """Frames that are looked at together, as one piece of work: the cut shows in no result."""

    frames: int = 64
    """A stretch begins with four frames of the one before, which are looked at twice. Some five seconds of work for one core, so
    that 10,000 frames are enough for a hundred workers."""
    least: int = 15
    """Where there are fewer frames than that for each core: three stretches of a long dive's sample, which overlap with nothing."""

    def length(self, frames: int, parts: int) -> int:
        """Frames a stretch, of so many that are cut into so many parts at least."""
        return max(min(self.frames, -(-frames // parts)), self.least)


STRETCH = StretchSettings()


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
    """frames: the name of each frame of the dive, in order, and by what ``read`` finds its image and its ranges.
    captures: what the camera recorded of each. geometry: of the rectified images. compute: where frames are looked at.
    """

    frames: Sequence[tuple[str, Any]]
    read: ReadFrame
    captures: Sequence[Capture]
    geometry: RectifiedPair
    encoding: InputEncoding
    compute: Compute

    def solve(self, allowed: Use) -> Found:
        """The light of the dive, with terms that are ``allowed``.

        The pattern of a long dive is solved from a part of it, and then all frames are looked at for their gains.
        """
        names = [name for name, _ in self.frames]
        chosen = looked_at(len(names))
        geometry = reduced(self.geometry)
        look_at = _FrameLook(self.read, geometry, reduction(self.geometry), self.encoding)
        windows = list(self._looked(chosen, _WindowLook(look_at)))
        links = _Links(len(names))
        for window in windows:
            links.add(window.frames)
        size = geometry.image_size
        light = solve_light(windows, names, size, allowed)
        recorded = log_exposures(self.captures)
        looked = light is not None and allowed.gains and worth_a_look(recorded)
        offsets = self._offsets_about(recorded, light, windows) if light and looked else None
        confirmed = recorded if offsets and explain(offsets) else None
        if confirmed is not None:
            light = solve_light(windows, names, size, allowed, confirmed)
        elif light:
            light = replace(light, refused=offsets)
        if light and len(chosen) < len(names) and allowed.gains:
            every = self._looked(range(len(names)), _DifferenceLook(look_at, light))
            light = self._followed(light, names, every, links, confirmed)
        elif light and (light.solved.gains or light.recorded):
            few = [(seen.frames, differences(seen, light, size)) for seen in windows]
            light = self._followed(light, names, few, links, confirmed)
        return Found(light, tuple(names[k] for k in np.flatnonzero(links.frames)))

    def _offsets_about(self, recorded: Array, light: SurveyLight, windows: Iterable[SeenWindow]) -> tuple[float, float] | None:
        """How frames differ without and with the (F,) records; None where no two frames show the same."""
        size = reduced(self.geometry).image_size
        found = DifferenceTable()
        for window in windows:
            found.add(differences(window, light, size))
        return offsets_about(found.all, recorded) if len(found.all) else None

    @staticmethod
    def _followed(
        light: SurveyLight, names: Sequence[str], windows: Iterable[Differing], links: "_Links", recorded: Array | None
    ) -> SurveyLight:
        """With the gains of all frames, which have these names; with none where they do not help."""
        table = DifferenceTable()
        for frames, differing in windows:
            links.add(frames)
            table.add(differing)
        found, number, chosen = table.all, len(names), (light.luminance.use.gains, light.color.use.gains)
        solved = solve_chain(found, number, chosen) if recorded is None else solve_recorded(found, recorded, chosen)
        measured = solved.measured & solved.gains.any()
        named = (name for name, known in zip(names, measured, strict=True) if known)
        return light.with_gains(FrameGains(named, solved.gains[measured]), solved.offsets)

    def _looked(self, numbers: Sequence[int], look_at: "Callable[[_Stretch], list[Shown]]") -> Iterator[Shown]:
        """What each frame shows that frames before it show too, in order; nothing for a frame without such."""
        parts = self.compute.parts
        look_at_all = self.compute.tiles if parts == 1 else self.compute.each
        for shown in look_at_all(look_at, _Stretches(numbers, self.frames, STRETCH.length(len(numbers), parts))):
            yield from shown


@dataclass(frozen=True, eq=False)
class _Stretch:
    """frames: numbers in the dive, and by what each is read. before: so many of them belong to the stretch before."""

    before: int
    frames: tuple[tuple[int, Any], ...]


@dataclass(frozen=True, eq=False)
class _Stretches(Lazy[_Stretch]):
    """All numbers, ``length`` a stretch: each once but for those that a stretch begins with to hold its own against."""

    numbers: Sequence[int]
    frames: Sequence[tuple[str, Any]]
    length: int

    def __len__(self) -> int:
        return -(-len(self.numbers) // self.length)

    def item(self, number: int) -> _Stretch:
        """The stretch of this number."""
        numbers, start, back = self.numbers, number * self.length, max(LOOK.back)
        before = [number for number in numbers[max(start - back, 0) : start] if numbers[start] - number <= back]
        several = [*before, *numbers[start : start + self.length]]
        return _Stretch(len(before), tuple((number, self.frames[number][1]) for number in several))


@dataclass(frozen=True, eq=False)
class _FrameLook:
    """How frames are looked at, as work that can be sent to another process. geometry: of images reduced ``every`` times."""

    read: ReadFrame
    geometry: RectifiedPair
    every: int
    encoding: InputEncoding

    def windows(self, stretch: _Stretch) -> Iterator[SeenWindow]:
        """Those of a stretch's own frames."""
        last: list[_Seen] = []
        for place, seen in enumerate(Threads(cores()).each(self._seen, stretch.frames)):
            before = [other for other in last if seen.number - other.number in LOOK.back]
            window = self._window(seen, before) if place >= stretch.before else None
            if window:
                yield window
            last = [*last, seen][-max(LOOK.back) :]

    def _window(self, frame: _Seen, before: Sequence[_Seen]) -> SeenWindow | None:
        """What a frame shows and frames before it, placed by features, show too; None where none of them does."""
        views, seen_by = [frame.view], [frame.number]
        for other in before:
            pose = relative_pose(frame.features, other.features, self.geometry)
            if pose is not None:
                views.append(replace(other.view, T_world_camera=pose.T_a_b))
                seen_by.append(other.number)
        if len(views) == 1:
            return None
        return SeenWindow(np.array(seen_by), look(frame.view.patches_m(LOOK.patches), views))

    def _seen(self, frame: tuple[int, Any]) -> _Seen:
        number, source = frame
        image, range_m = self.read(source)
        every, geometry = self.every, self.geometry
        height, width = (side // every for side in range_m.shape)
        small = cv2.resize(image[: height * every, : width * every], (width, height), interpolation=cv2.INTER_AREA)
        ranges = np.ascontiguousarray(range_m[every // 2 :: every, every // 2 :: every][:height, :width])
        shown = small if small.dtype == np.uint8 else (small >> 8).astype(np.uint8)
        known = np.isfinite(ranges).astype(np.float32)
        shown_frame = SurveyFrame("", None, shown, ranges, estimated_range_std_m(ranges, geometry), known)
        view = View.of(KeyFrame(small, ranges, np.eye(4)), geometry, self.encoding)
        return _Seen(number, view, detect(shown_frame, geometry, FEATURES))


@dataclass(frozen=True, eq=False)
class _WindowLook:
    """Windows with all their sightings, some 200 kB each: for the pattern, of which few frames are asked."""

    frames: _FrameLook

    def __call__(self, stretch: _Stretch) -> list[SeenWindow]:
        return list(self.frames.windows(stretch))


@dataclass(frozen=True, eq=False)
class _DifferenceLook:
    """How a window's frames differ once the pattern is taken out: small, for every frame of a long dive."""

    frames: _FrameLook
    light: SurveyLight

    def __call__(self, stretch: _Stretch) -> list[Differing]:
        size = self.frames.geometry.image_size
        return [(seen.frames, differences(seen, self.light, size)) for seen in self.frames.windows(stretch)]


class _Links:
    """frames: (F,) those that show what a frame before them shows, and all between."""

    def __init__(self, frames: int) -> None:
        self.frames = np.zeros(frames, np.bool_)

    def add(self, frames: NDArray[np.int64]) -> None:
        """The frames of one more window."""
        self.frames[frames.min() + 1 : frames.max() + 1] = True


def looked_at(frames: int) -> list[int]:
    """Of which of a dive's frames the pattern is solved: all of a short one, stretches spread over a long one."""
    if frames <= SAMPLE.most_frames:
        return list(range(frames))
    starts = np.linspace(0, frames - SAMPLE.stretch, SAMPLE.most_frames // SAMPLE.stretch).astype(int)
    return sorted({int(start) + k for start in starts for k in range(SAMPLE.stretch)})


def reduction(geometry: RectifiedPair) -> int:
    """Pixels of the image a pixel of the reduced one."""
    return max(1, round(geometry.image_size[0] / LOOK.width_px))


def reduced(geometry: RectifiedPair, every: int | None = None) -> RectifiedPair:
    """The geometry of the reduced images; of which a pixel is ``every`` pixels wide, where that is given."""
    every = every or reduction(geometry)
    cx, cx_right, cy = ((c + 0.5) / every - 0.5 for c in (geometry.cx_left_px, geometry.cx_right_px, geometry.cy_px))
    size = geometry.image_size[0] // every, geometry.image_size[1] // every
    return RectifiedPair(geometry.focal_px / every, cx, cx_right, cy, geometry.baseline_m, size)
