"""``merge``: the folders of a dive's shards into one, with one water and one manifest."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from calibration.formats import load_rig, native
from stereo_seecolor.checks.changes import LEFT_OUT
from stereo_seecolor.commands.run import color, color_with
from stereo_seecolor.commands.run_session import KIND, folder_request, run_session
from stereo_seecolor.commands.stereo_inputs import DiveInputs, Opened, StereoInputs
from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.dive.dive_run import DiveRun
from stereo_seecolor.dive.passes import NO_LIGHT, fit_waters, measure_ranges
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.fleet.shard_part import Part
from stereo_seecolor.files.atomic import flush_file, output_errors, temporary_path
from stereo_seecolor.inputs.listing import Unpaired
from stereo_seecolor.inputs.pairing import Pair, Pairing, in_dive_order
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.plugins import load
from stereo_seecolor.records import Numbers, Water
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.layout import FRAMES_TABLE, RIG, WATER, Stage, state, table_file
from stereo_seecolor.run_folder.manifest import FrameRecord
from stereo_seecolor.run_folder.stamp import Stamp
from stereo_seecolor.run_folder.water_file import waters_content


def merge(
    parts: Sequence[Path],
    out: Path,
    options: RunOptions | None = None,
    *,
    fit_only: bool = False,
    partial: bool = False,
) -> RunSummary:
    """Merge the results of runs over parts of a dive into ``out``, as those of one run; correct
    frames that are not corrected yet.

    Files are hard links in ``out`` where the file system has them, else copies; the parts stay as
    they are. The water is that of the parts, or fitted to all of them. fit_only: stop when
    water.json is written.
    partial: merge although shards of the dive are missing, and name them.
    Raises InputError where the parts do not belong together or are not all; SeeColorError,
    CalibrationError as ``run`` does.
    """
    options = options or RunOptions()
    paths = [part.resolve() for part in parts]
    twice = next((part for n, part in enumerate(parts) if paths[n] in paths[:n]), None)
    if twice:
        raise InputError(f"{twice}: is given twice: give each part once")
    opened_parts = [Part.open(part) for part in parts]
    missing = _missing_shards(opened_parts, partial)
    opened, inputs = _opened(opened_parts, missing), _named_inputs(opened_parts[0])
    waters, pipeline = _waters(opened_parts), opened.pipeline
    read = [*inputs.paths, *(part.root / FRAMES_TABLE for part in opened_parts)]
    with RunFolder(
        out, folder_request(inputs.owner(KIND, opened), pipeline.config, options, read)
    ) as folder:
        for part in opened_parts:
            for frame in part.frames():
                _adopt(folder, part.root, frame)
        last: Stage = "range" if fit_only else "corrected"
        passes = ("ranges", "waters") if fit_only else ("ranges", "light", "waters", "colors")
        with (
            options.compute.sharing(state(folder.root), inputs.paths),
            run_session(
                pipeline, opened.pairing, inputs.names, folder, options, last, passes
            ) as run,
        ):
            folder.dive.write(RIG, native.to_bytes(pipeline.rig))
            if fit_only:
                fitted = (
                    fit_waters(run, measure_ranges(run), NO_LIGHT) if waters is None else waters
                )
                folder.dive.write(WATER, waters_content(_of_pairs(run, fitted)))
            elif waters is None:
                color(run, measure_ranges(run))
            else:
                color_with(run, _of_pairs(run, waters))
        return run.summary


def _named_inputs(part: Part) -> DiveInputs:
    """The inputs that a part's run.json names."""
    names = part.run.inputs
    if "bag" in names:
        inputs: DiveInputs = load("inputs", "bag").BagInputs(
            part.source(names["bag"]), names["calib"], names["topics"]
        )
        return inputs
    return StereoInputs(part.source(names["left"]), part.source(names["right"]), names["calib"])


def _adopt(folder: RunFolder, other: Path, frame: FrameRecord) -> None:
    """Take a frame of another run's folder as one of this, its table included; its files get a
    second name, or are copied.

    What it holds of the frame already is kept if the same or more. Raises OutputError.
    """
    known = folder.manifest.frame(frame.name)
    if known and all(
        folder.frames.finished(stage, frame.name, record.key)
        for stage, record in frame.stages.items()
    ):
        return
    folder.frames.discard(frame.name)
    table = table_file(frame.name, frame.subfolder)
    temporaries: dict[str, Path] = {}
    for path in (*frame.files, table):
        if (other / path).is_file():
            with output_errors(folder.root / path):
                temporaries[path] = _linked(other / path, folder.root / path)
    folder.manifest.save_frame(frame)
    stamps = (Stamp.of(other / table),) if table in temporaries else ()
    folder.owned.move_into_place(temporaries, {**frame.files, table: stamps})


def _linked(source: Path, path: Path) -> Path:
    """A second name for a file, else a copy, beside ``path``. Raises OSError."""
    temporary = temporary_path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        temporary.hardlink_to(source)
    except OSError:
        shutil.copy2(source, temporary)
        flush_file(temporary)
    return temporary


