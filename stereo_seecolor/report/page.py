"""START HERE: the page of a run, written into OUT."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from stereo_seecolor.color.white_point import white_errors
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.files.contained import is_there
from stereo_seecolor.files.deflate import deflated
from stereo_seecolor.files.json_values import plain
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.report.calibration_std import calibration_note, calibration_std
from stereo_seecolor.report.chart_records import kept_charts
from stereo_seecolor.report.facts import DiveFacts
from stereo_seecolor.report.frame_blocks import FOLDER as FRAME_BLOCKS
from stereo_seecolor.report.frame_blocks import frame_blocks
from stereo_seecolor.report.frame_files import FORMAT, FrameFiles, page_stage
from stereo_seecolor.report.kept_measures import FILE as MEASURES
from stereo_seecolor.report.kept_measures import read_kept_measures
from stereo_seecolor.report.map_files import write_map_files
from stereo_seecolor.report.methods import citations, methods
from stereo_seecolor.report.overview import (
    NAMED_FRAMES,
    changed_settings,
    dive_facts,
    example_frames,
)
from stereo_seecolor.report.page_columns import columns
from stereo_seecolor.report.templates import render_template, script
from stereo_seecolor.report.texts import STATIC, phrase, texts
from stereo_seecolor.report.verdict import judge
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import INDEX, MAP, PAGE, WHAT_IS_WHERE
from stereo_seecolor.run_folder.manifest import FrameRecord

ASSETS = ("page.js", "page.css", "map.js", "licenses.txt")
"""The program of the page, built from web/."""


@dataclass(frozen=True)
class PageSummary:
    """The page that was written: the file to open. made, kept: numbers of frames whose files were
    made now, or earlier.

    left_out: frames whose files are gone or damaged, such rasters of the map, and measures that
    cannot be used, with the reason.
    """

    page: Path
    made: int
    kept: int
    left_out: dict[str, str]


def write_page(
    folder: RunFolder, run: FinishedRun, progress: Callable[[int, int], None]
) -> PageSummary:
    """Write OUT/index.html and OUT/page. Frames that an earlier page shows are not read again.

    Raises OutputError; InputError if files that the page is made from are missing or damaged. A
    frame whose files are, a raster of the map, or the map, is named in the summary and left out.
    """
    facts, no_map = _facts(run)
    settings = content_key(FORMAT)
    record_of = partial(_frame_record, folder, FrameFiles.of(run))
    made, left_out, shown = 0, {}, {}
    for number, (frame, record) in enumerate(
        zip(run.frames, Threads(cores()).each(record_of, run.frames), strict=True)
    ):
        progress(number + 1, len(run.frames))
        if isinstance(record, FrameError):
            left_out[frame.name] = str(record)
        elif record is not None:
            made += "page" in folder.frames.written.stages(frame.name)
            shown[frame.name] = tuple(record.stages["page"].outputs)
    folder.dive.update(
        replace(folder.dive.record, settings={**folder.dive.record.settings, "page": settings})
    )
    try:
        left_out |= no_map | write_map_files(folder, facts)
    except InputError as error:
        facts = replace(facts, map=None, posed=None)
        left_out |= {MAP: str(error)} | write_map_files(folder, facts)
    kept, problem = _kept_on_page(run)
    left_out |= problem
    blocks, scripts = frame_blocks(facts)
    former = [name for name in folder.dive.record.files if name.startswith(f"{FRAME_BLOCKS}/")]
    folder.dive.remove(*(name for name in former if name not in scripts))
    files = {
        f"{PAGE}/{name}": (STATIC / name).read_bytes()
        for name in ASSETS
        if (STATIC / name).is_file()
    }
    files |= {
        **scripts,
        f"{PAGE}/dive.js": script("dive", _data(facts, shown) | blocks | kept),
        INDEX: render(facts, shown, kept_charts(folder)),
    }
    folder.dive.write_files(files, {INDEX: folder.dive.digest("corrected")})
    return PageSummary(folder.root / INDEX, made, len(shown) - made, left_out)


def _facts(run: FinishedRun) -> tuple[DiveFacts, dict[str, str]]:
    """What a run holds; without its map where that cannot be read, and why, by its folder.

    Raises InputError for the tables of the run.
    """
    try:
        return DiveFacts.of(run), {}
    except InputError as error:
        return DiveFacts.of(run, with_map=False), {MAP: str(error)}


def _kept_on_page(run: FinishedRun) -> tuple[dict[str, Any], dict[str, str]]:
    """What was measured on an earlier page, and its random points, as they lie in OUT; and why they
    cannot be used, by file.
    """
    path, dive = run.root / MEASURES, _dive_id(run)
    if not path.exists():
        return {}, {}
    try:
        kept = read_kept_measures(path)
    except InputError as error:
        return {}, {MEASURES: str(error)}
    if kept.dive != dive:
        return {}, {MEASURES: f"{path}: holds measures of another dive"}
    return {"measures": kept.content, "cover": kept.cover and asdict(kept.cover)}, {}


def _dive_id(run: FinishedRun) -> str:
    return run.frames[0].sha256[:16] if run.frames else ""


def _frame_record(
    folder: RunFolder, files: FrameFiles, frame: FinishedFrame
) -> FrameRecord | FrameError | None:
    """The frame's record once its files are made, unless they exist; a FrameError where it cannot
    be shown; None where it has no corrected image.
    """
    record = folder.manifest.frame(frame.name)
    if record is None or "corrected" not in record.stages:
        return None
    stages = {
        before: page_stage(record.stages["corrected"].key, before) for before in (True, False)
    }
    with_before = frame.left != Path() and is_there(frame.left)
    good = [stages[True]] if with_before else [stages[True], stages[False]]
    if any(folder.frames.finished("page", frame.name, stage.key) for stage in good):
        return record
    try:
        made = files.make(frame)
    except FrameError as error:
        return error
    return folder.frames.save(record.with_stage("page", stages[with_before]), "page", made)


Shown = dict[str, tuple[str, ...]]
"""Frame -> the products that the page shows of it."""


def _data(facts: DiveFacts, shown: Shown) -> dict[str, Any]:
    """The data of the dive for the page's program."""
    run, known, water = facts.run, calibration_std(facts.run), facts.water
    corrected = (frame.products.get("corrected") for frame in run.frames)
    of_water = {"water": water.content(), "white_errors": white_errors(water)} if water else {}
    return {
        "format": FORMAT,
        "id": _dive_id(run),
        "texts": texts(),
        "calibration": calibration_note(known),
        "calibration_std": known.total,
        "geometry": asdict(run.geometry) if run.geometry else None,
        "offset_m": facts.map.offset_m if facts.map else [0.0, 0.0, 0.0],
        "north": facts.map is not None and facts.map.origin is not None,
        "area_m2": facts.map.area_m2 if facts.map else None,
        "image_suffix": next((path.suffix for path in corrected if path), ""),
        **plain(of_water),
        "frames": _frames(facts, shown),
    }


