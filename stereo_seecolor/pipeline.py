"""START HERE: one pair through all stages (Pipeline), and all pairs of a dive (Survey).

A dive takes two passes. The first measures: each pair is read, rectified and matched, and its colors are counted over range.
From the counts follows the water: one for the dive, or one a frame. The second pass takes the water out of each frame and
writes it. Whatever an earlier run finished with the same inputs and settings is kept, in either pass.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calibration import CalibrationError, Rectification, RectifiedPair, StereoRig
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.photometry.lights import LightField, even_light, learn_light
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.threads import Clock, in_order
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import DeviceError, OutputError, SeeColorError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.matching.pair_check import PairCheck
from stereo_seecolor.progress import RunOptions
from stereo_seecolor.records import FrameResult, Image, RangeMap, StereoFrame, Water
from stereo_seecolor.run_folder.folder import Finished, RunFolder, content_key
from stereo_seecolor.run_folder.frames_table import FrameRow, FrameTable
from stereo_seecolor.run_folder.products import correction_outputs, write_correction
from stereo_seecolor.run_folder.water_file import water_content

LIGHT_FRAMES = 60
"""So many frames, spread over the dive, teach the rig's lights; more would teach little more."""


class Pipeline:
    """One pair through all stages, in memory. Built once for a rig; every method may be called from many threads."""

    def __init__(self, rig: StereoRig, config: RunConfig | None = None) -> None:
        self.config = config or RunConfig()
        self.rectification = Rectification.from_rig(rig)
        self.matcher = Matcher(self.rectification.pair, self.config.matching, self.rectification.seen_left())
        self.check_pair = PairCheck(lambda raw: self.match(self.rectify(raw)))
        self.corrector = Corrector(self.config.color)

    def rectify(self, frame: StereoFrame) -> StereoFrame:
        """Both images onto one image plane. Raises CalibrationError if their size is not the calibration's."""
        left, right = self.rectification.apply_left(frame.left), self.rectification.apply_right(frame.right)
        return StereoFrame(frame.name, left, right, frame.timestamp_s)

    def match(self, frame: StereoFrame) -> RangeMap:
        """The range map of a rectified pair."""
        return self.matcher.match(frame)

    def process(self, frame: StereoFrame, water: Water | None = None) -> FrameResult:
        """A pair as the cameras gave it through all stages; ``water`` is fitted to this one frame if not given."""
        clock = Clock()
        with clock("rectify"):
            rectified = self.rectify(frame)
        with clock("match"):
            range_map = self.match(rectified)
            self.check_pair(frame, range_map)
        with clock("color"):
            water = water or self.corrector.fit_frame(rectified.left, range_map.measured_m)
            correction = self.corrector.apply(rectified.left, range_map.range_m, water)
        return FrameResult(rectified, range_map, correction, clock.seconds)


@dataclass(frozen=True, eq=False)
class Ranged:
    """An image and its range map. key: hash of all they depend on; hashes: their files'; kept: an earlier run had matched them."""

    image: Image
    range_map: RangeMap
    key: str
    hashes: dict[str, str]
    kept: bool = False


@dataclass(frozen=True, eq=False)
class Done:
    """What one pass made of one pair: its row, and what the next step needs of it; or the error that ended it."""

    row: FrameRow
    error: SeeColorError | CalibrationError | None = None
    ranged: Ranged | None = None
    table: MomentTable | None = None


class Source(Protocol):
    """Where a survey's images and ranges come from; see commands/sources.py."""

    geometry: RectifiedPair | None

    def ranged(self, pair: Pair, clock: Clock) -> Ranged:
        """The pair's image and range map, from any thread."""


