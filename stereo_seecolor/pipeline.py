"""START HERE: one pair through all stages. ``commands/run.py`` does so for a dive.

A pair is read, rectified onto one image plane, and matched to a range map (``measure``). A water is
fitted to its colors over range, and removed (``correct``). ``process`` does these steps in memory,
for two arrays.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calibration import CalibrationError, Rectification, StereoRig
from calibration.formats import load_rig
from calibration.original_view import OriginalView
from calibration.port import flat_port
from calibration.rig import for_channels
from calibration.verification.conventions import resolve_convention
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render.carried_colors import inside_right_image
from stereo_seecolor.color.render.open_water import without_open_water
from stereo_seecolor.color.response.measure import measure_response
from stereo_seecolor.color.response.response import Response, standard_config
from stereo_seecolor.color.response.unshifted import unshifted_warning
from stereo_seecolor.color.sharing.survey import SlidingFitter
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.white_point import DOUBT
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.device import make_corrector, make_matcher, make_rectifier, memory_of
from stereo_seecolor.errors import ColorError, MatchingError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.images import as_image, read_image
from stereo_seecolor.inputs.opened_paths import open_around
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.matching.pair_check import PairCheck
from stereo_seecolor.matching.particles import without_particles
from stereo_seecolor.matching.reduced import DetailMatcher
from stereo_seecolor.records import (
    Correction,
    FrameResult,
    Image,
    Mask,
    RangeMap,
    StereoFrame,
    Water,
    is_monochrome,
)
from stereo_seecolor.version import __version__

Match = Callable[[StereoFrame], RangeMap]
"""The range map of a rectified pair."""

AT_TYPICAL_RANGE = (
    "no range is known: its colors are corrected for {:.2f} m, the typical range of the dive"
)

OTHER_EXPOSURE = 2.0
"""From one frame of a dive to the others brightness at equal ranges changed by 1.3 at most, on a
real dive in strobe light and a synthetic one in sunlight.
"""
OF_OTHER_EXPOSURE = (
    "{:.2g} times as bright, at equal ranges, as the frames before: if the exposure of the camera "
    "changed, the colors are wrong until the last color.lock frames have the new one: fix the "
    "exposure, or set a smaller color.lock"
)

PAIR_BYTES_A_PIXEL = 68
"""Bytes of memory for each pixel while a pair is measured, corrected and written. For one pair
alone 57 to 67 were measured at 5, 12 and 21 megapixels, most while its cloud is written; each
further pair at the same time adds 32 to 65 in runs of at most three, of up to 47 megapixels.
"""


class Pipeline:
    """Runs a pair through all stages. Create one for a rig; all methods are thread-safe.

    Args:
        rig: The calibration. If its file can be read in several ways, ``process`` chooses by the
            first pair that shows which one fits, and sets the attributes anew: call it once before
            other threads do.
        config: Settings; the defaults if not given.

    Attributes:
        geometry: Of the rectified images.
        matched_by: Of the images that ranges are matched in.
        makes_ranges: Whether range maps are written to OUT.
        seen: (H, W) bool, where rectified images show something; None = everywhere.
        original: The geometry of the unrectified left camera; None if no product uses it.
        settings: Hash of everything except the two images that a range map depends on.

    Raises:
        CalibrationError: If the cameras share no field of view.
        DeviceError: If a device or a library that the settings ask for is missing.
    """

    makes_ranges = True

    def __init__(self, rig: StereoRig | str | Path, config: RunConfig | None = None) -> None:
        self.config = config or RunConfig()
        self._use(rig if isinstance(rig, StereoRig) else load_rig(rig))

    def _use(self, rig: StereoRig) -> None:
        """Make everything that depends on the rig."""
        if (window := self.config.input.flat_port) and rig.port is None:
            rig = replace(rig, medium="air", port=flat_port(window), alternatives=())
        self.rig = rig
        self.rectification = Rectification.from_rig(rig)
        self.geometry = self.matched_by = self.rectification.pair
        seen = self.rectification.seen_left()
        self.seen: Mask | None = None if seen.all() else self.rectification.upright(seen)
        self.original = (
            OriginalView.from_rig(rig) if self.config.output.geometry == "original" else None
        )
        memory = memory_of(self.config.device)
        self._rectifier = make_rectifier(self.rectification, memory)
        self.matcher = DetailMatcher(
            self.rectification.matching_pair, self.config.matching, seen, make_matcher(memory)
        )
        self.check_pair = PairCheck(
            lambda raw: self.match(self.rectify(raw)),
            self.rectification,
            self.config.input.refine,
        )
        self.corrector = make_corrector(standard_config(self.config.color), memory)
        self.response = Response.of(self.config.color)
        self._measures_response = self.config.color.input_encoding == "auto"
        self.reader = FrameReader(self.config.input)
        self.settings = self._settings()
        self._brightest = 0  # value of the frames that came without a dive

    def __reduce__(self) -> tuple[type["Pipeline"], tuple[StereoRig, RunConfig]]:
        # all else is made from these, and some of it is large
        return Pipeline, (self.rig, self.config)

    def _settings(self) -> str:
        """Hash of everything that a range map depends on besides its two images."""
        maps = (self.rectification.maps_left, self.rectification.maps_right)
        tables = (table.tobytes() for pair in maps if pair for table in pair)
        config = self.config
        engine = config.matching.engine
        sections = (
            self.reader.settings,
            config.matching.model_dump(),
            *([engine.read_bytes()] if isinstance(engine, Path) else []),
            config.output.preset,
        )
        return content_key(__version__, self.geometry, *tables, *sections)

    @property
    def pixels(self) -> int:
        """Number of pixels of a rectified image."""
        width, height = self.rectification.matching_pair.image_size
        return width * height

    def inputs(self, pair: Pair) -> dict[str, Path]:
        """The files of a pair. Opens the videos or the bag that contain them.

        Args:
            pair: The pair.

        Returns:
            Side -> file.
        """
        open_around(pair.left)
        open_around(pair.right)
        return {"left": pair.left, "right": pair.right}

    def read(self, pair: Pair) -> StereoFrame:
        """Read both images of a pair, unrectified.

        Args:
            pair: The pair.

        Returns:
            The raw pair.

        Raises:
            InputError: If an image cannot be read.
        """
        return self.reader.read(pair)

    def raw(self, pair: Pair, clock: Clock) -> Image:
        """Read the left image of a pair, unrectified, as sRGB values without a pedestal.

        Args:
            pair: The pair.
            clock: Takes the time.

        Returns:
            (H, W, 3) RGB.

        Raises:
            InputError: If the image cannot be read.
        """
        with clock("read"):
            raw = read_image(pair.left, self.config.input)
            return self.response.of_frame(raw).standard(raw)

    def image(self, pair: Pair, clock: Clock) -> Image:
        """Read and rectify the left image of a pair; upright, as sRGB values without a pedestal.

        Args:
            pair: The pair.
            clock: Takes the time.

        Returns:
            (H, W, 3) RGB.

        Raises:
            InputError: If the image cannot be read.
            CalibrationError: If it is of another size than the calibration's.
        """
        with clock("read"):
            raw = read_image(pair.left, self.config.input)
            response = self.response.of_frame(raw)
        with clock("rectify"):
            image = self.rectification.upright(self.rectification.apply_left(raw))
        return response.standard(image)

    def measure(self, pair: Pair, clock: Clock) -> tuple[Image, RangeMap]:
        """Read, rectify and match a pair.

        Args:
            pair: The pair.
            clock: Takes the time of each stage.

        Returns:
            The rectified left image, upright, as sRGB values without a pedestal, and its range map.

        Raises:
            InputError: If an image cannot be read.
            CalibrationError: If one is of another size than the calibration's.
            MatchingError: If the two do not show the same scene.
        """
        with clock("read"):
            raw = self.read(pair)
            response = self.response.of_frame(raw.left)
        with clock("rectify"):
            rectified = self.rectify(raw)
        del raw  # read again in the rare case that the check asks for it
        with clock("match"):
            range_map = self._ranges(rectified, self.matcher.match, partial(self.read, pair))
        upright = self.rectification.upright
        with clock("rectify"):
            return response.standard(upright(rectified.left)), range_map.each(upright)

    def _ranges(
        self, rectified: StereoFrame, match: Match, raw: Callable[[], StereoFrame]
    ) -> RangeMap:
        """The range map of a rectified pair that shows one scene, without particles. raw: returns
        the unrectified pair.
        """
        found = self.check_pair(rectified.name, match(rectified), raw)
        return without_particles(rectified, found, self.config.matching.fill)

    def rectify(self, frame: StereoFrame) -> StereoFrame:
        """Rectify both images onto one plane, with the baseline along +x.

        Args:
            frame: The raw pair.

        Returns:
            The rectified pair.

        Raises:
            CalibrationError: For images of another size than the calibration's.
        """
        left = self._rectifier.apply_left(frame.left)
        return replace(frame, left=left, right=self._rectifier.apply_right(frame.right))

    def _response_of(self, frame: StereoFrame) -> Response:
        """The response of a frame that came without a dive: the first one is measured."""
        if self._measures_response:
            found = measure_response([frame.left])
            self.response = replace(found.response, space=self.response.space)
            self._measures_response = False
            color = self.config.color.model_copy(update=found.settings)
            self.corrector.config = standard_config(color)
        return self.response.of_frame(frame.left)

    def _unshifted(self, frame: StereoFrame) -> list[str]:
        """Warnings of a frame that came without a dive: those of files were scaled."""
        if self.config.input.significant_bits is None or frame.left.dtype != np.uint16:
            return []
        self._brightest = max(self._brightest, int(frame.left.max()), int(frame.right.max()))
        warning = unshifted_warning(frame.left, self._brightest)
        return [warning] if warning else []

    def match(self, frame: StereoFrame) -> RangeMap:
        """Compute the range map of a rectified pair.

        Args:
            frame: The rectified pair.

        Returns:
            The range map.
        """
        return self.matcher.match(frame)

    def process(
        self,
        frame: StereoFrame,
        water: Water | Callable[[Image, RangeMap], Water] | None = None,
        match: Match | None = None,
    ) -> FrameResult:
        """Run an unrectified pair through all stages, in memory.

        Args:
            frame: The raw pair.
            water: The water to remove, or a function that returns it for the rectified left image
                and its range map; None: it is fitted to this frame.
            match: Computes the range map instead of the pipeline's own matcher.

        Returns:
            The results of all stages.

        Raises:
            CalibrationError: For images of another size than the calibration's.
            MatchingError: If the two do not show the same scene.
            ColorError: If no water can be fitted.
        """
        clock = Clock()
        left, right = (
            as_image(image, f"{frame.name or 'frame'}: the {side} image")
            for side, image in (("left", frame.left), ("right", frame.right))
        )
        if np.array_equal(left, right):
            raise MatchingError(f"{frame.name or 'frame'}: left and right are the same image")
        frame = replace(frame, left=left, right=right)
        if self.rig.alternatives:
            with suppress(CalibrationError):  # the next pair may show more
                rig = for_channels(self.rig, is_monochrome(left))
                self._use(resolve_convention(rig, [(left, right)]))
        with clock("rectify"):
            rectified = self.rectify(frame)
        with clock("match"):
            doubts = self._unshifted(frame)
            try:
                range_map = self._ranges(rectified, match or self.matcher.match, lambda: frame)
            except MatchingError as error:
                raise MatchingError("; ".join((str(error), *doubts))) from error
            range_map = replace(range_map, warnings=(*range_map.warnings, *doubts))
        upright = self.rectification.upright
        with clock("rectify"):
            left, right = upright(rectified.left), upright(rectified.right)
            left = self._response_of(frame).standard(left)
            rectified, range_map = replace(frame, left=left, right=right), range_map.each(upright)
        with clock("color"):
            if callable(water):
                water = water(rectified.left, range_map)
            water = water or self.corrector.fit_frame(rectified.left, range_map.measured_m)
            ranges = ranges_for_color(self.corrector, rectified.left, range_map, water, self.seen)
            outside = self.rectification.pair.outside_right(ranges.range_m)
            correction = correct(
                self.corrector, self.config, rectified.left, ranges, water, outside
            )
        return FrameResult(rectified, range_map, correction, clock.seconds)


class Stream:
    """Corrects the pairs of a stream with one set of water parameters and one exposure, fitted to
    the last 20 frames (or ``color.lock``), so that the output does not flicker.

    Args:
        pipeline: Must not be used by another stream.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self.pipeline, self.fitted_s = pipeline, 0.0
        self._fitter = SlidingFitter(pipeline.config.color, self._fit)
        self._until_s: float | None = None

    def process(
        self, frame: StereoFrame, shrink: int = 1, until_s: float | None = None
    ) -> FrameResult:
        """Run the next unrectified pair through all stages.

        Args:
            frame: The pair.
            shrink: Match at 1/shrink of the size: 1, 2 or 4.
            until_s: Time of ``time.perf_counter`` at which the steps of the fit end; None for no
                limit.

        Returns:
            As ``Pipeline.process``.

        Raises:
            ColorError: If no pixel of the stream had a known range yet.
            MatchingError, CalibrationError, InputError: As in ``Pipeline.process``.
        """
        self._until_s = until_s

        def match(rectified: StereoFrame) -> RangeMap:
            own = self.pipeline
            return own.match(rectified) if shrink == 1 else own.matcher.at(shrink).match(rectified)

        def water(image: Image, range_map: RangeMap) -> Water:
            # of a pair matched at reduced size every second or fourth row and column counts
            every = slice(None, None, shrink)
            table = self.pipeline.corrector.measure(
                image[every, every].copy(), range_map.measured_m[every, every].copy()
            )
            brighter = self._fitter.brighter(table)
            found = self._fitter.water(table)
            if found is None:
                raise ColorError(
                    "no pixel with a known range yet: there is nothing to fit the water to"
                )
            if 1 / OTHER_EXPOSURE < brighter < OTHER_EXPOSURE:
                return found
            return replace(found, warnings=(*found.warnings, OF_OTHER_EXPOSURE.format(brighter)))

        return self.pipeline.process(frame, water, match)

    def _fit(self, table: MomentTable, start: Water | None) -> Water:
        config = self.pipeline.corrector.config.of_dive()
        water = Corrector(config).fit(table, start, self._until_s)
        self.fitted_s = time.perf_counter()
        return water


