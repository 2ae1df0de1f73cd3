"""The work of each pass on one frame: measure its range, count its colors over range, correct it.

Each is done once: an earlier run's result is found in OUT, or it is made now and written.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.original_view import OriginalView
from stereo_seecolor.checks.exposure import exposure_warnings
from stereo_seecolor.color.photometry.divided_light import divide_illumination, with_clipped
from stereo_seecolor.color.photometry.light_model import Light
from stereo_seecolor.color.response.response import Response
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.frame_facts import capture_facts, color_facts, range_facts
from stereo_seecolor.errors import InputError, MatchingError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline, correct, ranges_for_color
from stereo_seecolor.records import Correction, FrameRow, Image, Map, Mask, RangeMap, Water
from stereo_seecolor.run_folder import cache
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.kept_pixels import FramePixels, KeptPixels
from stereo_seecolor.run_folder.layout import table_file
from stereo_seecolor.run_folder.manifest import FrameRecord, StageRecord
from stereo_seecolor.run_folder.pair_files import (
    Files,
    correction_files,
    mask_codes,
    original_files,
    range_files,
)

if TYPE_CHECKING:
    from stereo_seecolor.dive.ranged_images import RangedImages

PairSource: TypeAlias = "Pipeline | RangedImages"
"""Reads and measures a pair."""

PageFiles = Callable[[str, str, Image, Mapping[str, NDArray[Any]]], tuple[StageRecord, Files]]
"""Makes the page's files of a frame while it is corrected, so that its images need not be decoded
again, and their record: of the key of the corrected frame, its name, its rectified image,
uncorrected, and product -> array, as it is stored.
"""


@dataclass(frozen=True, eq=False)
class Frames:
    """What the functions below need besides the pair: they may be called from many threads, and
    sent to another process.

    folder: OUT. pixels: kept for later passes of the run. verify: hash inputs again, also those
    that look unchanged. left_out: name of a pair that is not of the dive's rig -> why.
    """

    source: PairSource
    folder: RunFolder
    pixels: KeptPixels
    verify: bool = False
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def config(self) -> RunConfig:
        """The settings of the run."""
        return self.source.config

    def range_key(self, hashes: Mapping[str, str]) -> str:
        """Hash of all that a pair's range depends on. hashes: SHA-256 of its files, by side."""
        return content_key(hashes, self.source.settings)


@dataclass(frozen=True, eq=False)
class Ranged:
    """A pair whose range is known. record: OUT's record of it. key: hash of all that its range
    depends on.

    kept: True where an earlier run had measured it. measured: its pixels, if measured just now.
    """

    pair: Pair
    record: FrameRecord
    key: str
    kept: bool = True
    measured: tuple[Image, RangeMap] | None = None

    @property
    def row(self) -> FrameRow:
        """The frame's row after its range is known."""
        stage = self.record.stages["range"]
        hashes = {side: file.sha256 for side, file in self.record.inputs.items()}
        return FrameRow(
            self.pair.name,
            kept=self.kept,
            warnings=stage.warnings,
            hashes=hashes,
            facts=dict(stage.facts),
        )


def measure_range(
    frames: Frames, pair: Pair, clock: Clock, again: bool = False
) -> tuple[FrameRow, Ranged]:
    """The row of a pair, and its range: an earlier run's, or measured and written now. again: an
    earlier run's files are damaged. Raises InputError, MatchingError, CalibrationError.
    """
    products, source = frames.folder.frames, frames.source
    if pair.name in frames.left_out:
        raise MatchingError(f"{pair.name}: {frames.left_out[pair.name]}")
    with clock("read"):
        inputs = products.inputs(pair.name, source.inputs(pair), frames.verify)
        record = products.record(pair.name, pair.timestamp_s, inputs, pair.place)
        key = frames.range_key({side: file.sha256 for side, file in inputs.items()})
        known = not again and products.finished("range", pair.name, key) is not None
    if known:
        kept = "range" not in products.written.stages(pair.name)
        ranged = Ranged(pair, record, key, kept)
        return ranged.row, ranged
    hashes = {file.sha256 for file in inputs.values()}
    if len(hashes) < len(inputs) and all(file.stamp.size for file in inputs.values()):
        raise MatchingError(f"{pair.left}: is the same image as {pair.right}: no range is possible")
    image, range_map = source.measure(pair, clock)
    facts = range_facts(range_map) | capture_facts(source.reader.capture(pair.left))
    stage = StageRecord(key, source.settings, facts=facts, warnings=range_map.warnings)
    with clock("write"):
        files = (
            range_files(pair.name, range_map, source.config.output) if source.makes_ranges else {}
        )
        record = products.save(record.with_stage("range", stage), "range", files)
    ranged = Ranged(pair, record, key, kept=False, measured=(image, range_map))
    _keep_pixels(frames, ranged, image, range_map)
    return ranged.row, ranged