def _of_pairs(run: DiveRun, waters: Mapping[str, Water]) -> Mapping[str, Water]:
    """The waters of the run's pairs, in their order."""
    return {pair.name: waters[pair.name] for pair in run.pairs if pair.name in waters}


def _missing_shards(parts: Sequence[Part], partial: bool) -> tuple[str, ...]:
    """Name the shards of the dive that are not among the parts. Raises InputError where some are,
    unless ``partial``, and where the parts are not of one cut.
    """
    given: dict[Shard, Part] = {}
    for part in parts:
        if part.shard is None:
            continue
        given.setdefault(part.shard, part)
        first = next(iter(given))
        if part.shard.of != first.of:
            raise InputError(
                f"{given[first].root} is shard {first}, and {part.root} is shard {part.shard}: "
                "merge only shards of one division: shards of two divisions contain pairs "
                "twice or miss pairs"
            )
        if part.of_dive != given[first].of_dive:
            raise InputError(
                f"{given[first].root} is a shard of {given[first].of_dive} pairs, and {part.root} "
                f"of {part.of_dive}: images were added or removed in between: run all shards again "
                "over the same images"
            )
    of = max((shard.of for shard in given), default=0)
    missing = tuple(
        str(shard)
        for shard in (Shard(number, of) for number in range(1, of + 1))
        if shard not in given
    )
    if missing and not partial:
        raise InputError(
            f"shard {', '.join(missing)} is missing: run it and give all {of}; --partial merges "
            "the others and names what is missing"
        )
    return missing


def _opened(parts: Sequence[Part], missing: tuple[str, ...]) -> Opened:
    """All pairs of the parts and their pipeline. Raises InputError where parts differ."""
    first = parts[0]
    for part in parts[1:]:
        if part.settings != first.settings or part.run.config != first.run.config:
            raise InputError(
                f"{part.root}: was made with other settings or another rig than {first.root}: run "
                "it again with the same --calib and --config"
            )
    pipeline = Pipeline(load_rig(str(first.rig)), first.run.config)
    if pipeline.settings != first.settings:
        raise InputError(
            f"{first.root}: was made by another version of the program: run its command again first"
        )
    unpaired = {
        row.left: Unpaired(Path(row.left), row.error.removeprefix(f"{row.left}: "))
        for part in parts
        for row in part.rows
        if row.status == "unpaired"
    }
    notes = [f"only a part of the dive: shard {', '.join(missing)} is missing"] if missing else []
    waters = [water for part in parts if (water := part.shared_water)]
    if any(water != waters[0] for water in waters):
        notes.append(
            "the parts were corrected with different water parameters: unless one --water with "
            "those of each frame gave them, colors change from part to part: run all shards with "
            "the same --water"
        )
    rig_notes = dict.fromkeys(note for part in parts for note in part.rig_notes)
    pairing = Pairing(
        tuple(in_dive_order(_pairs(parts))),
        tuple(unpaired.values()),
        (*notes, *rig_notes),
        missing_shards=missing,
        wrong=frozenset[Numbers]().union(*(part.wrong for part in parts)),
        ranges=next((part.run.range_error for part in parts if part.run.range_error), None),
        left_out={
            row.name: LEFT_OUT for part in parts for row in part.rows if LEFT_OUT in row.error
        },
    )
    return Opened(pairing, pipeline)


def _pairs(parts: Sequence[Part]) -> list[Pair]:
    """Every pair of the parts, once. Raises InputError if parts share an image's name."""
    pairs: dict[str, Pair] = {}
    seen: dict[str, tuple[Part, tuple[str, str]]] = {}
    for part in parts:
        for row in part.rows:
            if row.status == "failed":
                pairs.setdefault(
                    row.name, _pair(part, row.name, row.left, row.right, row.timestamp_s)
                )
        for frame in part.frames():
            left, right = frame.inputs["left"], frame.inputs["right"]
            other, hashes = seen.setdefault(frame.name, (part, (left.sha256, right.sha256)))
            if hashes != (left.sha256, right.sha256):
                raise InputError(
                    f"{part.root} and {other.root}: contain two different pairs {frame.name!r}: "
                    "merge them separately"
                )
            pairs[frame.name] = _pair(part, frame.name, left.path, right.path, frame.timestamp_s)
    return list(pairs.values())


def _pair(part: Part, name: str, left: str, right: str, timestamp_s: float | None) -> Pair:
    return Pair(name, part.source(left), part.source(right), timestamp_s)


def _waters(parts: Sequence[Part]) -> Mapping[str, Water] | None:
    """The water of each frame that the parts were corrected with; None where none was. Raises
    InputError where only some were.
    """
    waters = {part.root: part.waters() for part in parts}
    missing = [root for root, found in waters.items() if found is None]
    if len(missing) == len(parts):
        return None
    if missing:
        raise InputError(
            f"{missing[0]}: has no water yet, and other parts have: run its command again with "
            "the same --water"
        )
    return {name: water for found in waters.values() for name, water in (found or {}).items()}
