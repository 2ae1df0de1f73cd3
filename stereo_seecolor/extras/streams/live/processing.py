"""Processes one pair at a time, with the water of the last frames."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

from stereo_seecolor.color.photometry.survey import SlidingFitter
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline, Stream, correct, ranges_for_color
from stereo_seecolor.records import FrameResult, RangeMap, StereoFrame

# Keeps the time for a pair within a budget: images are matched at full, half or a quarter of
# their size.


@dataclass(frozen=True)
class BudgetConstants:
    """When the size changes."""

    pairs: int = 5  # the median of this many decides: one slow pair does not
    smallest: int = 4  # at less than a quarter of the size little is left of a reef's relief
    # times that a pair takes longer at twice the size: matching takes 4 to 8, reading and color
    # stay
    growth: float = 3.0
    # pairs before the larger size is tried again; doubled each time that it turns out too slow
    patience: int = 20
    most_patience: int = 2000
    # fraction of the budget in which a fit may take steps: a pair that is matched in time stays
    # within it
    fitting: float = 0.9


CONSTANTS = BudgetConstants()


class Budget:
    """Chooses the size at which images are matched: 1/shrink, with shrink 1, 2 or 4.

    budget_s: seconds from reading a pair to its corrected image; None for no limit: shrink is then
    always 1.
    """

    def __init__(self, budget_s: float | None) -> None:
        self.shrink = 1
        self._budget_s = budget_s
        self._recent: deque[float] = deque(maxlen=CONSTANTS.pairs)
        self._patience, self._at_this_size, self._too_slow_s = CONSTANTS.patience, 0, 0.0

    @property
    def text(self) -> str:
        """A note on the reduced size and its reason; "" at full size."""
        if self.shrink == 1 or self._budget_s is None:
            return ""
        larger = "full size" if self.shrink == 2 else f"1/{self.shrink // 2}"
        return (
            f"matched at 1/{self.shrink} of the size to keep within {1000 * self._budget_s:.0f} "
            f"ms per pair ({1000 * self._too_slow_s:.0f} ms at {larger})"
        )

    def until_s(self, began_s: float, rest_s: float) -> float | None:
        """When the steps of a fit end for a pair that began then, of which ``rest_s`` seconds
        follow the fit; None for no limit.
        """
        return (
            None
            if self._budget_s is None
            else began_s + CONSTANTS.fitting * self._budget_s - rest_s
        )

    def took(self, seconds: float) -> None:
        """Note the time that a pair took; the size may change."""
        self._recent.append(seconds)
        self._at_this_size += 1
        if self._budget_s is None or len(self._recent) < CONSTANTS.pairs:
            return
        usual_s = median(self._recent)
        if usual_s > self._budget_s and self.shrink < CONSTANTS.smallest:
            self._too_slow_s = usual_s
            self._patience = min(2 * self._patience, CONSTANTS.most_patience)
            self._turn_to(2 * self.shrink)
        elif (
            self.shrink > 1
            and self._at_this_size >= self._patience
            and usual_s * CONSTANTS.growth < self._budget_s
        ):
            self._turn_to(self.shrink // 2)

    def _turn_to(self, shrink: int) -> None:
        self.shrink, self._at_this_size = shrink, 0
        self._recent.clear()


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
    """Measures each pair, and removes the water that is fitted to the last frames, 20 or
    ``color.lock``.

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
    """Load and compile all code that a pair needs, so that the first pair is not delayed. Raises
    CalibrationError.
    """
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
