"""One water for many frames: the fit to the sum of their tables."""

from array import array
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Protocol

import numpy as np

from stereo_seecolor.color.render.tone import choose
from stereo_seecolor.color.sharing.exposure import Brightness, exposed, shorten_exposure
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.names import ByName, Names
from stereo_seecolor.compute.packed import Packed
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Water

FitTable = Callable[[MomentTable, Water | None], Water]

CLASS_STOPS = 2.0
"""Width of a class of brightness; frames farther from the largest have another exposure."""
BLACK = -10_000
"""The class of frames without any light."""


class Fitter(Protocol):
    """Fits a water to each frame, taken in order. joins: whether ``join`` may be called."""

    joins: bool = False

    def add(self, name: str, table: MomentTable) -> None:
        """Add a frame and its table."""

    def join(self, several: "CountedFrames") -> None:
        """Add several frames at once."""
        raise TypeError("the frames of this fit are added one by one")

    def waters(self) -> Mapping[str, Water]:
        """The water of each frame, by name. Raises ColorError if no range is known."""

    def notes(self) -> tuple[str, ...]:
        """Warnings and notes about the whole dive, after ``waters``."""
        return ()


class _FittedWhenAdded(Fitter):
    """Fits the water of each frame when it is added."""

    def __init__(self) -> None:
        self._waters: dict[str, Water | None] = {}
        self._last: Water | None = None

    def waters(self) -> Mapping[str, Water]:
        """The water of each frame; one without ranges gets that of the frame before it."""
        return fill_missing_waters(self._waters.items())


class FrameFitter(_FittedWhenAdded):
    """``color.lock: frame``: each frame has a separate water; fits of ``linked`` frames, which show
    the same spots as the frame before, start from its water.
    """

    def __init__(self, fit: FitTable, linked: Collection[str] = ()) -> None:
        super().__init__()
        self._fit, self._linked = fit, linked

    def add(self, name: str, table: MomentTable) -> None:
        """One more frame."""
        if table.pixels.any():
            self._last = self._fit(table, self._last if name in self._linked else None)
        self._waters[name] = self._last if table.pixels.any() else None


class SlidingFitter(_FittedWhenAdded):
    """``color.lock: N``: water and exposure of each frame are fitted to the last few frames."""

    def __init__(self, config: ColorConfig, fit: FitTable) -> None:
        super().__init__()
        self._config, self._fit = config, fit
        self._window: deque[bytes] = deque()
        self._total = MomentTable.empty()

    def add(self, name: str, table: MomentTable) -> None:
        """Add a frame to the window; the oldest leaves it."""
        water = self.water(table)
        self._waters[name] = water if table.pixels.any() else None

    def brighter(self, table: MomentTable) -> float:
        """How many times as bright a frame is as those of the window, at equal ranges; 1 where
        none are.
        """
        encoding = self._config.encoding
        return Brightness.of(table, encoding).ratio(Brightness.of(self._total, encoding))

    def water(self, table: MomentTable) -> Water | None:
        """Add a frame and return the water of the window; None as long as there was no range."""
        self._total = self._total + table if self._window else table
        self._window.append(table.packed())
        if len(self._window) > self._config.sliding_frames:
            self._total -= MomentTable.unpacked(self._window.popleft())
        if self._total.pixels.any():
            self._last = _fitted(self._total, self._config, self._fit, self._last)
        return self._last


@dataclass(frozen=True, eq=False)
class CountedFrames:
    """frames: name, class and packed brightness of each. classes: sums of their tables, by class of
    brightness; frames without ranges are in none.
    """

    frames: Sequence[tuple[str, int, bytes]]
    classes: Mapping[int, MomentTable]

    @classmethod
    def of(cls, tables: Iterable[tuple[str, MomentTable]], config: ColorConfig) -> "CountedFrames":
        """Add up the tables of these frames, given by name and table in order."""
        frames, classes = [], dict[int, MomentTable]()
        for name, table in tables:
            brightness = Brightness.of(table, config.encoding)
            kind = class_of(brightness, config)
            frames.append((name, kind, brightness.packed()))
            if table.pixels.any():
                add_to(classes, {kind: table})
        return cls(frames, classes)


def add_to(classes: dict[int, MomentTable], more: Mapping[int, MomentTable]) -> None:
    """Add the tables of each class to the existing ones."""
    for kind, table in more.items():
        classes[kind] = classes[kind] + table if kind in classes else table


class FrameBrightness:
    """Names, ``class_of`` and brightness (400 bytes, kept out of memory) of frames, in order."""

    def __init__(self) -> None:
        self.names, self.classes = Names(), array("i")
        self._packed: Packed[bytes] = Packed()

    def __len__(self) -> int:
        return len(self.names)

    def add(self, frames: Iterable[tuple[str, int, bytes]]) -> None:
        """Add frames: name, class and packed brightness of each."""
        for name, kind, packed in frames:
            self.names.add(name)
            self.classes.append(kind)
            self._packed.append(packed)

    def brightness(self, number: int) -> Brightness:
        """The brightness of frame ``number``."""
        return Brightness.unpacked(self._packed[number])


