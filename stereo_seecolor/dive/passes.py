"""All pairs of a dive, in two passes.

The first pass reads, rectifies and matches each pair, and counts its colors over range. The water is fitted to the counts: one for
the dive, or one a frame. The light (lamps, lens, exposure) is solved from spots that several frames show. The second pass removes
both from each frame and writes it. Results of an earlier run with the same inputs and settings are kept.
"""

from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

from calibration import RectifiedPair
from stereo_seecolor.color.photometry.light_model import Light
from stereo_seecolor.color.photometry.light_solver import Use
from stereo_seecolor.color.photometry.survey import CountedFrames
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.dive.channel_order import channel_order_notes
from stereo_seecolor.dive.frame_facts import recorded_capture
from stereo_seecolor.dive.frame_stages import FrameStages, water_keys
from stereo_seecolor.dive.frame_work import CorrectFrame, FrameWork, GroupCount, Outcome, Result, Work, rows_alone
from stereo_seecolor.dive.pairs import Groups, Named, chosen
from stereo_seecolor.dive.range_scale import range_scale_notes
from stereo_seecolor.dive.repeated_images import RepeatedImages
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.dive.source import PageMaker, Source
from stereo_seecolor.files.keys import ContentKey
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Capture, FrameRow, Water
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import FrameTable
from stereo_seecolor.run_folder.kept_fit import KeptFit
from stereo_seecolor.run_folder.kept_light import KeptLight
from stereo_seecolor.run_folder.kept_plan import KeptPlan
from stereo_seecolor.run_folder.layout import Stage
from stereo_seecolor.run_folder.progress_file import USUAL, Expected, ProgressFile
from stereo_seecolor.run_folder.water_file import waters_content

NO_OVERLAP = "light: no two frames were found to show the same spots, so that lamps, lens and exposure stay in the images"
LONG_DIVE = 10_000
"""Pairs of a dive beyond which their moment tables are added up in groups, by the workers, before the fit."""