def correct(
    corrector: Corrector,
    config: RunConfig,
    image: Image,
    range_map: RangeMap,
    water: Water,
    outside: Mask | None = None,
    camera: Image | None = None,
) -> Correction:
    """Remove the water from a frame; with linear light in the result for ``output.image_format:
    tiff32``. Raises ColorError.

    A monochrome camera's frame stays monochrome. outside: (H, W) True where the right image does
    not reach; None where that is unknown. camera: as in ``Corrector.apply``.
    """
    table = corrector.measure(image, range_map.measured_m) if water.exposure is None else None
    correction = corrector.apply(image, range_map.range_m, water, table, camera=camera)
    if config.output.image_format == "tiff32":
        linear = corrector.apply_linear(
            image, range_map.range_m, water, exposure=correction.exposure
        )
        correction = replace(correction, linear=linear)
    correction = _carried_as_measured(corrector, correction, range_map, outside)
    if range_map.filled.any() and not np.isfinite(range_map.measured_m).any():
        correction = replace(
            correction,
            warnings=(*correction.warnings, AT_TYPICAL_RANGE.format(water.typical_range_m)),
        )
    if not is_monochrome(image):
        return correction
    warnings = tuple(one for one in correction.warnings if not one.startswith(DOUBT))
    return replace(correction.one_band(), warnings=warnings)


