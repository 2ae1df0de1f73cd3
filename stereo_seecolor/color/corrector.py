"""The color stage: images and range maps in, corrected images out, as numpy arrays."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.response_doubt import with_doubt_of_response
from stereo_seecolor.color.photometry.light_model import Light, lit_by, settings_under
from stereo_seecolor.color.render.apply import correct, correct_linear
from stereo_seecolor.color.render.carried import carry_ranges
from stereo_seecolor.color.render.carried_colors import within_measured
from stereo_seecolor.color.render.display import Tone
from stereo_seecolor.color.render.tone import choose
from stereo_seecolor.color.sharing.survey import Fitter, FrameFitter, SlidingFitter, SurveyFitter
from stereo_seecolor.color.table.black_rim import without_rim
from stereo_seecolor.color.table.counting import check_pair, measure
from stereo_seecolor.color.table.doubts import doubts
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.errors import ColorError
from stereo_seecolor.plugins import checked, load
from stereo_seecolor.records import Correction, Image, Map, Mask, Water


@dataclass(frozen=True)
class RowSampling:
    """Which rows of a large image are counted: neighboring rows are similar."""

    pixels: int = 400_000
    """Pixels counted at least: of an image with n times as many, every nth row is counted."""
    least_known: int = 65_000
    """Least pixels with a range in these rows, else all count: 20 groups of range of 3,000."""


SAMPLING = RowSampling()


class Corrector:
    """Counts colors over range, fits the water and removes it.

    It only holds settings; every method may be called from many threads.

    Args:
        config: Settings; the defaults if not given.
    """

    def __init__(self, config: ColorConfig | None = None) -> None:
        self.config = config or ColorConfig()

    def measure(self, image: Image, range_m: Map) -> MomentTable:
        """Count the pixels of an image with a known range by channel, range and value.

        A black rim around the image is left out. Of images with 800,000 pixels or more every
        second row is counted (see ``RowSampling``).

        Args:
            image: (H, W, 3) RGB, uint8 or uint16.
            range_m: (H, W) float32, meters along the ray; unknown where not finite or not above 0.

        Returns:
            The moment table. Tables of frames can be added.

        Raises:
            ColorError: If image and range map differ in size or have a wrong shape or type.
        """
        check_pair(image, range_m)
        range_m = without_rim(image, range_m, self.config.encoding)
        every = max(range_m.size // SAMPLING.pixels, 1)
        table = self._count(image, range_m, every)
        few = every > 1 and table.pixels.sum() < SAMPLING.least_known
        return self._count(image, range_m) if few else table

    def _count(self, image: Image, range_m: Map, every: int = 1) -> MomentTable:
        return measure(image, range_m, every)

    def fit(
        self, table: MomentTable, start: Water | None = None, until_s: float | None = None
    ) -> Water:
        """Fit the water to a moment table, of one frame or the sum of many.

        Args:
            table: The moment table.
            start: The water of a frame of the same scene, as the initial value; the method
            ``paper`` returns it if the table does not determine its parameters.
            until_s: Time of ``time.perf_counter`` after which the method ``paper`` makes no further
            step.

        Returns:
            The water; its warnings state what the table does not determine.

        Raises:
            ColorError: For a table without pixels, unless there is a start.
            PluginError: If no installed package has this method.
        """
        if not table.pixels.any():
            if start is None:
                raise ColorError(
                    "no pixel with a known range: there is nothing to fit the water to"
                )
            return start
        fitted = with_doubt_of_response(self._fit(table, start, until_s), table, self.config)
        return replace(fitted, typical_range_m=table.median_range_m)

    def _fit(self, table: MomentTable, start: Water | None, until_s: float | None) -> Water:
        shared = self.config.lock == "survey"
        if self.config.method == "robust":
            from stereo_seecolor.color.fitting import robust

            water = robust.fit(table, self.config, start)
            doubt = (
                doubts(table, shared) if water.warnings in ((), (robust.RED_HIGHLIGHTS,)) else ()
            )
            return replace(water, warnings=doubt) if doubt else water
        if self.config.method != "paper":
            name = self.config.method
            fit = load("color_methods", name, needs=("__call__",))
            found: Water = checked(fit(table, self.config, start), "color_methods", name, Water)
            return found
        from stereo_seecolor.color.fitting import paper

        doubt = doubts(table, shared)
        if doubt and start is not None:
            return replace(start, warnings=(f"{doubt[0]}; another frame's is used",))
        return replace(
            paper.fit(table, self.config.paper, self.config.encoding, start, until_s),
            warnings=doubt,
        )

    def fit_frame(self, image: Image, range_m: Map, start: Water | None = None) -> Water:
        """Fit the water of one frame by the method of the settings.

        Args:
            image: As in ``measure``.
            range_m: As in ``measure``.
            start: As in ``fit``.

        Returns:
            The water.

        Raises:
            ColorError: As in ``measure`` and ``fit``.
        """
        return self.fit(self.measure(image, range_m), start)

    def survey_fitter(self, light: Light | None = None, linked: Collection[str] = ()) -> Fitter:
        """The fitter for the frames of a dive, by ``color.lock``.

        Args:
            light: The light by which the frames were divided; it also contains the fall-off of
            light with range.
            linked: Names of frames that show the same spots as the frame before them, and therefore
            share its water.

        Returns:
            The fitter, to which the moment tables of the frames are added in order.
        """

        config = settings_under(self.config.of_dive(), light)

        def fit(table: MomentTable, start: Water | None) -> Water:
            return lit_by(Corrector(config).fit(table, start), light)

        if config.lock == "frame":
            return FrameFitter(fit, linked)
        from stereo_seecolor.color.sharing.segments import AutoFitter  # loads numba

        if config.lock == "auto":
            return AutoFitter(config, fit, linked)
        return (SurveyFitter if config.lock == "survey" else SlidingFitter)(config, fit)

    def apply(
        self,
        image: Image,
        range_m: Map,
        water: Water,
        table: MomentTable | None = None,
        exposure: float | None = None,
        highlights: float = 1.0,
        camera: Image | None = None,
    ) -> Correction:
        """Remove the water from an image, at the image's size and bit depth.

        Args:
            image: As in ``measure``.
            range_m: As in ``measure``.
            water: The water to remove.
            table: The moment table of the image, if it exists already.
            exposure: Gain, as in another correction; None = that of the water, or else of this
            frame, by ``config.highlights`` and ``config.median_luminance``.
            highlights: Roll-off that belongs to ``exposure``.
            camera: The image before its light was divided out, which shows what the camera clipped;
            None = ``image``.

        Returns:
            The corrected frame.

        Raises:
            ColorError: If image and range map differ in size, or the water was fitted to another
                encoding.
        """
        self._check(water)
        if exposure is None:
            exposure, highlights = water.exposure, water.highlights
        if exposure is None:
            exposure, highlights = choose(table or self.measure(image, range_m), water, self.config)
        return self._correct(image, range_m, water, Tone(exposure, highlights), camera)

    def _correct(
        self, image: Image, range_m: Map, water: Water, tone: Tone, camera: Image | None
    ) -> Correction:
        return correct(image, range_m, water, tone, self.config, camera)

    def carry_ranges(self, image: Image, range_m: Map, seen: Mask | None = None) -> Map:
        """Fill the unknown pixels of a range map (see ``render.carried``).

        Args:
            image: As in ``measure``.
            range_m: As in ``measure``.
            seen: (H, W) bool, True where the image contains image data; None = everywhere.

        Returns:
            (H, W) float32, meters along the ray.
        """
        return carry_ranges(image, range_m, seen)

    def within_measured(self, image: NDArray[Any], carried: Mask, measured: Mask) -> NDArray[Any]:
        """Limit the colors of filled-in ranges to measured ones (see ``render.carried``).

        Args:
            image: (H, W, 3), corrected.
            carried: (H, W) bool, where the range was filled in.
            measured: (H, W) bool, where it was measured.

        Returns:
            The image, limited.
        """
        return within_measured(image, carried, measured)

    def apply_linear(
        self, image: Image, range_m: Map, water: Water, exposure: float = 1.0
    ) -> NDArray[np.float32]:
        """Remove the water from an image, as linear light.

        Args:
            image: As in ``measure``.
            range_m: As in ``measure``.
            water: The water to remove.
            exposure: Gain.

        Returns:
            (H, W, 3) float32, unclipped and not encoded; 0 where the range is unknown.
        """
        self._check(water)
        return correct_linear(image, range_m, water, exposure, self.config)

    def _check(self, water: Water) -> None:
        as_is = water.input_encoding == "as-is"
        if as_is != (self.config.encoding == "as-is"):
            read = ("decoded to linear light", "read as-is")
            raise ColorError(
                f"water: was fitted to images {read[as_is]}, and these are {read[not as_is]}; set "
                f"color.input_encoding={'as-is' if as_is else 'auto'}"
            )