def _frames(facts: DiveFacts, shown: Shown) -> bytes:
    """What the page knows of all frames at once, deflated: some ten bytes a frame. shown, shelves:
    number of its products in the list of ``products`` (-1: none), and its folder.
    """
    found = columns(facts)
    kinds = list(dict.fromkeys(shown.values()))
    shelves = {frame.name: frame.subfolder for frame in facts.run.frames if frame.subfolder}
    found |= {
        "products": [[product.split("/")[1] for product in products] for products in kinds],
        "shown": [kinds.index(shown[name]) if name in shown else -1 for name in found["names"]],
        "shelves": [shelves.get(name, "") for name in found["names"]] if shelves else [],
    }
    text = json.dumps(found, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return deflated(text.encode("ascii"), repeats=True)


def _before(run: FinishedRun, name: str, products: Sequence[str]) -> str:
    """The path in OUT of a frame's image before correction; "" where the page has none."""
    return run.frame(name).page_path("page/before") if "page/before" in products else ""


def _picture(run: FinishedRun, name: str, products: Sequence[str]) -> str:
    """The path in OUT of the corrected picture that the page shows of a frame."""
    frame = run.frame(name)
    if "page/after" in products:
        return frame.page_path("page/after")
    return frame.products["corrected"].relative_to(run.root).as_posix()


def render(facts: DiveFacts, shown: Shown, found: Mapping[str, Any]) -> bytes:
    """The content of index.html, with the overview. found: charts and spread, empty where they were
    not searched for.
    """
    run = facts.run
    return render_template(
        "index.html.j2",
        t=phrase,
        dive=dive_name(run.inputs, run.root),
        run=run,
        verdict=judge(facts),
        dive_facts=dive_facts(facts),
        problems=facts.problems,
        named_frames=NAMED_FRAMES,
        notes=run.totals["notes"],
        examples=[
            (name, why, _before(run, name, shown[name]), _picture(run, name, shown[name]))
            for name, why in example_frames(facts)
            if name in shown
        ],
        methods=methods(facts),
        citations=citations(facts),
        changed_settings=changed_settings(run.config),
        charts=found.get("charts", []),
        spread=found.get("spread"),
        looked_for_charts=bool(found),
        has_map=facts.map is not None,
        files={name: what for name, what in WHAT_IS_WHERE.items() if (run.root / name).exists()},
    )


def dive_name(inputs: Mapping[str, str], root: Path) -> str:
    """The name of the dive: of the folder of its left images' folder, else of OUT."""
    return Path(inputs.get("left", "")).parent.name or root.resolve().name
