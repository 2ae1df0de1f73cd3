"""All pairs of a dive, in two passes.

The first pass measures: each pair is read, rectified and matched, and its colors are counted over range. From the counts follows
the water: one for the dive, or one a frame. The second pass takes the water out of each frame and writes it. Whatever an earlier
run finished with the same inputs and settings is kept, in either pass.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

from stereo_seecolor.color.photometry.lights import learn_light
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.frame_stages import FrameStages, Source, water_key
from stereo_seecolor.frame_work import Correction, FrameWork, Result, Work, rows_alone
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.progress import RunOptions
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import FrameTable
from stereo_seecolor.run_folder.kept_fit import KeptFit
from stereo_seecolor.run_folder.progress_file import ProgressFile

LIGHT_FRAMES = 60
"""So many frames, spread over the dive, teach the rig's lights; more would teach little more."""


class Dive:
    """All pairs of a dive through both passes; a bad pair is named in its row, and the rest go on.

    table: what became of each pair so far. notes: what concerns the dive as a whole.
    """

    def __init__(self, source: Source, folder: RunFolder, options: RunOptions) -> None:
        self.table = FrameTable()
        self.notes: tuple[str, ...] = ()
        self._config, self._corrector = source.config, source.corrector
        self._folder, self._options = folder, options
        self._progress = ProgressFile(folder.root)
        self._stages = FrameStages(source, folder, options.verify)

    def measure(self, pairs: Sequence[Pair]) -> None:
        """The range maps alone; corrected frames of an earlier run stay current where they were made from the same range maps."""
        self._begin_ranges()
        self.each("ranges", pairs, self._stages.range_row)

    def count(self, pairs: Sequence[Pair]) -> None:
        """The first pass alone: range maps and tables, for a water that is fitted to all shards of a dive."""
        self._begin_ranges()
        for _ in self._pass("ranges", pairs, self._stages.counted):
            pass

    def waters(self, pairs: Sequence[Pair]) -> dict[str, Water]:
        """Each frame's water, by name: an earlier run's where it was fitted to the same, or fitted in a first pass."""
        self._begin_color(pairs)
        kept = KeptFit.load(self._folder.root)
        if kept and not self._options.verify and kept.key == self._stages.fit_key(pairs):
            waters = kept.waters(self._folder.root, [pair.name for pair in pairs])
            if waters is not None:
                self.notes += kept.notes
                return waters
        waters, notes = self._fit(pairs)
        self.notes += notes
        key = self._stages.fit_key(pairs)
        if key:
            KeptFit.of(key, notes, waters).save(self._folder.root)
        return waters

    def _fit(self, pairs: Sequence[Pair]) -> tuple[dict[str, Water], tuple[str, ...]]:
        """The first pass: range maps, and from all colors over range each frame's water, by name; and what the fit has to say."""
        fitter = self._corrector.survey_fitter()
        for row, (ranged, table) in self._pass("ranges", pairs, self._stages.counted):
            fitter.add(row.name, table, self._stages.reader(ranged))
        return fitter.waters(), fitter.notes()

    def correct(self, pairs: Sequence[Pair], waters: Mapping[str, Water]) -> None:
        """The second pass: each frame that has a water without it, and its cloud."""
        self._begin_color(pairs)
        self._folder.set_waters({name: water_key(water) for name, water in waters.items()})
        if waters:
            self.each("colors", [pair for pair in pairs if pair.name in waters], Correction.of(self._stages, waters))

    def each(self, stage: str, pairs: Sequence[Pair], work: Callable[[Pair, Clock], FrameRow]) -> None:
        """A pass of which nothing but the rows is wanted."""
        for _ in self._pass(stage, pairs, rows_alone(work)):
            pass

    def _begin_ranges(self) -> None:
        settings, earlier = self._stages.range_settings, self._folder.dive.settings
        self._folder.begin({**(earlier if earlier.get("range") == settings else {}), "range": settings})

    def _begin_color(self, pairs: Sequence[Pair]) -> None:
        if self._config.color.lights == "learn" and self._stages.light is None:
            self._learn_light(pairs)
        self._folder.begin({"range": self._stages.range_settings, "corrected": self._stages.color_settings})

    def _learn_light(self, pairs: Sequence[Pair]) -> None:
        """Learn the rig's own lights from frames spread over the dive; they are divided out of every frame from then on."""
        names = {row.name for row, _ in self._pass("ranges", pairs, rows_alone(self._stages.range_row))}
        good = [pair for pair in pairs if pair.name in names]
        spread = good[:: -(-len(good) // LIGHT_FRAMES) or 1]
        frames = (self._stages.reader(self._stages.ranged(pair, Clock()))() for pair in spread)
        self._stages.light = learn_light(frames, self._config.color.input_encoding)

    def _pass(self, stage: str, pairs: Sequence[Pair], work: Work[Result]) -> Iterator[tuple[FrameRow, Result]]:
        """``work`` on all pairs, in their order; what is wrong with one pair becomes its row, and ends no pass."""
        self._options.listener.begin(stage, len(pairs))
        self._progress.begin(stage, len(pairs))
        for outcome in self._options.compute.each(FrameWork(work, self._folder), pairs):
            self._folder.note(outcome.row.name, outcome.written, outcome.aside)
            self.table.add(outcome.row)
            self._progress.advance(outcome.row)
            self._options.listener.advance(outcome.row)
            if outcome.failure and self._options.strict:
                raise outcome.failure
            if outcome.result is not None:
                yield outcome.row, outcome.result