class SurveyFitter(Fitter):
    """``color.lock: survey``: one water and one exposure for all frames.

    Frames far darker or brighter than most are left out of the fit, and get its water, scaled to
    their exposure. With ``camera_exposure: brightness``, every frame is first scaled to one
    exposure.
    """

    def __init__(self, config: ColorConfig, fit: FitTable) -> None:
        self._config, self._fit = config, fit
        # else each frame is scaled to the exposure of the frames before it
        self.joins = config.camera_exposure != "brightness"
        self._frames = FrameBrightness()
        self._classes: dict[int, MomentTable] = {}

    def add(self, name: str, table: MomentTable) -> None:
        """One more frame."""
        frame = CountedFrames.of([(name, table)], self._config)
        if not self.joins and 0 in self._classes and 0 in frame.classes:
            encoding = self._config.encoding
            usual = Brightness.of(self._classes[0], encoding)
            brighter = Brightness.of(table, encoding).ratio(usual)
            frame = replace(frame, classes={0: shorten_exposure(table, brighter, encoding)})
        self.join(frame)

    def join(self, several: CountedFrames) -> None:
        """Add several frames."""
        self._frames.add(several.frames)
        add_to(self._classes, several.classes)

    def waters(self) -> Mapping[str, Water]:
        """The water of the survey, scaled to the camera exposure of each frame."""
        numbers = range(len(self._frames))
        return fill_missing_waters(
            survey_waters(self._frames, numbers, self._classes, self._config, self._fit)
        )


def survey_waters(
    frames: FrameBrightness,
    numbers: range,
    classes: Mapping[int, MomentTable],
    config: ColorConfig,
    fit: FitTable,
) -> Iterator[tuple[str, Water | None]]:
    """Name and water of each of these frames: one water, scaled to each exposure.

    classes: sums of their tables; if empty, the waters are None.
    """
    if not classes:
        yield from ((frames.names.item(number), None) for number in numbers)
        return
    most, survey = usual_exposure(classes)
    water = _fitted(survey, config, fit, None)
    bright = Brightness.of(survey, config.encoding)
    for number in numbers:
        usual = frames.classes[number] == BLACK or (
            config.camera_exposure != "brightness" and abs(frames.classes[number] - most) <= 1
        )
        if usual:
            yield frames.names.item(number), water
        else:
            brighter = frames.brightness(number).ratio(bright)
            yield frames.names.item(number), _as_exposed(water, brighter, config)


def usual_exposure(classes: Mapping[int, MomentTable]) -> tuple[int, MomentTable]:
    """The class with most pixels, and the sum of its table and those next to it."""
    lit = [kind for kind in classes if kind != BLACK] or [BLACK]
    most = max(lit, key=lambda kind: int(classes[kind].pixels.sum()))
    return most, reduce(add, (table for kind, table in classes.items() if abs(kind - most) <= 1))


def class_of(brightness: Brightness, config: ColorConfig) -> int:
    """The class of a frame by its brightness: 0 with ``camera_exposure: brightness``."""
    if not np.isfinite(brightness.stops):
        return BLACK
    held = config.camera_exposure != "brightness"
    return int(np.floor(brightness.stops / CLASS_STOPS)) if held else 0


def _as_exposed(water: Water, factor: float, config: ColorConfig) -> Water:
    """The water scaled to a frame that is ``factor`` times as bright as the survey."""
    if config.camera_exposure == "brightness":
        return exposed(water, factor)
    warning = (
        f"{factor:.3g} times the survey's brightness: another camera exposure, taken into account"
    )
    return replace(exposed(water, factor), warnings=(*water.warnings, warning))


def _fitted(total: MomentTable, config: ColorConfig, fit: FitTable, start: Water | None) -> Water:
    water = fit(total, start)
    exposure, highlights = choose(total, water, config)
    return replace(water, exposure=exposure, highlights=highlights)


def fill_missing_waters(waters: Iterable[tuple[str, Water | None]]) -> Mapping[str, Water]:
    """The waters by name; a frame without one gets the last one before it, or else the first."""
    found, before, last = ByName[Water](), list[str](), None
    for name, water in waters:
        last = water or last
        if last is None:
            before.append(name)
            continue
        for earlier in before:
            found.put(earlier, last)
        before.clear()
        found.put(name, water or last)
    if before:
        raise ColorError(
            f"none of the {len(before)} frames has a pixel with a known range: nothing can be "
            "fitted (is it all open "
            "water?); check the range maps, or the calibration and which side is left"
        )
    return found