def _carried_as_measured(
    corrector: Corrector, correction: Correction, range_map: RangeMap, outside: Mask | None
) -> Correction:
    """The correction with colors limited to those of measured pixels where the range was carried
    over, though both cameras see what is there.
    """
    filled = range_map.filled
    measured = ~(filled | correction.unknown | correction.unrecoverable)
    carried = filled if outside is None else inside_right_image(filled, outside)
    image = corrector.within_measured(correction.image, carried, measured)
    linear = (
        None
        if correction.linear is None
        else corrector.within_measured(correction.linear, carried, measured)
    )
    return replace(correction, image=image, linear=linear)


def ranges_for_color(
    corrector: Corrector, image: Image, range_map: RangeMap, water: Water, seen: Mask | None = None
) -> RangeMap:
    """The range map that a frame is corrected with: unknown ranges, and those of pixels that show
    the open water beside what was measured, are carried over from neighbors and marked as filled.

    A frame without any known range gets the water's typical range everywhere. seen: where the image
    shows something, None = everywhere.
    """
    if corrector.config.unknown_pixels != "interpolate":
        return range_map
    shown_m = without_open_water(image, range_map.range_m, water, seen)
    range_m = corrector.carry_ranges(image, shown_m, seen)
    if water.typical_range_m is not None and not np.isfinite(range_m).any():
        range_m = np.where(
            True if seen is None else seen, np.float32(water.typical_range_m), range_m
        )
    return range_map.with_ranges(
        range_m, range_map.filled | (np.isfinite(range_m) & ~np.isfinite(shown_m))
    )
