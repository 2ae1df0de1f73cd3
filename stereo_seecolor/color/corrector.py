"""The color stage: images and range maps in, corrected images out. numpy at its face; numba and torch load when first used."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.light_model import Light, lit_by
from stereo_seecolor.color.photometry.survey import Fitter, FrameFitter, ReadPixels, SlidingFitter, SurveyFitter
from stereo_seecolor.color.render.apply import correct, correct_linear
from stereo_seecolor.color.render.exposure import choose
from stereo_seecolor.color.render.tone import Tone
from stereo_seecolor.color.table.black_rim import without_rim
from stereo_seecolor.color.table.evidence import doubts
from stereo_seecolor.color.table.measure import check_pair, measure
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Correction, Image, Map, Water


@dataclass(frozen=True)
class Sampling:
    """Which rows of a large frame are counted: neighboring rows are alike."""

    pixels: int = 400_000
    """Least pixels counted in a frame: one of twice as many is counted on every second row, one of three times on every third."""
    least_known: int = 65_000
    """Where these rows have fewer pixels of known range, all rows are counted: quantiles of 20 ranges need some 3,000 each."""


SAMPLING = Sampling()


class Corrector:
    """Measures, fits and takes out water. Holds nothing but its settings: every method may be called from many threads."""

    def __init__(self, config: ColorConfig | None = None) -> None:
        self.config = config or ColorConfig()

    def measure(self, image: Image, range_m: Map) -> MomentTable:
        """The moment table of an image: its pixels with a known range, counted by channel, range and value.

        A black rim around the picture is left out. Of 800,000 pixels or more every second row is counted (see ``Sampling``).
        image: (H, W, 3) RGB uint8 or uint16. range_m: (H, W) float32 meters along the ray, unknown where not finite or not above 0.
        Raises ColorError where the two do not belong together.
        """
        check_pair(image, range_m)
        range_m = without_rim(image, range_m, self.config.input_encoding)
        every = max(range_m.size // SAMPLING.pixels, 1)
        table = measure(image, range_m, self.config.device, every)
        if every > 1 and table.pixels.sum() < SAMPLING.least_known:
            return measure(image, range_m, self.config.device)
        return table

    def fit(self, table: MomentTable, start: Water | None = None) -> Water:
        """The water of a frame's table, or of the sum of many frames'. Its warnings say where the table cannot carry a water.

        start: a water found before, to begin from, and to stay with where the paper's losses are not constrained by the table.
        Raises ColorError for a table of no pixel, without a start.
        """
        if not table.pixels.any():
            return self._without_pixels(start)
        return replace(self._fit(table, start), typical_range_m=table.median_range_m)

    def _fit(self, table: MomentTable, start: Water | None) -> Water:
        from stereo_seecolor.color.fitting import robust, table_solver

        if self.config.method == "robust":
            water = robust.fit(table, self.config, start)
            doubt = () if water.warnings else doubts(table)
            return replace(water, warnings=doubt) if doubt else water
        doubt = doubts(table)
        if doubt and start is not None:
            return replace(start, warnings=(f"{doubt[0]}; another frame's is used",))
        paper = self.config.paper if self.config.method == "paper" else self.config.paper_adam
        return replace(table_solver.fit(table, paper.penalty, self.config.input_encoding, start), warnings=doubt)

    def fit_frame(self, image: Image, range_m: Map, start: Water | None = None) -> Water:
        """The water of one frame, by the config's method."""
        return self._fit_measured(self.measure(image, range_m), lambda: (image, range_m), start)

    def _fit_measured(self, table: MomentTable, pixels: ReadPixels, start: Water | None) -> Water:
        if self.config.method != "paper-adam" or not table.pixels.any():
            return self.fit(table, start)
        return replace(self.fit_dense(*pixels(), start), warnings=doubts(table), typical_range_m=table.median_range_m)

    def fit_dense(self, image: Image, range_m: Map, start: Water | None = None) -> Water:
        """The paper's own solver: its networks trained on every pixel by Adam. DeviceError where CUDA is asked for and absent."""
        from stereo_seecolor.color.fitting import dense

        check_pair(image, range_m)
        known = (np.isfinite(range_m) & (range_m > 0)).reshape(-1)
        if not known.any():
            return self._without_pixels(start)
        return dense.fit(image.reshape(-1, 3)[known], range_m.reshape(-1)[known], self.config, start)

    def survey_fitter(self, light: Light | None = None, linked: Collection[str] = ()) -> Fitter:
        """Frames in, one at a time and in their order; a water for each of them out, by ``color.lock``.

        light: what was divided out of the frames; how light falls off with range then follows from what it saw.
        linked: frames that show the same as the one before them, and so share its water.
        """

        def fit(table: MomentTable, start: Water | None) -> Water:
            return lit_by(self.fit(table, start), light)

        def fit_measured(table: MomentTable, pixels: ReadPixels, start: Water | None) -> Water:
            return lit_by(self._fit_measured(table, pixels, start), light)

        if self.config.lock == "frame":
            return FrameFitter(fit_measured)
        from stereo_seecolor.color.photometry.stretches import AutoFitter  # loads numba

        if self.config.lock == "auto":
            return AutoFitter(self.config, fit, linked)
        return (SurveyFitter if self.config.lock == "survey" else SlidingFitter)(self.config, fit)

    def apply(
        self,
        image: Image,
        range_m: Map,
        water: Water,
        table: MomentTable | None = None,
        exposure: float | None = None,
        highlights: float = 1.0,
    ) -> Correction:
        """The image in its true colors, at its own size and bit depth.

        table: what ``measure`` gave for this image, if at hand. exposure, highlights: the brightness, as another frame's correction
        has it; None is the water's, or else this frame's own, by ``config.highlights`` and ``config.clipped_fraction``.
        Raises ColorError where image and range map do not belong together, or the water is of another encoding.
        """
        self._check(water)
        if exposure is None:
            exposure, highlights = water.exposure, water.highlights
        if exposure is None:
            exposure, highlights = choose(table or self.measure(image, range_m), water, self.config)
        return correct(image, range_m, water, Tone(exposure, highlights), self.config)

    def apply_linear(self, image: Image, range_m: Map, water: Water, exposure: float = 1.0) -> NDArray[np.float32]:
        """(H, W, 3) float32 corrected linear light, unclipped and not encoded; 0 where the range is unknown."""
        self._check(water)
        return correct_linear(image, range_m, water, exposure, self.config)

    def _check(self, water: Water) -> None:
        if water.input_encoding != self.config.input_encoding:
            raise ColorError(
                f"water: was fitted to images read as {water.input_encoding}, and these are read as {self.config.input_encoding}; "
                f"set color.input_encoding={water.input_encoding}"
            )

    def _without_pixels(self, start: Water | None) -> Water:
        if start is None:
            raise ColorError("no pixel with a known range: there is nothing to fit a water to")
        return start
