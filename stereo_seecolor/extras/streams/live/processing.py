"""Processes one pair at a time, with the water of the last frames."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stereo_seecolor.color.sharing.survey import SlidingFitter
from stereo_seecolor.extras.streams.live.budget import Budget
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline, Stream, correct, ranges_for_color
from stereo_seecolor.records import FrameResult, RangeMap, StereoFrame


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A corrected pair. seconds: that its processing took. reduced: a note where it was matched at
    reduced size, else "".
    """

    pair: Pair
    result: FrameResult
    seconds: float
    reduced: str = ""


class LiveProcessor:
    """Measures pairs, and removes the water of the last frames, 20 or ``color.lock``.

    Method paper trains its networks for ``color.paper.iterations_per_frame`` steps on each pair, or
    as many as its budget leaves.

    pipeline: used by this processor alone. read: reads the unrectified images of a pair. budget:
    the time for a pair.
    """

    def __init__(
        self, pipeline: Pipeline, read: Callable[[Pair], StereoFrame], budget: Budget | None = None
    ) -> None:
        self._stream, self._read = Stream(pipeline), read
        self._budget = budget or Budget(None)
        self._after_fit_s = 0.0  # how long the rest of the last pair took, after its fit

    def process(self, pair: Pair) -> LiveFrame:
        """Process a pair. Raises InputError if it cannot be read; MatchingError, CalibrationError,
        ColorError as in a run.
        """
        began_s, reduced = time.perf_counter(), self._budget.text
        until_s = self._budget.until_s(began_s, self._after_fit_s)
        result = self._stream.process(self._read(pair), self._budget.shrink, until_s)
        ended_s = time.perf_counter()
        seconds, self._after_fit_s = ended_s - began_s, ended_s - self._stream.fitted_s
        self._budget.took(seconds)
        return LiveFrame(pair, result, seconds, reduced)


def warm_up(pipeline: Pipeline) -> None:
    """Load and compile all code that a pair needs. Raises CalibrationError."""
    rng = np.random.default_rng(0)
    width, height = pipeline.rectification.raw_size
    noise = rng.integers(0, 200, (height, width, 3), np.uint8)
    rectified = pipeline.rectify(StereoFrame("", noise, noise))
    unmatched = pipeline.rectification.upright(pipeline.match(rectified).range_m)
    range_m = rng.uniform(1, 3, unmatched.shape).astype(np.float32)
    range_m[::8] = np.nan  # some are carried over
    image = pipeline.rectification.upright(rectified.left)
    water = SlidingFitter(pipeline.config.color, pipeline.corrector.fit).water(
        pipeline.corrector.measure(image, range_m)
    )
    assert water is not None
    ranges = ranges_for_color(
        pipeline.corrector,
        image,
        RangeMap.of_ranges(range_m, np.isfinite(range_m)),
        water,
        pipeline.seen,
    )
    correct(pipeline.corrector, pipeline.config, image, ranges, water)