def _keep_pixels(frames: Frames, ranged: Ranged, image: Image, range_map: RangeMap) -> None:
    frames.pixels.keep(
        ranged.pair.name, ranged.key, FramePixels(image, range_map.range_m, ~range_map.filled)
    )


def count_colors(
    frames: Frames, light: Light | None, pair: Pair, clock: Clock
) -> tuple[FrameRow, MomentTable]:
    """The row of a pair, and its moment table: colors without the dive's light, over range.

    The table is an earlier run's, or counted now and kept.
    """
    row, ranged = measure_range(frames, pair, clock)
    path = frames.folder.root / table_file(pair.name, ranged.record.subfolder)
    key = content_key(ranged.key, light_key(light), Response.of(frames.config.color))
    with clock("read"):
        packed = cache.kept(path, key)
    if packed:
        return row, MomentTable.unpacked(packed)
    image, range_map = _pixels(frames, ranged, clock)
    divided = _divided(frames, light, pair.name, image, range_map.measured_m, clock)
    with clock("color"):
        counted = with_clipped(divided, image) if light else image
        table = frames.source.corrector.measure(counted, range_map.measured_m)
    with clock("write"):
        cache.keep(path, key, [table.packed()])
    return row, table


def read_frame(frames: Frames, pair: Pair) -> tuple[Image, Map]:
    """The rectified image of a pair and its measured ranges, for the search for light."""
    clock = Clock()
    _, ranged = measure_range(frames, pair, clock)
    image, range_map = _pixels(frames, ranged, clock)
    return image, range_map.measured_m


def _pixels(frames: Frames, ranged: Ranged, clock: Clock) -> tuple[Image, RangeMap]:
    """The (rectified) left image and range map of a pair; measured again if files were damaged."""
    if ranged.measured:
        return ranged.measured
    source, pair = frames.source, ranged.pair
    kept = frames.pixels.find(pair.name, ranged.key)
    warnings = ranged.record.stages["range"].warnings
    if kept and kept.range_m is not None and kept.measured is not None:
        return kept.image, RangeMap.of_ranges(kept.range_m, kept.measured, warnings)
    if not source.makes_ranges:
        return source.measure(pair, clock)
    try:
        with clock("read"):
            range_m, confidence = (
                frames.folder.frames.read(ranged.record, product)
                for product in ("range", "confidence")
            )
    except InputError:
        _, measured = measure_range(frames, pair, clock, again=True)
        assert measured.measured
        return measured.measured
    image = kept.image if kept else source.image(pair, clock)
    range_map = RangeMap.of_ranges(range_m, confidence > 0, warnings)
    _keep_pixels(frames, ranged, image, range_map)
    return image, range_map


def _divided(
    frames: Frames, light: Light | None, name: str, image: Image, range_m: Map, clock: Clock
) -> Image:
    """The rectified image without the dive's light."""
    if light is None:
        return image
    with clock("light"):
        of_frame = light.on(name, (image.shape[1], image.shape[0]))
        return divide_illumination(
            image, range_m, of_frame, frames.source.corrector.config.encoding
        )


def light_key(light: Light | None) -> str:
    """Hash of a dive's light; "" without one."""
    return light.fingerprint if light else ""


def color_settings(config: RunConfig, light: Light | None) -> str:
    """Hash of all that corrected frames depend on besides their ranges and their water."""
    return content_key(config.color.model_dump(), config.output.model_dump(), light_key(light))


