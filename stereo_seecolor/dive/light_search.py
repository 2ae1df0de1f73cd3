"""Solves the light of a dive from spots that several frames show: features place the frames, range
maps find the same spots.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.color.photometry.color_after_water import refit_color_after_water
from stereo_seecolor.color.photometry.light_model import ByFrame
from stereo_seecolor.color.photometry.light_of_frames import (
    Differences,
    Parts,
    differences,
    solve_frames,
)
from stereo_seecolor.color.photometry.light_solver import LightTerms
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.color.photometry.recorded_exposure import (
    explain,
    explain_better,
    is_informative,
    log_exposures,
    misread,
    offsets_about,
)
from stereo_seecolor.color.photometry.survey_light import SurveyLight, solve_light
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.names import Names, SomeNames
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.dive.overlap import LOOK, FrameMatcher, ReadFrame, Segment, reduction
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.records import Array, Capture

Shown = TypeVar("Shown")
OTHER_ENCODING = {"srgb": ("linear", encode_srgb), "linear": ("srgb", decode_srgb)}
"""Of images decoded as sRGB or linear: the rival, and its light from theirs."""
Differing = tuple[NDArray[np.int64], Differences]
"""A window's frame numbers, and the differences between these frames."""


@dataclass(frozen=True)
class SampleSettings:
    """The frames of a long dive from which the pattern is solved."""

    segment: int = 5
    """Frames of a segment: one more than the farthest back."""
    most_frames: int = 60
    """Frames in all: 60 give 60,000 observations for at most 150 unknowns."""


SAMPLE = SampleSettings()