class Dive:
    """Takes all pairs of a dive through the passes. The error of a bad pair goes into its row, and the others go on.

    table: the outcome of each pair so far. notes: remarks on the dive as a whole, for the summary.
    """

    def __init__(self, source: Source, folder: RunFolder, options: RunOptions, last: Stage = "corrected") -> None:
        """last: the last stage that the passes do, so that progress expects no later one."""
        self.table = FrameTable()
        self.notes: tuple[str, ...] = ()
        self._light_found: dict[str, Any] | None = None  # for water.json
        self._ranged = False  # True once a pass for the light has measured ranges: the pass of the fit is then called "waters"
        self._light_known = not options.shard.whole  # all shards must have the same light, so that none is solved from one
        self._linked: Collection[str] = ()  # names of frames that show what the frame before them shows
        self._config, self._corrector, self._geometry = source.config, source.corrector, source.geometry
        self._makes_ranges = source.makes_ranges
        self._folder, self._options, self._last = folder, options, last
        self._progress = ProgressFile(folder.root)
        self._ranges: ContentKey | None = None  # of the ranges of all pairs, as the first pass finds them
        self._repeated = RepeatedImages()
        self._stages = FrameStages(source, folder, options.verify)

    @property
    def light(self) -> dict[str, Any] | None:
        """The estimated light of the dive, for water.json; None where none of it is used."""
        light = self._stages.light
        return {**(self._light_found or {}), **light.content()} if light else None

    def measure(self, pairs: Sequence[Pair]) -> None:
        """Make range maps alone. Corrected frames of an earlier run stay current if the settings of range maps are the same."""
        self._begin_ranges()
        self._expect(pairs, "ranges")
        self.each("ranges", pairs, self._stages.range_row)

    def count(self, pairs: Sequence[Pair], take: Callable[[str, MomentTable], None] = lambda *_: None) -> None:
        """Make the first pass alone: range maps and moment tables, for a water fitted to all shards of a dive or to several dives.

        take: called with each frame's name and its moment table.
        """
        self._begin_ranges()
        self._expect(pairs, "ranges")
        for row, table in self._pass("ranges", pairs, self._stages.counted):
            take(row.name, table)

    def waters(self, pairs: Sequence[Pair]) -> Mapping[str, Water]:
        """Each frame's water, by name: an earlier run's if it was fitted to the same inputs, else fitted in a first pass."""
        self._begin_color(pairs)
        kept = KeptFit.load(self._folder.root)
        if kept and not self._options.verify and kept.key == self._fit_key(pairs):
            waters = kept.waters(self._folder.root, [pair.name for pair in pairs])
            if waters is not None:
                self.notes += kept.notes
                return waters
        waters, notes = self._fit(pairs)
        if self._config.color.method == "robust":  # the paper's water has no white point, so that its veil takes part in the cast
            notes += channel_order_notes(waters)
            notes += range_scale_notes(waters, given=not self._makes_ranges)
        self._linked = ()
        self.notes += notes
        key = self._fit_key(pairs)
        if key:
            KeptFit.of(key, notes, waters_content(waters, self.light)).save(self._folder.root)
        return waters

    def _fit(self, pairs: Sequence[Pair]) -> tuple[Mapping[str, Water], tuple[str, ...]]:
        """Make the first pass, and fit the water to the colors over range of all frames.

        Returns each frame's water, by name, and the notes of the fit.
        """
        fitter = self._corrector.survey_fitter(self._stages.light, self._linked)
        stage = "waters" if self._ranged else "ranges"
        if not self._ranged:
            self._ranges = ContentKey()
            self._expect(pairs, "ranges", "colors")
        pairs = self._not_failed(pairs)
        if fitter.joins and len(pairs) > LONG_DIVE:
            for counted in self._sums(stage, pairs):
                fitter.join(counted)
        else:
            for row, table in self._pass(stage, pairs, self._stages.counted):
                fitter.add(row.name, table)
        return fitter.waters(), fitter.notes()

    def _sums(self, stage: str, pairs: Sequence[Pair]) -> Iterator[CountedFrames]:
        """Moment tables of groups of neighboring frames, added up by the workers: a long dive has too many for one process."""
        self._begin_pass(stage, len(pairs))
        count = GroupCount(FrameWork(self._stages.counted, self._folder), self._config.color, known=self._ranged)
        for outcomes, counted in self._options.compute.each(count, Groups(pairs)):
            for outcome in outcomes:
                self._note(stage, outcome)
            yield counted

    def correct(self, pairs: Sequence[Pair], waters: Mapping[str, Water]) -> None:
        """Make the second pass: correct each frame that has a water, and write it with its cloud."""
        self._begin_color(pairs)
        self._folder.dive.set_waters(water_keys(waters))
        if waters:
            self._expect(pairs, "colors")
            self.each("colors", chosen(pairs, lambda pair: pair.name in waters), CorrectFrame.of(self._stages, waters))

    def each(self, stage: str, pairs: Sequence[Pair], work: Callable[[Pair, Clock], FrameRow]) -> None:
        """Make a pass of ``work``, of which only the rows are kept."""
        for _ in self._pass(stage, pairs, rows_alone(work)):
            pass

    def show(self, page: PageMaker | None) -> None:
        """Set what makes the page's files of frames, as they are corrected; None: they are not made."""
        self._stages.page = page

    def end(self) -> None:
        """Delete the pixels that were kept for later passes."""
        self._stages.end()

    def _begin_ranges(self) -> None:
        settings, earlier = self._stages.range_settings, self._folder.dive.record.settings
        self._folder.dive.begin({**(earlier if earlier.get("range") == settings else {}), "range": settings})

    def _begin_color(self, pairs: Sequence[Pair]) -> None:
        if not self._light_known:
            self._find_light(pairs)
            self._light_known = True
        self._folder.dive.begin({"range": self._stages.range_settings, "corrected": self._stages.color_settings})

    def leave_light(self) -> None:
        """Solve no light: for a dive whose shards are corrected each without the others."""
        self._light_known = True

    def _find_light(self, pairs: Sequence[Pair]) -> None:
        """Set the light of the dive: an earlier run's if it was solved from the same inputs, else solved now."""
        color, geometry = self._config.color, self._geometry
        allowed = Use(color.lights == "auto", color.lights == "auto", color.camera_exposure == "auto", color.lights == "auto")
        if geometry is None or len(pairs) < 2 or not any(allowed):
            return
        kept = KeptLight.load(self._folder.root)
        if kept is None or self._options.verify or kept.key != self._fit_key(pairs):
            kept = self._solve_light(pairs, geometry, allowed)
        self._stages.light = Light.from_content(kept.light) if kept.light else None
        self._light_found = {name: value for name, value in (kept.light or {}).items() if name not in ("log_gains", "log_shading")}
        self._linked = kept.linked
        self.notes += (kept.note,) if kept.note else ()

    def _solve_light(self, pairs: Sequence[Pair], geometry: RectifiedPair, allowed: Use) -> KeptLight:
        """Measure all pairs in a first pass, solve the light of the dive, and keep it in OUT. allowed: terms of the light."""
        from stereo_seecolor.dive.light_search import LightSearch, is_short  # loads the search for features

        self._begin_ranges()
        self._ranges, self._ranged = ContentKey(), True
        in_memory = is_short(len(pairs)) and self._options.compute.parts == 1
        self._expect(pairs, "ranges", *(() if in_memory else ("light",)), "waters", "colors")
        captures: list[Capture] = []
        search = LightSearch(
            frames=Named(pairs),
            read=self._stages.read_pair,
            captures=captures,
            geometry=geometry,
            encoding=self._config.color.input_encoding,
            compute=self._options.compute,
            examined=self._examined,
        )
        with closing(self._measured(pairs, captures)) as measured:
            if in_memory:  # a short dive's frames are examined while their pixels are in memory
                search = replace(search, windows=search.windows_of(measured))
            else:
                deque(measured, maxlen=0)
        frames = Named(self._not_failed(pairs))
        if not in_memory:
            self._begin_pass("light", len(frames))
        found = replace(search, frames=frames).solve(allowed)
        content = found.light.content() if found.light and found.light.light else None
        note = found.light.note if found.light else NO_OVERLAP
        kept = KeptLight(self._fit_key(pairs) or "", note, content, found.linked)
        if kept.key:
            kept.save(self._folder.root)
        return kept

    def _fit_key(self, pairs: Sequence[Pair]) -> str | None:
        """Hash of the inputs of the fits of light and water; None where a pair has no range.

        The ranges are those of the first pass, or, before it, those that OUT holds.
        """
        if self._ranges is None:
            return self._stages.fit_key(self._stages.ranges_key(pairs))
        return None if self.table.failed else self._stages.fit_key(self._ranges.value)

    def _measured(self, pairs: Sequence[Pair], captures: list[Capture]) -> Generator[Pair, None, None]:
        """Make the first pass for the light; yields each pair when its range is known.

        captures: receives what the camera recorded of each frame.
        """
        different: dict[Capture, Capture] = {}  # a dive has few, and many frames
        for row, pair in self._pass("ranges", pairs, self._stages.prepared):
            capture = recorded_capture(row.facts)
            captures.append(different.setdefault(capture, capture))
            yield pair

    def _not_failed(self, pairs: Sequence[Pair]) -> Sequence[Pair]:
        """The pairs that have not failed in an earlier pass."""
        return chosen(pairs, lambda pair: pair.name not in self.table.failed) if self.table.failed else pairs

    def _pass(self, stage: str, pairs: Sequence[Pair], work: Work[Result]) -> Iterator[tuple[FrameRow, Result]]:
        """Do ``work`` on all pairs; yields row and result of those that did not fail, in order."""
        self._begin_pass(stage, len(pairs))
        for outcome in self._options.compute.each(FrameWork(work, self._folder), pairs):
            self._note(stage, outcome)
            if outcome.result is not None:
                yield outcome.row, outcome.result

    def _expect(self, pairs: Sequence[Pair], *passes: str) -> None:
        """Tell the progress file which passes over the pairs are to come, and how long they take."""
        plan = KeptPlan.load(self._folder.root, len(pairs), self._config)
        known = Expected(plan.pass_seconds, planned=True) if plan else USUAL
        self._progress.expect(known.of(*(one for one in passes if one != "colors" or self._last == "corrected")))

    def _begin_pass(self, stage: str, pairs: int) -> None:
        self._options.listener.begin(stage, pairs)
        self._progress.begin(stage, pairs)

    def _examined(self, name: str) -> None:
        """Count one more frame as examined for the light."""
        known = self.table.row(name) or FrameRow(name)
        self._advance(replace(known, kept=False, warnings=(), seconds={}))

    def _advance(self, row: FrameRow) -> None:
        self._progress.advance(row)
        self._options.listener.advance(row)

    def _note(self, stage: str, outcome: Outcome[Any]) -> None:
        """Note the outcome of a pair. Raises its error where the run is to stop at the first bad pair."""
        row = outcome.row
        self._folder.frames.note(row.name, outcome.written, outcome.aside)
        if self.table.row(row.name) is None and (again := self._repeated.warning(row)):
            row = replace(row, warnings=(*row.warnings, again))
        self.table.add(row)
        if stage == "ranges" and self._ranges:
            self._ranges.add((row.name, self._stages.range_key(row.hashes)))
        self._advance(row)
        if outcome.failure and self._options.strict:
            raise outcome.failure