def correct_frame(
    frames: Frames,
    light: Light | None,
    usual: Water,
    others: Mapping[str, Water],
    page: PageFiles | None,
    pair: Pair,
    clock: Clock,
) -> tuple[FrameRow, None]:
    """The row of a pair once its colors are corrected and written: now, or by an earlier run.

    usual: the water of all frames but ``others``.
    """
    row, ranged = measure_range(frames, pair, clock)
    water = others.get(pair.name, usual)
    settings, water_hash = color_settings(frames.config, light), water_key(water)
    key = content_key(ranged.key, settings, water_hash)
    stage = frames.folder.frames.finished("corrected", pair.name, key)
    kept = stage is not None and ranged.kept
    if stage is None:
        frame = _corrected(frames, light, ranged, water, clock)
        facts = color_facts(frame.correction) | _light_gain(light, pair.name)
        stage = StageRecord(
            key, settings, water_hash, facts=facts, warnings=frame.correction.warnings
        )
        with clock("write"):
            exif = frames.source.reader.capture(pair.left).exif
            output, geometry = frames.config.output, frames.source.geometry
            files = correction_files(
                pair.name, frame.correction, frame.ranges, geometry, output, exif
            )
        if frames.source.original:
            files |= _original_files(
                frames, frames.source.original, light, pair, frame, exif, clock
            )
        with clock("write"):
            record = frames.folder.frames.save(
                ranged.record.with_stage("corrected", stage), "corrected", files
            )
        if page:
            with clock("page"):
                _save_for_page(frames, page, record, frame)
    frames.pixels.drop(pair.name, ranged.key)
    facts = dict(stage.facts)
    return row.then(FrameRow(pair.name, kept=kept, warnings=stage.warnings, facts=facts)), None


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A frame that was just corrected.

    before: its rectified image, uncorrected. measured: its range map. ranges: the range map that it
    was corrected with, in which ranges are carried over to pixels without a measured one. outside:
    where the right image does not reach; None where that is unknown.
    """

    before: Image
    measured: RangeMap
    ranges: RangeMap
    outside: Mask | None
    correction: Correction


def _corrected(
    frames: Frames, light: Light | None, ranged: Ranged, water: Water, clock: Clock
) -> _Corrected:
    source = frames.source
    before, measured = _pixels(frames, ranged, clock)
    with clock("color"):
        ranges = ranges_for_color(source.corrector, before, measured, water, source.seen)
        pair = source.matched_by
        alike = pair is not None and pair.image_size == ranges.range_m.shape[::-1]
        outside = pair.outside_right(ranges.range_m) if pair and alike else None
    image = _divided(frames, light, ranged.pair.name, before, ranges.range_m, clock)
    with clock("color"):
        exposed = exposure_warnings(before, measured.measured_m, source.corrector.config.encoding)
        correction = correct(source.corrector, source.config, image, ranges, water, outside, before)
        correction = replace(correction, warnings=(*correction.warnings, *exposed))
        return _Corrected(before, measured, ranges, outside, correction)


def _light_gain(light: Light | None, name: str) -> dict[str, float]:
    """light_gain of frames.csv: how much brighter than usual a frame is; empty if not measured."""
    if light is None or name not in light.gains:
        return {}
    return {"light_gain": float(np.exp(light.gains[name].mean()))}


def _original_files(
    frames: Frames,
    view: OriginalView,
    light: Light | None,
    pair: Pair,
    frame: _Corrected,
    exif: bytes,
    clock: Clock,
) -> Files:
    """The frame in the camera's own pixels. The raw image itself is corrected: the rectified one,
    warped back, is blurred.
    """
    source, shown, rectified = frames.source, frame.correction, frame.measured
    water = replace(shown.water, exposure=shown.exposure, highlights=shown.highlights)
    image = before = source.raw(pair, clock)
    with clock("color"):
        range_m = view.ranges(rectified.range_m)
        range_map = RangeMap.of_ranges(range_m, ~view.mask(rectified.filled))
        for_color = ranges_for_color(source.corrector, image, range_map, water)
        if light:
            seen = light.on(pair.name, rectified.range_m.shape[::-1]).seen_through(view.smooth)
            image = divide_illumination(
                image, for_color.range_m, seen, source.corrector.config.encoding
            )
        outside = None if frame.outside is None else ~view.mask(~frame.outside)
        correction = correct(
            source.corrector, source.config, image, for_color, water, outside, before
        )
    return original_files(
        pair.left, correction, for_color.with_ranges(range_m, for_color.filled), exif
    )


def _save_for_page(frames: Frames, page: PageFiles, record: FrameRecord, frame: _Corrected) -> None:
    """Write the page's files of a frame that was just corrected."""
    correction, folder = frame.correction, frames.folder
    written = record.stages["range"].outputs.keys() & {"confidence", "range_std"}
    products = {product: folder.frames.read(record, product) for product in written}
    products |= {"range": frame.ranges.measured_m, "mask": mask_codes(correction, frame.ranges)}
    products["corrected"] = correction.image if correction.linear is None else correction.linear
    key = record.stages["corrected"].key
    stage, files = page(key, record.name, frame.before, products)
    folder.frames.save(record.with_stage("page", stage), "page", files)


def water_key(water: Water) -> str:
    """Hash of the content of water parameters."""
    return content_key(water.content())


def water_keys(waters: Mapping[str, Water]) -> dict[str, str]:
    """Hash of the water of each frame, by name; under "*" where all frames have the same."""
    keys = {
        id(water): water_key(water)
        for water in {id(water): water for water in waters.values()}.values()
    }
    if len(set(keys.values())) == 1:
        return {"*": next(iter(keys.values()))}
    return {name: keys[id(water)] for name, water in waters.items()}
