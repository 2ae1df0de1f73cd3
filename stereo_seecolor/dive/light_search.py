"""The light of a dive from what neighboring frames both show: features place the frames, their range maps find the same spots."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.color.photometry.color_beside_water import beside_water
from stereo_seecolor.color.photometry.frame_shading import Parts, solve_shading, without_shading
from stereo_seecolor.color.photometry.gain_chain import DIFFERENCE, Differences, DifferenceTable, differences, solve_chain
from stereo_seecolor.color.photometry.light_model import SHADING, ByFrame
from stereo_seecolor.color.photometry.light_solver import Use
from stereo_seecolor.color.photometry.recorded_exposure import explain, log_exposures, offsets_about, solve_recorded, worth_a_look
from stereo_seecolor.color.photometry.survey_light import SurveyLight, solve_light
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.compute.names import Names, SomeNames
from stereo_seecolor.dive.overlap import LOOK, FrameLook, PlacedWindow, ReadFrame, Stretch, reduced, reduction
from stereo_seecolor.mapping.track.known_steps import STEP
from stereo_seecolor.records import Capture

Array = NDArray[np.float64]
Shown = TypeVar("Shown")
Differing = tuple[NDArray[np.int64], tuple[Differences, Parts], NDArray[np.void]]
"""A window's frames, how they and parts of them differ, and how they lie to each other."""


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
    """Frames that are examined together, as one piece of work: the cut shows in no result."""

    frames: int = 64
    """A stretch begins with four frames of the one before, which are examined twice. Some five seconds of work for one core, so
    that 10,000 frames are enough for a hundred workers."""
    least: int = 15
    """Where there are fewer frames than that for each core: three stretches of a long dive's sample, which overlap with nothing."""

    def length(self, frames: int, parts: int) -> int:
        """Frames in each stretch, if ``frames`` are cut into at least ``parts`` parts."""
        return max(min(self.frames, -(-frames // parts)), self.least)


STRETCH = StretchSettings()
MOST_SHADED = 100_000
"""Frames of a dive that is examined for shading: 100 MB of parts of pictures, and as much again to solve them."""
MOST_STEPS = 20_000
"""Frames of a dive whose relative poses are kept for a first look at its map: 10 MB of memory; of a million it were half a GB."""


@dataclass(frozen=True, eq=False)
class Found:
    """light: of the dive; None where no two frames show the same. linked: names of frames that show what frames before them show,
    and of all between those: no cut through the dive separates them from the frame before.
    steps: (S,) STEP between neighbors that were looked at.
    """

    light: SurveyLight | None
    linked: SomeNames
    steps: NDArray[np.void]


@dataclass(frozen=True, eq=False)
class LightSearch:
    """frames: the name of each frame of the dive, in order, and the key with which ``read`` finds its image and its ranges.
    captures: what the camera recorded of each. geometry: of the rectified images. compute: where frames are examined.
    windows: of a short dive, where its frames were examined while they were measured. examined: called with the name of each frame
    that was examined, where all frames are.
    """

    frames: Sequence[tuple[str, Any]]
    read: ReadFrame
    captures: Sequence[Capture]
    geometry: RectifiedPair
    encoding: InputEncoding
    compute: Compute
    windows: Sequence[PlacedWindow] | None = None
    examined: Callable[[str], None] = lambda _: None

    def windows_of(self, frames: Iterable[Any]) -> list[PlacedWindow]:
        """What the frames of a short dive show, each examined as soon as it comes: for ``windows``."""
        return list(self._frame_look.windows(Stretch(0, enumerate(frames)), LOOK.loops))

    @property
    def _frame_look(self) -> FrameLook:
        return FrameLook(self.read, reduced(self.geometry), reduction(self.geometry), self.encoding)

    def solve(self, allowed: Use) -> Found:
        """The light of the dive, with terms that are ``allowed``.

        The pattern of a long dive is solved from a part of it, and then all frames are examined for their gains.
        """
        names = Names(name for name, _ in self.frames)
        allowed = allowed._replace(shading=allowed.shading and len(names) <= MOST_SHADED)
        chosen = looked_at(len(names))
        look_at = self._frame_look
        parts = self.compute.parts if len(chosen) < len(names) else 1  # a cut would part the loops of a short dive
        windows = list(self._looked(chosen, _WindowLook(look_at), parts)) if self.windows is None else self.windows
        links = _Links(len(names))
        for window in windows:
            links.add(window.frames, window.steps)
        size = look_at.geometry.image_size
        light = solve_light(windows, names, size, allowed)
        recorded = log_exposures(self.captures)
        looked = light is not None and allowed.gains and worth_a_look(recorded)
        offsets = self._offsets_about(recorded, light, windows) if light and looked else None
        confirmed = recorded if offsets and explain(offsets) else None
        if confirmed is not None:
            light = solve_light(windows, names, size, allowed, confirmed)
        elif light:
            light = replace(light, refused=offsets)
        light = light and beside_water(light, windows, names, size, confirmed)
        if light and len(chosen) < len(names) and allowed.gains:
            every = self._looked(range(len(names)), _DifferenceLook(look_at, light), self.compute.parts)
            light = self._followed(light, names, every, links, confirmed, None)
        elif light and (allowed.gains or light.recorded):
            few = [(seen.frames, differences(seen, light, size), seen.steps) for seen in windows]
            nothing = np.zeros(3 * SHADING)
            shading = np.array([light.solved.shading.get(name, nothing) for name in names]).reshape(-1, SHADING, 3)
            light = self._followed(light, names, few, links, confirmed, shading)
        return Found(light, SomeNames(names, links.frames), links.all_steps)

    def _offsets_about(self, recorded: Array, light: SurveyLight, windows: Iterable[PlacedWindow]) -> tuple[float, float] | None:
        """How frames differ without and with the (F,) records; None where no two frames show the same."""
        size = reduced(self.geometry).image_size
        found = np.concatenate([np.zeros(0, DIFFERENCE), *(differences(window, light, size)[0] for window in windows)])
        return offsets_about(found, recorded) if len(found) else None

    @staticmethod
    def _followed(
        light: SurveyLight,
        names: Names,
        windows: Iterable[Differing],
        links: "_Links",
        recorded: Array | None,
        shading: Array | None,
    ) -> SurveyLight:
        """With the gains of all frames, which have these names; with none where they do not help. shading: of all frames, where
        it is known; else it follows from the windows.
        """
        table = DifferenceTable()
        for frames, differing, steps in windows:
            links.add(frames, steps)
            table.add(*differing)
        if shading is None:
            shading = solve_shading(table.parts, len(names), (light.luminance.use.shading, light.color.use.shading))
        found, known = without_shading(table.whole, table.parts, shading), np.zeros(len(names))
        chosen = light.luminance.use.gains, light.color.use.gains
        solved = solve_chain(found, known, chosen) if recorded is None else solve_recorded(found, recorded, chosen)
        measured = solved.measured & solved.gains.any()
        gains = ByFrame(names, np.where(measured[:, None], solved.gains, np.nan))
        flat = shading.reshape(len(names), -1)
        own = ByFrame(names, np.where(flat.any(axis=1, keepdims=True), flat, np.nan)) if flat.any() else ByFrame()
        return light.of_frames(gains, own, solved.offsets)

    def _looked(self, numbers: Sequence[int], look_at: "Callable[[Stretch], list[Shown]]", parts: int) -> Iterator[Shown]:
        """What each frame shows that frames before it show too, in order; nothing for a frame without such."""
        look_at_all = self.compute.tiles if parts == 1 else self.compute.each
        length = STRETCH.length(len(numbers), parts)
        for stretch, shown in enumerate(look_at_all(look_at, _Stretches(numbers, self.frames, length))):
            yield from shown
            if len(numbers) == len(self.frames):
                for number in numbers[stretch * length : (stretch + 1) * length]:
                    self.examined(self.frames[number][0])


@dataclass(frozen=True, eq=False)
class _Stretches(Lazy[Stretch]):
    """All numbers, ``length`` a stretch: each once but for those that a stretch begins with to hold its own against."""

    numbers: Sequence[int]
    frames: Sequence[tuple[str, Any]]
    length: int

    def __len__(self) -> int:
        return -(-len(self.numbers) // self.length)

    def item(self, number: int) -> Stretch:
        """The stretch of this number."""
        numbers, start, back = self.numbers, number * self.length, max(LOOK.back)
        before = [number for number in numbers[max(start - back, 0) : start] if numbers[start] - number <= back]
        several = [*before, *numbers[start : start + self.length]]
        return Stretch(len(before), tuple((number, self.frames[number][1]) for number in several))


@dataclass(frozen=True, eq=False)
class _WindowLook:
    """Windows with all their sightings, some 200 kB each: for the pattern, of which few frames are asked. With loops."""

    frames: FrameLook

    def __call__(self, stretch: Stretch) -> list[PlacedWindow]:
        return list(self.frames.windows(stretch, LOOK.loops))


@dataclass(frozen=True, eq=False)
class _DifferenceLook:
    """How a window's frames differ once the pattern is taken out: small, for every frame of a long dive. Without loops, which a
    cut between stretches would break.
    """

    frames: FrameLook
    light: SurveyLight

    def __call__(self, stretch: Stretch) -> list[Differing]:
        return list(self.frames.of_windows(stretch, 0, self._differing))

    def _differing(self, seen: PlacedWindow) -> Differing:
        return seen.frames, differences(seen, self.light, self.frames.geometry.image_size), seen.steps


class _Links:
    """frames: (F,) those that show what a frame before them shows, and all between. steps: of each frame to those before it, in
    dives of at most ``MOST_STEPS``.
    """

    def __init__(self, frames: int) -> None:
        self.frames = np.zeros(frames, np.bool_)
        self.steps: dict[int, NDArray[np.void]] = {}

    @property
    def all_steps(self) -> NDArray[np.void]:
        """(S,) STEP, of all windows."""
        return np.concatenate([np.zeros(0, STEP), *self.steps.values()])

    def add(self, frames: NDArray[np.int64], steps: NDArray[np.void]) -> None:
        """The frames of one more window, its own frame first; loops link nothing."""
        near = frames[frames[0] - frames <= max(LOOK.back)]
        self.frames[near.min() + 1 : near.max() + 1] = True
        if len(self.frames) <= MOST_STEPS:
            self.steps.setdefault(int(frames[0]), steps)


def is_short(frames: int) -> bool:
    """Whether a dive of ``frames`` frames is so short that its pattern is solved from all of them."""
    return frames <= SAMPLE.most_frames


def looked_at(frames: int) -> list[int]:
    """Of which of a dive's frames the pattern is solved: all of a short one, stretches spread over a long one."""
    if is_short(frames):
        return list(range(frames))
    starts = np.linspace(0, frames - SAMPLE.stretch, SAMPLE.most_frames // SAMPLE.stretch).astype(int)
    return sorted({int(start) + k for start in starts for k in range(SAMPLE.stretch)})
