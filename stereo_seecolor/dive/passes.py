"""The passes over the pairs of a dive: ranges, light, waters, colors.

1. ``measure_ranges``: each pair is read, rectified and matched to a range map.
2. ``find_light``: lamps, lens and exposure are solved from spots that several frames show.
3. ``fit_waters``: the water is fitted to the colors of all frames, without that light, counted over
  range.
4. ``correct_frames``: light and water are removed from each frame.

What an earlier run found with the same inputs and settings is kept.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from stereo_seecolor.checks.blurred_side import blurred_side_notes
from stereo_seecolor.checks.changes import LEFT_OUT
from stereo_seecolor.checks.exchanged_channels import exchanged_channels_notes
from stereo_seecolor.checks.exposure import recorded_exposure_notes
from stereo_seecolor.checks.fitted_water import range_scale_notes
from stereo_seecolor.checks.odd_pairs import odd_among
from stereo_seecolor.checks.sample import evenly_spaced
from stereo_seecolor.color.photometry.light_model import Light
from stereo_seecolor.color.photometry.light_solver import LightTerms
from stereo_seecolor.color.sharing.survey import CountedFrames, add_to
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.names import ByName, Names
from stereo_seecolor.compute.sources import ROOT, sources_digest
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.dive.dive_run import DiveRun, Outcome, Work, attempt
from stereo_seecolor.dive.frame_facts import recorded_capture
from stereo_seecolor.dive.frames import (
    color_settings,
    correct_frame,
    count_colors,
    measure_range,
    read_frame,
    water_keys,
)
from stereo_seecolor.dive.pair_sequences import chosen, groups, with_names
from stereo_seecolor.files.keys import ContentKey, content_key
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Capture, FrameRow, Water
from stereo_seecolor.run_folder.cache import KeptFit, KeptLight
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import Stage
from stereo_seecolor.run_folder.water_file import waters_content

NO_SHARED_SPOTS = (
    "light: no two frames show the same spots, so the effects of lamps, lens and exposure remain "
    "in the images"
)
LONG_DIVE = 10_000
"""Pairs beyond which moment tables are added up in groups, by workers, before the fit."""
CHECKED = 5
"""Pairs whose colors are checked for exchanged channels: files of one dive have one order."""

FITTING = tuple(
    ROOT / "stereo_seecolor" / name for name in ("dive/light_search.py", "color/corrector.py")
)
"""The modules whose code, with all that they import, finds a dive's light and its waters."""


@dataclass(frozen=True, eq=False)
class DiveRanges:
    """The ranges of a dive. key: hash of them; None where a pair has none. captures: what the
    camera recorded of each good pair.
    """

    key: str | None
    captures: Sequence[Capture]


@dataclass(frozen=True, eq=False)
class DiveLight:
    """The light of a dive. light: None where none of it is used. content: for water.json.

    linked: names of frames that show what the frame before them shows.
    """

    light: Light | None = None
    content: Mapping[str, Any] | None = None
    linked: Collection[str] = ()


NO_LIGHT = DiveLight()


def measure_ranges(run: DiveRun) -> DiveRanges:
    """Make the range maps. Corrected frames stay current if the settings of ranges are the same."""
    settings, earlier = run.frames.source.settings, run.folder.dive.record.settings
    run.folder.dive.begin(
        {**(earlier if earlier.get("range") == settings else {}), "range": settings}
    )
    key, captures = ContentKey(), list[Capture]()
    different: dict[Capture, Capture] = {}  # a dive has few
    for outcome in run.map("ranges", partial(measure_range, run.frames), run.pairs):
        row = outcome.row
        key.add((row.name, run.frames.range_key(row.hashes)))
        capture = recorded_capture(row.facts)
        captures.append(different.setdefault(capture, capture))
    _leave_out_odd(run)
    run.notes += blurred_side_notes(_range_facts(run))
    run.notes += recorded_exposure_notes(
        captures,
        [pair.timestamp_s for pair in run.pairs],
        run.frames.config.input.exposures is not None,
    )
    return DiveRanges(None if run.table.failed else key.value, captures)


