"""One water for many frames: tables add, so the water of a survey is the fit to the sum of its frames' tables."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace

from stereo_seecolor.color.tables import MomentTable
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.data import Image, Map, Water

FitTable = Callable[[MomentTable, Water | None], Water]
FitDense = Callable[[Image, Map, Water | None], Water]


class SurveyFitter:
    """Frames in, in their order; a water for each out, by ``color.lock``. Built by ``Corrector.survey_fitter``."""

    def __init__(self, config: ColorConfig, fit: FitTable, fit_dense: FitDense) -> None:
        self._config, self._fit, self._fit_dense = config, fit, fit_dense
        self._names: list[str] = []
        self._total: MomentTable | None = None
        self._window: deque[MomentTable] = deque()
        self._waters: dict[str, Water] = {}
        self._last: Water | None = None

    def add(self, name: str, table: MomentTable, image: Image, range_m: Map) -> None:
        """One more frame: its table, and the image itself for the dense solver."""
        self._names.append(name)
        if self._config.lock == "frame":
            dense = self._config.objective == "paper" and self._config.solver == "dense"
            self._last = self._fit_dense(image, range_m, self._last) if dense else self._fit(table, self._last)
            self._waters[name] = self._last
            return
        self._total = table if self._total is None else self._total + table
        if self._config.lock == "sliding":
            self._window.append(table)
            if len(self._window) > self._config.sliding_frames:
                self._total = self._total - self._window.popleft()
            self._last = self._fit(self._total, self._last)
            self._waters[name] = self._last

    def waters(self) -> dict[str, Water]:
        """Name of a frame -> its water, for all frames added."""
        if self._config.lock != "survey" or self._total is None:
            return self._waters
        water = self._fit(self._total, None)
        return {name: replace(water) for name in self._names}
