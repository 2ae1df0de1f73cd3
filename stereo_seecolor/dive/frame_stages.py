"""The stages of one frame of a dive. Each is done once: an earlier run's result is kept, or it is done now and written to OUT."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereo_seecolor.color.photometry.badly_exposed import exposure_warnings
from stereo_seecolor.color.photometry.even_light import even_light
from stereo_seecolor.color.photometry.light_model import Light
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.sources import ROOT, sources_digest
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.dive.frame_facts import capture_facts, color_facts, range_facts
from stereo_seecolor.dive.source import PageMaker, Ranged, Source
from stereo_seecolor.errors import InputError, MatchingError
from stereo_seecolor.files.keys import content_key, content_key_of
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import correct, ranges_for_color
from stereo_seecolor.records import Correction, FrameRow, Image, Map, RangeMap, Water
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.kept_pixels import FramePixels, KeptPixels
from stereo_seecolor.run_folder.kept_table import keep_table, kept_table
from stereo_seecolor.run_folder.layout import table_file
from stereo_seecolor.run_folder.manifest import FrameRecord, StageRecord
from stereo_seecolor.run_folder.products import Files, correction_files, mask_codes, original_files, range_files

FITTING = tuple(ROOT / "stereo_seecolor" / name for name in ("dive/light_search.py", "color/corrector.py"))
"""The modules whose code, with all that they import, finds a dive's light and its waters."""


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A frame that was just corrected.

    before: its rectified image, uncorrected. measured: its range map. ranges: the range map that it was corrected with, in which
    ranges are carried over to pixels without a measured one.
    """

    before: Image
    measured: RangeMap
    ranges: RangeMap
    correction: Correction


class FrameStages:
    """The stages of a frame; every method may be called from many threads.

    light: that of the dive, divided out of each frame; None where none is used.
    page: makes the page's files of a frame when it is corrected; None where the run writes no page.
    """

    def __init__(self, source: Source, folder: RunFolder, verify: bool = False) -> None:
        self.light: Light | None = None
        self._source, self._folder, self._verify = source, folder, verify
        self._kept = KeptPixels(folder.root)
        self.page: PageMaker | None = None

    @property
    def range_settings(self) -> str:
        """Hash of the settings that range maps depend on."""
        return self._source.settings

    @property
    def color_settings(self) -> str:
        """Hash of the settings that corrected frames depend on besides their ranges and their water."""
        config = self._source.config
        return content_key(config.color.model_dump(), config.output.model_dump(), self._light_key)

    @property
    def _light_key(self) -> str:
        return self.light.fingerprint if self.light else ""

    def fit_key(self, ranges: str | None) -> str | None:
        """Hash of the inputs of the fits of light and water, and of the code that fits them; None where ranges are not known.

        ranges: hash of the ranges of the dive's pairs.
        """
        return ranges and content_key(self.color_settings, ranges, [sources_digest(file) for file in FITTING])

    def ranges_key(self, pairs: Sequence[Pair]) -> str | None:
        """Hash of the ranges of these pairs in OUT; None unless OUT has them all."""
        try:
            return content_key_of(self._range_keys(pairs))
        except InputError:
            return None

    def range_key(self, hashes: Mapping[str, str]) -> str:
        """Hash of all that the range of a pair depends on. hashes: SHA-256 of its files, by side."""
        return content_key(hashes, self.range_settings)

    def _range_keys(self, pairs: Sequence[Pair]) -> Iterator[tuple[str, str]]:
        """Name and key of each pair's ranges. Raises InputError for one that is gone, or whose range is not known."""
        for pair in pairs:
            ranged, known = self._known(pair)
            if not known:
                raise InputError(f"{pair.name}: its range is not known")
            yield pair.name, ranged.key

    def _known(self, pair: Pair) -> tuple[Ranged, bool]:
        """OUT's record of a pair with its present files, and whether OUT has its range. Raises InputError for a missing file."""
        inputs = self._folder.frames.inputs(pair.name, self._source.inputs(pair), self._verify)
        key = self.range_key({side: file.sha256 for side, file in inputs.items()})
        known = self._folder.frames.finished("range", pair.name, key) is not None
        record = self._folder.frames.record(pair.name, pair.timestamp_s, inputs, pair.place)
        return Ranged(pair, record, key, kept=known and "range" not in self._folder.frames.written.stages(pair.name)), known

    def ranged(self, pair: Pair, clock: Clock) -> Ranged:
        """The pair's range: an earlier run's, or measured and written now. Raises as ``measure`` of the source."""
        with clock("read"):
            ranged, known = self._known(pair)
        if known:
            return ranged
        inputs = ranged.record.inputs
        hashes = {file.sha256 for file in inputs.values()}
        if len(hashes) < len(inputs) and all(file.stamp.size for file in inputs.values()):
            raise MatchingError(f"{pair.left} and {pair.right} are the same picture: no range can be had from it")
        return self._measured(ranged, clock)

    def range_row(self, pair: Pair, clock: Clock) -> FrameRow:
        """Measure the pair's range unless it is known; returns its row."""
        return self.ranged(pair, clock).row

    def counted(self, pair: Pair, clock: Clock) -> tuple[FrameRow, MomentTable]:
        """The pair's row and moment table."""
        ranged = self.ranged(pair, clock)
        if ranged.pixels:
            self._keep(ranged, *ranged.pixels)
        return ranged.row, self.table(ranged, clock)

    def prepared(self, pair: Pair, clock: Clock) -> tuple[FrameRow, Pair]:
        """The pair's row, and the pair. Its moment table is made, too, while its pixels are in memory, for a later pass."""
        return self.counted(pair, clock)[0], pair

    def _keep(self, ranged: Ranged, image: Image, range_map: RangeMap) -> None:
        """Keep a frame's pixels for later passes."""
        self._kept.keep(ranged.pair.name, ranged.key, FramePixels(image, range_map.range_m, ~range_map.filled))

    def end(self) -> None:
        """Delete the kept pixels of all frames."""
        self._kept.clear()

    def _measured(self, ranged: Ranged, clock: Clock) -> Ranged:
        image, range_map = self._source.measure(ranged.pair, clock)
        facts = range_facts(range_map) | capture_facts(self._source.reader.capture(ranged.pair.left))
        stage = StageRecord(ranged.key, self.range_settings, facts=facts, warnings=range_map.warnings)
        with clock("write"):
            makes, output = self._source.makes_ranges, self._source.config.output
            files = range_files(ranged.pair.name, range_map, output) if makes else {}
            record = self._folder.frames.save(ranged.record.with_stage("range", stage), "range", files)
        return replace(ranged, record=record, pixels=(image, range_map))

    def pixels(self, ranged: Ranged, clock: Clock) -> tuple[Image, RangeMap]:
        """The (rectified) left image and its range map."""
        return ranged.pixels or self._read_again(ranged, clock)

    def _evened(self, name: str, image: Image, range_m: Map, clock: Clock) -> Image:
        """The rectified image without the dive's light."""
        if self.light is None:
            return image
        with clock("light"):
            light = self.light.on(name, (image.shape[1], image.shape[0]))
            return even_light(image, range_m, light, self._source.config.color.input_encoding)

    def _read_again(self, ranged: Ranged, clock: Clock) -> tuple[Image, RangeMap]:
        """The left image and range map of a pair that was measured before; measured again where its files were damaged since."""
        kept, warnings = self._kept.find(ranged.pair.name, ranged.key), ranged.record.stages["range"].warnings
        if kept and kept.range_m is not None and kept.measured is not None:
            return kept.image, RangeMap.of_ranges(kept.range_m, kept.measured, warnings)
        if not self._source.makes_ranges:
            return self._source.measure(ranged.pair, clock)
        try:
            with clock("read"):
                range_m, confidence = (self._folder.frames.read(ranged.record, product) for product in ("range", "confidence"))
        except InputError:
            again = self._measured(ranged, clock)
            assert again.pixels
            return again.pixels
        image = kept.image if kept else self._source.image(ranged.pair, clock)
        range_map = RangeMap.of_ranges(range_m, confidence > 0, warnings)
        self._keep(ranged, image, range_map)
        return image, range_map

    def table(self, ranged: Ranged, clock: Clock) -> MomentTable:
        """The frame's moment table, its colors counted over range: an earlier run's, or counted now and kept."""
        path = self._folder.root / table_file(ranged.pair.name, ranged.record.shelf)
        key = content_key(ranged.key, self._light_key, self._source.config.color.input_encoding)
        with clock("read"):
            packed = kept_table(path, key)
        if packed:
            return MomentTable.unpacked(packed)
        image, range_map = self.pixels(ranged, clock)
        image = self._evened(ranged.pair.name, image, range_map.measured_m, clock)
        with clock("color"):
            table = self._source.corrector.measure(image, range_map.measured_m)
        with clock("write"):
            keep_table(path, key, table.packed())
        return table

    def read_pair(self, pair: Pair) -> tuple[Image, Map]:
        """A pair's rectified image without the dive's light, and its measured ranges."""
        image, range_map = self.pixels(self.ranged(pair, Clock()), Clock())
        return self._evened(pair.name, image, range_map.measured_m, Clock()), range_map.measured_m

    def corrected(self, ranged: Ranged, water: Water, clock: Clock) -> FrameRow:
        """Correct the frame's colors and write it, unless an earlier run has with the same inputs. Returns its row."""
        name, settings, water_hash = ranged.pair.name, self.color_settings, water_key(water)
        key = content_key(ranged.key, settings, water_hash)
        stage = self._folder.frames.finished("corrected", name, key)
        kept = stage is not None and ranged.kept
        if stage is None:
            frame = self._correct(ranged, water, clock)
            facts = color_facts(frame.correction) | self._gain(name)
            stage = StageRecord(key, settings, water_hash, facts=facts, warnings=frame.correction.warnings)
            saved = self._save(ranged.record.with_stage("corrected", stage), ranged.pair, frame, clock)
            if self.page and name in self.page.names:
                with clock("page"):
                    self._show(self.page, saved, frame)
        self._kept.drop(name, ranged.key)
        return ranged.row.then(FrameRow(name, kept=kept, warnings=stage.warnings, facts=dict(stage.facts)))

    def _correct(self, ranged: Ranged, water: Water, clock: Clock) -> _Corrected:
        source = self._source
        before, measured = self.pixels(ranged, clock)
        with clock("color"):
            ranges = ranges_for_color(source.corrector, before, measured, water, source.seen)
        image = self._evened(ranged.pair.name, before, ranges.range_m, clock)
        with clock("color"):
            exposed = exposure_warnings(before, measured.measured_m, source.config.color.input_encoding)
            correction = correct(source.corrector, source.config, image, ranges, water)
            correction = replace(correction, warnings=(*correction.warnings, *exposed))
            return _Corrected(before, measured, ranges, correction)

    def _save(self, record: FrameRecord, pair: Pair, frame: _Corrected, clock: Clock) -> FrameRecord:
        source = self._source
        with clock("write"):
            exif = source.reader.capture(pair.left).exif
            files = correction_files(pair.name, frame.correction, frame.ranges, source.geometry, source.config.output, exif)
        if source.original:
            files |= self._original_files(pair, frame, exif, clock)
        with clock("write"):
            return self._folder.frames.save(record, "corrected", files)

    def _show(self, page: PageMaker, record: FrameRecord, frame: _Corrected) -> None:
        """Write the page's files of a frame that was just corrected."""
        correction = frame.correction
        written = record.stages["range"].outputs.keys() & {"confidence", "range_std"}
        products = {product: self._folder.frames.read(record, product) for product in written}
        products |= {"range": frame.ranges.measured_m, "mask": mask_codes(correction, frame.ranges)}
        products["corrected"] = correction.image if correction.linear is None else correction.linear
        stage = page.stage(record.stages["corrected"].key)
        self._folder.frames.save(record.with_stage("page", stage), "page", page.files(record.name, frame.before, products))

    def _gain(self, name: str) -> dict[str, float]:
        """light_gain, for frames.csv: the factor by which the frame is brighter than usual; empty where it was not measured."""
        if self.light is None or name not in self.light.gains:
            return {}
        return {"light_gain": float(np.exp(self.light.gains[name].mean()))}

    def _original_files(self, pair: Pair, frame: _Corrected, exif: bytes, clock: Clock) -> Files:
        """The frame in the camera's own pixels. The raw image itself is corrected: the rectified one, warped back, is blurred."""
        shown, rectified = frame.correction, frame.measured
        water = replace(shown.water, exposure=shown.exposure, highlights=shown.highlights)
        source, view = self._source, self._source.original
        assert view
        image = source.raw(pair, clock)
        with clock("color"):
            range_m = view.ranges(rectified.range_m)
            range_map = RangeMap.of_ranges(range_m, ~view.mask(rectified.filled))
            for_color = ranges_for_color(source.corrector, image, range_map, water)
            if self.light:
                light = self.light.on(pair.name, rectified.range_m.shape[::-1]).seen_through(view.smooth)
                image = even_light(image, for_color.range_m, light, source.config.color.input_encoding)
            correction = correct(source.corrector, source.config, image, for_color, water)
        return original_files(pair.left, correction, for_color.with_ranges(range_m, for_color.filled), exif)


def water_key(water: Water) -> str:
    """Hash of a water's content."""
    return content_key(water.content())


def water_keys(waters: Mapping[str, Water]) -> dict[str, str]:
    """Hash of the water of each frame, by name; under "*" where all frames have the same."""
    keys = {id(water): water_key(water) for water in {id(water): water for water in waters.values()}.values()}
    if len(set(keys.values())) == 1:
        return {"*": next(iter(keys.values()))}
    return {name: keys[id(water)] for name, water in waters.items()}