def _leave_out_odd(run: DiveRun) -> None:
    """Let pairs fail that were measured and turn out to be of another rig, so that they do not
    spoil light and water of the dive.
    """
    rectification, pairs = run.frames.source.rectification, run.good_pairs
    if rectification is None or not run.frames.source.makes_ranges:
        return
    odd = odd_among(rectification, pairs, run.frames.config.input, _range_facts(run))
    if odd.odd:
        run.notes += (f"calibration: {odd.line}",)
        run.frames = replace(
            run.frames, left_out={**run.frames.left_out, **dict.fromkeys(odd.odd, LEFT_OUT)}
        )
        again = chosen(pairs, lambda pair: pair.name in odd.odd)
        make_pass(run, "ranges", partial(measure_range, run.frames), again)


def _range_facts(run: DiveRun) -> list[Mapping[str, float]]:
    """The facts of each good pair."""
    rows = (run.table.row(pair.name) for pair in run.good_pairs)
    return [row.facts if row else {} for row in rows]


def find_light(run: DiveRun, ranges: DiveRanges) -> DiveLight:
    """The light of the dive: an earlier run's of the same inputs, else solved now; none where fewer
    than two frames went through.
    """
    color, source = run.frames.config.color, run.frames.source
    allowed = LightTerms(
        color.lights == "auto",
        color.lights == "auto",
        color.camera_exposure == "auto",
        color.lights == "auto",
    )
    if source.geometry is None or len(run.good_pairs) < 2 or not any(allowed):
        return NO_LIGHT
    key = _fit_key(run, ranges, None)
    kept = KeptLight.load(run.folder.root, key) if key and not run.options.verify else None
    if kept is None:
        kept = _solve_light(run, ranges, allowed)
        if key:
            kept.save(run.folder.root, key)
    run.notes += (kept.note,) if kept.note else ()
    if not kept.light:
        return DiveLight(linked=kept.linked)
    light = Light.from_content(kept.light)
    found = {
        name: value
        for name, value in kept.light.items()
        if name not in ("log_gains", "log_shading")
    }
    return DiveLight(light, {**found, **light.content()}, kept.linked)


def _solve_light(run: DiveRun, ranges: DiveRanges, allowed: LightTerms) -> KeptLight:
    from stereo_seecolor.dive.light_search import LightSearch  # loads the search for features

    pairs, geometry = run.good_pairs, run.frames.source.geometry
    assert geometry
    run.begin("light", len(pairs))
    search = LightSearch(
        frames=with_names(pairs),
        read=partial(read_frame, run.frames),
        captures=ranges.captures,
        geometry=geometry,
        encoding=run.frames.source.corrector.config.encoding,
        compute=run.options.compute,
        examined=lambda name: run.advance(FrameRow(name)),
        files=run.frames.config.color.encoding,
    )
    found = search.solve(allowed)
    content = found.light.content() if found.light and found.light.light else None
    note = found.light.note if found.light else NO_SHARED_SPOTS
    return KeptLight(note, content, Names(found.linked))