class Survey:
    """All pairs of a dive through both passes; a bad pair is named in its row, and the rest go on.

    rows: what became of each pair so far.
    """

    def __init__(self, source: Source, config: RunConfig, folder: RunFolder, options: RunOptions) -> None:
        self._source, self._config, self._folder, self._options = source, config, folder, options
        self._corrector = Corrector(config.color)
        self._light: LightField | None = None
        self.rows = FrameTable()

    def match(self, pairs: Sequence[Pair]) -> None:
        """The range maps alone."""
        self.each("ranges", pairs, self._range)

    def learn_light(self, pairs: Sequence[Pair]) -> None:
        """Learn the rig's own lights from frames spread over the dive; they are divided out of every frame from then on."""
        self.match(pairs)
        failed = {row.name for row in self.rows if row.status != "ok"}
        good = [pair for pair in pairs if pair.name not in failed]
        spread = good[:: -(-len(good) // LIGHT_FRAMES) or 1]
        ranged = (self._source.ranged(pair, Clock()) for pair in spread)
        self._light = learn_light(((r.image, r.range_map.measured_m) for r in ranged), self._config.color.input_encoding)

    def fit(self, pairs: Sequence[Pair]) -> dict[str, Water]:
        """First pass: range maps, and from all colors over range each frame's water, by name."""
        fitter = self._corrector.survey_fitter()
        for done in self._pass("ranges", pairs, self._count):
            if done.ranged and done.table:
                fitter.add(done.row.name, done.table, done.ranged.image, done.ranged.range_map.measured_m)
        return fitter.waters()

    def correct(self, pairs: Sequence[Pair], waters: Mapping[str, Water]) -> None:
        """Second pass: each frame that has a water without it, and its cloud."""
        fitted = [pair for pair in pairs if pair.name in waters]
        self.each("colors", fitted, lambda pair, clock: self._correct(pair, waters[pair.name], clock))

    def each(self, stage: str, pairs: Sequence[Pair], work: Callable[[Pair, Clock], Done]) -> None:
        """A pass of which nothing but the rows is wanted."""
        for _ in self._pass(stage, pairs, work):
            pass

    def _pass(self, stage: str, pairs: Sequence[Pair], work: Callable[[Pair, Clock], Done]) -> Iterator[Done]:
        """``work`` on all pairs by many threads; what is wrong with one pair becomes its row, and ends no pass."""

        def one(pair: Pair) -> Done:
            clock = Clock()
            try:
                done = work(pair, clock)
            except (OutputError, DeviceError):
                raise  # a full disk or an absent device is every pair's trouble
            except (SeeColorError, CalibrationError) as error:
                done = Done(FrameRow(pair.name, status="failed", error=str(error)), error.with_traceback(None))
            row = replace(done.row, left=str(pair.left), right=str(pair.right), timestamp_s=pair.timestamp_s, seconds=clock.seconds)
            return replace(done, row=row)

        self._options.listener.begin(stage, len(pairs))
        for done in in_order(one, pairs, self._options.workers):
            self.rows.add(done.row)
            self._options.listener.advance(done.row)
            if done.error and self._options.strict:
                raise done.error
            yield done

    def _range(self, pair: Pair, clock: Clock) -> Done:
        ranged = self._source.ranged(pair, clock)
        measured_m = ranged.range_map.measured_m
        if self._light:
            with clock("light"):
                even = even_light(ranged.image, ranged.range_map.range_m, self._light, self._config.color.input_encoding)
                ranged = replace(ranged, image=even, key=content_key(ranged.key, self._light.pattern.tobytes()))
        facts = {"coverage": float(np.isfinite(measured_m).mean())}
        if facts["coverage"] > 0:
            sample_m = measured_m[::4, ::4]  # the median of all is ten times as slow, and no truer
            facts["median_range_m"] = float(np.median(sample_m[np.isfinite(sample_m)])) if np.isfinite(sample_m).any() else math.nan
        row = FrameRow(pair.name, kept=ranged.kept, warnings=ranged.range_map.warnings, hashes=ranged.hashes, facts=facts)
        return Done(row, ranged=ranged)

    def _count(self, pair: Pair, clock: Clock) -> Done:
        done = self._range(pair, clock)
        assert done.ranged
        with clock("color"):
            table = self._corrector.measure(done.ranged.image, done.ranged.range_map.measured_m)
        return replace(done, table=table)

    def _correct(self, pair: Pair, water: Water, clock: Clock) -> Done:
        done = self._range(pair, clock)
        assert done.ranged
        image, range_map = done.ranged.image, done.ranged.range_map
        key = content_key(done.ranged.key, self._config.color.model_dump(), self._config.output.model_dump(), water_content(water))
        outputs = correction_outputs(self._folder, pair.name, self._source.geometry, self._config.output)
        finished = self._folder.finished("corrected", pair.name, key, outputs)
        kept = finished is not None
        if finished is None:
            with clock("color"):
                correction = self._corrector.apply(image, range_map.range_m, water)
                if self._config.output.image_format == "tiff32":
                    linear = self._corrector.apply_linear(image, range_map.range_m, water, exposure=correction.exposure)
                    correction = replace(correction, linear=linear)
            with clock("write"):
                write_correction(self._folder, pair.name, correction, range_map, self._source.geometry, self._config.output)
                facts = {
                    "clipped_fraction": correction.clipped_fraction,
                    "unrecoverable_fraction": float(correction.unrecoverable.mean()),
                }
                finished = Finished(key, {"exposure": correction.exposure, **facts}, correction.warnings)
                self._folder.finish("corrected", pair.name, finished)
        return Done(done.row.then(FrameRow(pair.name, kept=kept, warnings=finished.warnings, facts=dict(finished.facts))))