@dataclass(frozen=True)
class LightSegments:
    """Frames examined together, as one piece of work; where the dive is cut changes no result."""

    frames: int = 64
    """A segment begins with four frames of the one before, which are examined twice. Some five
    seconds of work for one core, so that 10,000 frames are enough for a hundred workers.
    """
    least: int = 15
    """Frames of a segment at least, also of short dives: three segments of a long one's sample."""

    def length(self, frames: int, parts: int) -> int:
        """Frames in each segment, if ``frames`` are cut into at least ``parts`` parts."""
        return max(min(self.frames, -(-frames // parts)), self.least)


SEGMENTS = LightSegments()
MOST_SHADED = 100_000
"""Most frames examined for shading: 100 MB for parts of images, and as much to solve it."""


@dataclass(frozen=True, eq=False)
class Found:
    """The result of the search. light: None where no two frames show the same spots. linked: names
    of frames that show the same spots as a frame before them, with all frames between the two: the
    dive is not cut before them.
    """

    light: SurveyLight | None
    linked: SomeNames


@dataclass(frozen=True, eq=False)
class LightSearch:
    """The search for the light of one dive.

    frames: name of each frame, in order, and the key by which ``read`` finds its image and ranges.
    captures: what the camera recorded of each. geometry: of the rectified images. encoding: of the
    images that ``read`` gives. compute: where frames are examined. examined: called with the name
    of each frame, where all frames are examined. files: the encoding as which files were read.
    """

    frames: Sequence[tuple[str, Any]]
    read: ReadFrame
    captures: Sequence[Capture]
    geometry: RectifiedPair
    encoding: InputEncoding
    compute: Compute
    examined: Callable[[str], None] = lambda _: None
    files: InputEncoding = "srgb"

    @property
    def _frame_matcher(self) -> FrameMatcher:
        factor = reduction(self.geometry)
        return FrameMatcher(self.read, self.geometry.reduced(factor), factor, self.encoding)

    def solve(self, allowed: LightTerms) -> Found:
        """Solve the light of the dive, with terms that are ``allowed``.

        The pattern of a long dive is solved from a part of its frames. Then all frames are examined
        for their gains.
        """
        names = Names(name for name, _ in self.frames)
        allowed = allowed._replace(shading=allowed.shading and len(names) <= MOST_SHADED)
        sample = sampled_frames(len(names))
        is_sampled = len(sample) < len(names)
        # cutting a short dive would break its loops
        parts = self.compute.parts if is_sampled else 1
        windows = list(self._examined(sample, partial(windows_of, self._frame_matcher), parts))
        links = _Links(len(names))
        for window in windows:
            links.add(window.frames)
        light, recorded = self._pattern(windows, names, allowed, is_sampled)
        if light and allowed.gains and (is_sampled or not light.luminance.judged):
            look = partial(_differences_of, self._frame_matcher, light)
            every = self._examined(range(len(names)), look, self.compute.parts)
            few = ((seen.frames, differences(seen, light, self._size)) for seen in windows)
            light = self._of_frames(light, names, every if is_sampled else few, links, recorded)
        elif light and light.recorded:
            own = [
                light.solved.gains.get(name, np.full(3, record))
                for name, record in zip(names, recorded, strict=True)
            ]
            gains = ByFrame(names, np.array(own))
            light = replace(light, solved=replace(light.solved, gains=gains))
        return Found(light, SomeNames(names, links.frames))

    @property
    def _size(self) -> tuple[int, int]:
        """(width, height) of the reduced images in which spots are found."""
        return self.geometry.reduced(reduction(self.geometry)).image_size

    def _pattern(
        self, windows: Sequence[Observations], names: Names, allowed: LightTerms, is_sampled: bool
    ) -> tuple[SurveyLight | None, Array]:
        """The light solved from ``windows``, and the (F,) recorded exposures (logarithms); zeros
        unless they explain differences of frames.
        """
        recorded, nothing = log_exposures(self.captures), np.zeros(len(names))
        light = solve_light(windows, names, self._size, allowed, is_sampled=is_sampled)
        used, offsets = nothing, None
        if light and allowed.gains and is_informative(recorded):
            parts = self._parts(windows, light)
            offsets = offsets_about(parts, recorded) if len(parts) else None
            encoding = self._other_encoding(windows, light, recorded, offsets) if offsets else ""
            if offsets and explain(offsets) and not encoding:
                used = recorded
                light = solve_light(windows, names, self._size, allowed, used, is_sampled)
                light = light and replace(light, offsets=offsets)
            else:
                reading = encoding or (misread(parts, recorded) if offsets else "")
                light = replace(light, refused=offsets, reading=reading)
        return light and refit_color_after_water(light, windows, names, self._size), used

    def _parts(self, windows: Iterable[Observations], light: SurveyLight) -> Parts:
        return Differences.joined(differences(seen, light, self._size) for seen in windows).parts

    def _other_encoding(
        self,
        windows: Sequence[Observations],
        light: SurveyLight,
        recorded: Array,
        offsets: tuple[float, float],
    ) -> str:
        """The encoding of the images with which the records would explain what they do not as the
        images were decoded; "" for none. Only known exposures tell a response from its powers
        (Grossberg and Nayar, PAMI 2003).
        """
        if self.files not in OTHER_ENCODING:
            return ""
        name, convert = OTHER_ENCODING[self.files]
        others = (replace(seen, light=convert(seen.light)) for seen in windows)
        if not explain_better(offsets_about(self._parts(others, light), recorded), offsets):
            return ""
        return f"with color.input_encoding={name} they would explain the differences"

    def _of_frames(
        self,
        light: SurveyLight,
        names: Names,
        windows: Iterable[Differing],
        links: "_Links",
        recorded: Array,
    ) -> SurveyLight:
        """The light with the gains and shading of all frames; without gains where they do not help.

        links: gets the frames of each window.
        """

        def linked() -> Iterator[Differences]:
            for frames, differing in windows:
                links.add(frames)
                yield differing

        luminance, color = light.luminance.use, light.color.use
        solved = solve_frames(
            Differences.joined(linked()),
            recorded,
            (luminance.shading, color.shading),
            (light.luminance.error, light.color.error),
            (luminance.gains or None, color.gains or None),  # a sample does not judge other frames
        )
        measured = solved.measured & solved.gains.any()
        gains = ByFrame(names, np.where(measured[:, None], solved.gains, np.nan))
        flat = solved.shading.reshape(len(names), -1)
        own = ByFrame()
        if flat.any():
            own = ByFrame(names, np.where(flat.any(axis=1, keepdims=True), flat, np.nan))
        return light.of_frames(gains, own, solved.slopes, solved.offsets)

    def _examined(
        self, numbers: Sequence[int], look_at: "Callable[[Segment], list[Shown]]", parts: int
    ) -> Iterator[Shown]:
        """The windows of the frames of these numbers, in order; none of a frame that shows no spot
        of frames before it.

        parts: number of workers that share the work; 1: one worker, so that no loop is cut.
        """
        look_at_all = self.compute.tiles if parts == 1 else self.compute.each
        length = SEGMENTS.length(len(numbers), parts)
        for segment, shown in enumerate(
            look_at_all(look_at, _Segments(numbers, self.frames, length))
        ):
            yield from shown
            if len(numbers) == len(self.frames):
                for number in numbers[segment * length : (segment + 1) * length]:
                    self.examined(self.frames[number][0])


@dataclass(frozen=True, eq=False)
class _Segments(Lazy[Segment]):
    """Frame numbers cut into segments of ``length``; each begins with some frames of the segment
    before, to be compared with.
    """

    numbers: Sequence[int]
    frames: Sequence[tuple[str, Any]]
    length: int

    def __len__(self) -> int:
        return -(-len(self.numbers) // self.length)

    def item(self, number: int) -> Segment:
        """The segment of this number."""
        numbers, start, back = self.numbers, number * self.length, max(LOOK.back)
        before = [
            number
            for number in numbers[max(start - back, 0) : start]
            if numbers[start] - number <= back
        ]
        several = [*before, *numbers[start : start + self.length]]
        return Segment(len(before), tuple((number, self.frames[number][1]) for number in several))


def windows_of(matcher: FrameMatcher, segment: Segment) -> list[Observations]:
    """Windows with all their observations (200 kB each) and with loops, for the pattern, which is
    solved from few frames.
    """
    return list(matcher.of_windows(segment, LOOK.loops, lambda window: window))


def _differences_of(matcher: FrameMatcher, light: SurveyLight, segment: Segment) -> list[Differing]:
    """The differences of windows' frames with the pattern removed: small, for every frame of a long
    dive. Without loops, which are broken where a dive is cut.
    """

    def differing(seen: Observations) -> Differing:
        return seen.frames, differences(seen, light, matcher.geometry.image_size)

    return list(matcher.of_windows(segment, 0, differing))


class _Links:
    """Collects which frames show the same spots. frames: (F,) True for frames that show the same as
    a frame before them, and for all between the two.
    """

    def __init__(self, frames: int) -> None:
        self.frames = np.zeros(frames, np.bool_)

    def add(self, frames: NDArray[np.int64]) -> None:
        """Add the frames of a window, its own first. Frames of loops are not linked."""
        near = frames[frames[0] - frames <= max(LOOK.back)]
        self.frames[near.min() + 1 : near.max() + 1] = True


def is_short(frames: int) -> bool:
    """Whether a dive of ``frames`` is so short that all frames solve its pattern."""
    return frames <= SAMPLE.most_frames


def sampled_frames(frames: int) -> list[int]:
    """Numbers of the frames from which the pattern is solved: all, or segments of a long dive."""
    if is_short(frames):
        return list(range(frames))
    starts = np.linspace(0, frames - SAMPLE.segment, SAMPLE.most_frames // SAMPLE.segment).astype(
        int
    )
    return sorted({int(start) + k for start in starts for k in range(SAMPLE.segment)})