def fit_waters(run: DiveRun, ranges: DiveRanges, light: DiveLight) -> Mapping[str, Water]:
    """Each frame's water, by name: an earlier run's of the same inputs, else fitted now."""
    key = _fit_key(run, ranges, light.light)
    kept = KeptFit.load(run.folder.root, key) if key and not run.options.verify else None
    if kept:
        waters = kept.waters(run.folder.root, [pair.name for pair in run.pairs])
        if waters is not None:
            run.notes += kept.notes
            return waters
    config = run.frames.config.color
    fitter = run.frames.source.corrector.survey_fitter(light.light, light.linked)
    some = dict[int, MomentTable]()
    if fitter.joins and len(run.pairs) > LONG_DIVE:
        for counted in _counted_groups(run, light.light):
            fitter.join(counted)
            add_to(some, counted.classes)
    else:
        checked = {pair.name for pair in evenly_spaced(run.good_pairs, CHECKED)}
        for name, table in count_frames(run, light.light):
            fitter.add(name, table)
            if name in checked:
                add_to(some, CountedFrames.of([(name, table)], config).classes)
    waters = fitter.waters()
    notes = fitter.notes()
    # the paper's water has no white point, so that its veil takes part in the cast
    if config.method == "robust":
        notes += exchanged_channels_notes(some, config, run.frames.config.input.other_channels)
        notes += range_scale_notes(waters, given=not run.frames.source.makes_ranges)
    run.notes += notes
    if key:
        KeptFit.of(notes, waters_content(waters, light.content)).save(run.folder.root, key)
    return waters


def count_frames(run: DiveRun, light: Light | None) -> Iterator[tuple[str, MomentTable]]:
    """Count the colors over range of all good pairs: yields name and moment table."""
    work = partial(count_colors, run.frames, light)
    for outcome in run.map("waters", work, run.good_pairs, keep=True):
        assert outcome.result
        yield outcome.row.name, outcome.result


def _counted_groups(run: DiveRun, light: Light | None) -> Iterator[CountedFrames]:
    """Count groups of neighboring frames, whose moment tables the workers add up: a long dive has
    too many for one process.
    """
    pairs = run.good_pairs
    work = partial(
        _count_group, partial(count_colors, run.frames, light), run.folder, run.frames.config.color
    )
    for outcomes, counted in run.outcomes("waters", work, groups(pairs), len(pairs)):
        for outcome in outcomes:
            run.note(outcome)
        yield counted


def _count_group(
    work: Work[MomentTable], folder: RunFolder, config: ColorConfig, pairs: Sequence[Pair]
) -> tuple[list[Outcome[MomentTable]], CountedFrames]:
    """The outcome of each pair of a group, and the sum of their moment tables."""
    outcomes: list[Outcome[MomentTable]] = []

    def tables() -> Iterator[tuple[str, MomentTable]]:
        for pair in pairs:
            outcome = attempt(work, folder, True, pair)
            # the first pass has noted these
            row = replace(outcome.row, hashes={}, facts={}, left="", right="")
            outcomes.append(replace(outcome, row=row, result=None))
            if outcome.result is not None:
                yield pair.name, outcome.result

    return outcomes, CountedFrames.of(tables(), config)


def correct_frames(run: DiveRun, light: DiveLight, waters: Mapping[str, Water]) -> None:
    """Correct each frame that has water parameters, and write it with its cloud."""
    settings: dict[Stage, str] = {
        "range": run.frames.source.settings,
        "corrected": color_settings(run.frames.config, light.light),
    }
    run.folder.dive.begin(settings)
    run.folder.dive.set_waters(water_keys(waters))
    if waters:
        usual = next(iter(waters.values()))  # a worker is sent one water, not one a frame
        others = ByName((name, water) for name, water in waters.items() if water is not usual)
        work = partial(correct_frame, run.frames, light.light, usual, others, run.page)
        make_pass(run, "colors", work, chosen(run.pairs, lambda pair: pair.name in waters))


def make_pass(run: DiveRun, stage: str, work: Work[Any], pairs: Sequence[Pair]) -> None:
    """Make a pass of which nothing but files and rows is kept."""
    for _ in run.map(stage, work, pairs):
        pass


def _fit_key(run: DiveRun, ranges: DiveRanges, light: Light | None) -> str | None:
    """Hash of inputs and code of the fits of light and water; None where a pair has no range."""
    settings = color_settings(run.frames.config, light)
    return ranges.key and content_key(
        settings, ranges.key, [sources_digest(file) for file in FITTING]
    )
