"""One pair at a time, with the water of the last frames."""

import time
from dataclasses import dataclass

from stereo_seecolor.color.photometry.survey import SlidingFitter
from stereo_seecolor.errors import ColorError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import FrameResult, Image, RangeMap, Water


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A pair that was corrected. result: all that is known of it. seconds: that it took."""

    pair: Pair
    result: FrameResult
    seconds: float


class LiveProcessor:
    """Measures each pair, adds its colors to those of the last ``color.sliding_frames``, and takes out their water."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._fitter = SlidingFitter(pipeline.config.color, pipeline.corrector.fit)

    def process(self, pair: Pair) -> LiveFrame:
        """One pair. Raises InputError if it cannot be read; MatchingError, CalibrationError, ColorError as in a run."""
        began_s = time.perf_counter()
        frame = self._pipeline.read(pair)
        result = self._pipeline.process(frame, self._water)
        return LiveFrame(pair, result, time.perf_counter() - began_s)

    def _water(self, image: Image, range_map: RangeMap) -> Water:
        water = self._fitter.water(self._pipeline.corrector.measure(image, range_map.measured_m))
        if water is None:
            raise ColorError("no pixel with a known range yet: there is nothing to fit a water to")
        return water
