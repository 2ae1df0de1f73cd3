"""START HERE: one pair through all stages. ``dive.py`` takes all pairs of a dive through the same steps, in two passes.

A pair is read, rectified onto one image plane, and matched to a range map (``measure``); a water is fitted to its colors over
range; the water is taken out (``correct``). ``process`` is these steps in memory, for whoever holds two arrays.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calibration import Rectification, RectifiedPair, StereoRig
from calibration.original_view import OriginalView
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render.carried_colors import less_red
from stereo_seecolor.color.render.carried_ranges import carry_ranges
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.containers import open_around
from stereo_seecolor.inputs.frames import FrameReader
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.matching.pair_check import PairCheck
from stereo_seecolor.matching.reduced import DetailMatcher
from stereo_seecolor.records import Correction, FrameResult, Image, Map, Mask, RangeMap, StereoFrame, Water, is_monochrome
from stereo_seecolor.version import __version__

Match = Callable[[StereoFrame], RangeMap]
"""The range map of a rectified pair."""

PAIR_BYTES_A_PIXEL = 60
"""Of memory, while a pair is measured or corrected, most while it is matched: measured at 21 megapixels (benchmarks/growth.py)."""


class Pipeline:
    """One pair through all stages. Built once for a rig; every method may be called from many threads."""

    makes_ranges = True

    def __init__(self, rig: StereoRig, config: RunConfig | None = None) -> None:
        self.rig = rig
        self.config = config or RunConfig()
        self.rectification = Rectification.from_rig(rig)
        self.geometry: RectifiedPair | None = self.rectification.pair
        seen = self.rectification.seen_left()
        self.seen: Mask | None = None if seen.all() else self.rectification.upright(seen)
        self.original = OriginalView.from_rig(rig) if self.config.output.geometry == "original" else None
        self.matcher = DetailMatcher(self.rectification.matching_pair, self.config.matching, seen)
        self.check_pair = PairCheck(lambda raw: self.match(self.rectify(raw)))
        self.corrector = Corrector(self.config.color)
        self.reader = FrameReader(self.config.input)
        self.settings = self._settings()

    def __reduce__(self) -> tuple[type["Pipeline"], tuple[StereoRig, RunConfig]]:
        return Pipeline, (self.rig, self.config)  # all else is made from these, and some of it is large

    def _settings(self) -> str:
        """Hash of all that a range map depends on besides its two images."""
        maps = (self.rectification.maps_left, self.rectification.maps_right)
        tables = (table.tobytes() for pair in maps if pair for table in pair)
        config = self.config
        sections = (self.reader.settings, config.matching.model_dump(), config.output.range_std, config.output.preset)
        return content_key(__version__, self.geometry, *tables, *sections)

    @property
    def pixels(self) -> int:
        """Of a rectified image."""
        width, height = self.rectification.matching_pair.image_size
        return width * height

    def inputs(self, pair: Pair) -> dict[str, Path]:
        """The files of a pair, by side; a video or a bag that they lie in is opened."""
        open_around(pair.left)
        open_around(pair.right)
        return {"left": pair.left, "right": pair.right}

    def read(self, pair: Pair) -> StereoFrame:
        """Both images as the cameras gave them. Raises InputError."""
        return self.reader.read(pair)

    def raw(self, pair: Pair, clock: Clock) -> Image:
        """The left image as the camera gave it. Raises InputError."""
        with clock("read"):
            return read_image(pair.left, self.config.input)

    def image(self, pair: Pair, clock: Clock) -> Image:
        """The rectified left image, upright. Raises InputError, CalibrationError."""
        image = self.raw(pair, clock)
        with clock("rectify"):
            return self.rectification.upright(self.rectification.apply_left(image))

    def measure(self, pair: Pair, clock: Clock) -> tuple[Image, RangeMap]:
        """The rectified left image of a pair, upright, and its range map. Raises InputError, MatchingError, CalibrationError."""
        rectified, range_map = self._ranged(partial(self.read, pair), clock, self.match)
        return rectified.left, range_map

    def _ranged(self, raw: Callable[[], StereoFrame], clock: Clock, match: Match) -> tuple[StereoFrame, RangeMap]:
        """Rectify and match a pair as the cameras gave it; both are turned upright, as the left camera saw the scene."""
        with clock("read"):
            frame = raw()
        with clock("rectify"):
            rectified = self.rectify(frame)
        del frame
        with clock("match"):
            range_map = match(rectified)
            self.check_pair(rectified.name, range_map, raw)
        with clock("rectify"):
            upright = self.rectification.upright
            left, right = upright(rectified.left), upright(rectified.right)
            return replace(rectified, left=left, right=right), range_map.each(upright)

    def rectify(self, frame: StereoFrame) -> StereoFrame:
        """Both images onto one image plane, turned so that the baseline is +x. Raises CalibrationError for another size."""
        left, right = self.rectification.apply_left(frame.left), self.rectification.apply_right(frame.right)
        return replace(frame, left=left, right=right)

    def match(self, frame: StereoFrame) -> RangeMap:
        """The range map of a rectified pair."""
        return self.matcher.match(frame)

    def process(
        self,
        frame: StereoFrame,
        water: Water | Callable[[Image, RangeMap], Water] | None = None,
        match: Match | None = None,
    ) -> FrameResult:
        """A pair as the cameras gave it through all stages.

        water: what is taken out, or what finds it for the rectified left image; None fits it to this one frame. match: instead of
        the pipeline's own.
        """
        clock = Clock()
        rectified, range_map = self._ranged(lambda: frame, clock, match or self.match)
        with clock("color"):
            if callable(water):
                water = water(rectified.left, range_map)
            water = water or self.corrector.fit_frame(rectified.left, range_map.measured_m)
            ranges = ranges_for_color(rectified.left, range_map, self.config, self.seen)
            correction = correct(self.corrector, self.config, rectified.left, ranges, water)
        return FrameResult(rectified, range_map, correction, clock.seconds)


class RangedImages:
    """Images that come with range maps, pixel for pixel, instead of a second camera; otherwise like a Pipeline."""

    makes_ranges = False
    geometry: RectifiedPair | None = None
    seen: Mask | None = None
    original: OriginalView | None = None  # its images are the camera's own already

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self.corrector = Corrector(config.color)
        self.reader = FrameReader(config.input)
        self.settings = content_key(__version__, self.reader.settings)

    def inputs(self, pair: Pair) -> dict[str, Path]:
        """The files of a pair, by what they are."""
        return {"image": pair.left, "range": pair.right}

    def raw(self, pair: Pair, clock: Clock) -> Image:
        """The image as it is. Raises InputError."""
        with clock("read"):
            return read_image(pair.left, self.config.input)

    image = raw

    def measure(self, pair: Pair, clock: Clock) -> tuple[Image, RangeMap]:
        """The image and its range map. Raises InputError if they differ in size or cannot be read."""
        image = self.image(pair, clock)
        with clock("read"):
            range_m = read_range_map(pair.right)
        if range_m.shape != image.shape[:2]:
            raise InputError(
                f"{pair.right}: the range map is {range_m.shape[1]}x{range_m.shape[0]} px but its image {pair.left.name} is "
                f"{image.shape[1]}x{image.shape[0]}: give the range map of this very image"
            )
        return image, ranges_alone(range_m, np.isfinite(range_m))


def correct(corrector: Corrector, config: RunConfig, image: Image, range_map: RangeMap, water: Water) -> Correction:
    """A frame in its true colors; with linear light beside it where ``output.image_format`` asks for that. Raises ColorError.

    A monochrome camera's frame stays monochrome.
    """
    table = corrector.measure(image, range_map.measured_m) if water.exposure is None else None
    correction = corrector.apply(image, range_map.range_m, water, table)
    if config.output.image_format == "tiff32":
        linear = corrector.apply_linear(image, range_map.range_m, water, exposure=correction.exposure)
        correction = correction.with_linear(linear)
    correction = _carried_as_measured(correction, range_map)
    return correction.one_band() if is_monochrome(image) else correction


def _carried_as_measured(correction: Correction, range_map: RangeMap) -> Correction:
    """No redder where the range was carried over than where it was measured."""
    measured = ~(range_map.filled | correction.unknown | correction.unrecoverable)
    image = less_red(correction.image, range_map.filled, measured)
    linear = None if correction.linear is None else less_red(correction.linear, range_map.filled, measured)
    return replace(correction, image=image, linear=linear)


def ranges_for_color(image: Image, range_map: RangeMap, config: RunConfig, seen: Mask | None = None) -> RangeMap:
    """The range map that a frame is corrected with: where nothing was measured, carried over from neighbors and marked as filled.

    seen: where the image shows something, None = everywhere.
    """
    if config.color.unknown_pixels != "interpolate":
        return range_map
    range_m = carry_ranges(image, range_map.range_m, seen)
    return range_map.with_ranges(range_m, range_map.filled | (np.isfinite(range_m) & ~np.isfinite(range_map.range_m)))


def ranges_alone(range_m: Map, measured: Mask, warnings: tuple[str, ...] = ()) -> RangeMap:
    """A range map of which nothing but the ranges is known, and which of them were measured: the rest is NaN."""
    nothing = np.broadcast_to(np.float32(np.nan), range_m.shape)  # no map of a whole picture
    known = np.isfinite(range_m)
    return RangeMap(nothing, nothing, range_m, nothing, (known & measured).astype(np.float32), known & ~measured, warnings)
