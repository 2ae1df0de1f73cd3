"""START HERE: ``run`` computes range maps, true-color frames, clouds and tables from the stereo
pairs of a dive.

``pipeline.py`` takes one pair through the same steps in memory; ``fuse.py`` makes the map.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from calibration.formats import native
from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.checks.dive import RANGED_CHECKS
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.checks.verdict import verdict_of
from stereo_seecolor.commands.run_session import folder_request, run_session, stereo_run
from stereo_seecolor.commands.stereo_inputs import (
    DiveInputs,
    StereoInputs,
    sample,
    settle_storage,
)
from stereo_seecolor.compute.library_threads import one_thread_in_products
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.dive_run import DiveRun
from stereo_seecolor.dive.passes import (
    NO_LIGHT,
    DiveRanges,
    correct_frames,
    count_frames,
    find_light,
    fit_waters,
    make_pass,
    measure_ranges,
)
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.listing import RANGE_EXTENSIONS, folders_of
from stereo_seecolor.inputs.pairing import Pair, pair_by_stem
from stereo_seecolor.inputs.range_maps import holds_floats
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import FrameRow, Water
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.layout import RECTIFIED_RIG, WATER, Stage
from stereo_seecolor.run_folder.manifest import StageRecord
from stereo_seecolor.run_folder.ownership import Owner
from stereo_seecolor.run_folder.pair_files import rectified_files
from stereo_seecolor.run_folder.water_file import read_known_waters, read_waters, waters_content


def run(
    left: str | Path,
    right: str | Path,
    calib: str | Path,
    out: str | Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
) -> RunSummary:
    """Compute range maps, true-color frames, clouds and tables of the pairs of a dive in ``out``.

    Args:
        left: Folder of the left images, a pattern (``DIVE/*_L.png``), or a video.
        right: The same of the right images; the left video again where it shows both sides.
        calib: A calibration in any format that ``calibration.formats.load_rig`` reads.
        out: Folder for the results; made where it does not exist.
        config: Settings; the defaults if not given.
        options: How the work is done: workers, overwriting, listeners. A shard (``options.shard``)
            without water parameters (``options.water``) stops before the fit: ``merge`` fits the
            water of all shards.

    Returns:
        The outcome of every pair, and the totals. A bad pair is a row that names its error.

    Raises:
        SeeColorError: For what concerns the whole dive.
        CalibrationError: For a calibration that cannot be read or does not fit the images.
    """
    return run_inputs(StereoInputs(Path(left), Path(right), calib), Path(out), config, options)


@one_thread_in_products()
def run_inputs(
    inputs: DiveInputs,
    out: Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
) -> RunSummary:
    """``run`` for two sides (images or videos) or for a ROS bag: .bag, .db3, .mcap, or the folder
    of a split one; without ROS.

    Raises as ``run``, and DeviceError if a library for bags or videos is missing.
    """
    config, options = config or RunConfig(), options or RunOptions()
    last: Stage = "corrected"
    passes: Sequence[str] = ("ranges", "light", "waters", "colors")
    if not options.shard.whole and options.water is None:
        last, passes = "range", ("ranges", "waters")
    with stereo_run(inputs, out, config, options, last, passes) as run:
        if options.shard.whole:
            given = _given_waters(run)
            color(run, measure_ranges(run), given)
        elif options.water:
            color_with(run, read_known_waters(options.water, [pair.name for pair in run.pairs]))
        else:  # ranges and moment tables, to which ``merge`` fits the water
            measure_ranges(run)
            for _ in count_frames(run, None):
                pass
    return run.summary


def color(run: DiveRun, ranges: DiveRanges, given: Mapping[str, Water] | None = None) -> None:
    """Take all pairs of a dive from ranges to true colors. given: the water of each frame, by name;
    None: the waters are fitted to the dive.
    """
    light = find_light(run, ranges)
    waters = fit_waters(run, ranges, light) if given is None else given
    own, file = run.folder.root / WATER, run.options.water
    if waters and (file is None or file.resolve() != own.resolve()):
        run.folder.dive.write(WATER, waters_content(waters, light.content))
    correct_frames(run, light, waters)


def _given_waters(run: DiveRun) -> Mapping[str, Water] | None:
    """The water of each frame from the file that the options name; None where they name none."""
    file = run.options.water
    return read_waters(file, [pair.name for pair in run.pairs]) if file else None


def color_with(run: DiveRun, waters: Mapping[str, Water]) -> None:
    """Take the pairs of shards to true colors, with waters that were fitted to all shards, by frame
    name, and no light.

    A pair without water parameters failed before the fit, and its row says again why.
    """
    measure_ranges(run)
    run.folder.dive.write(WATER, waters_content(waters))
    correct_frames(run, NO_LIGHT, waters)


def range_maps(
    left: str | Path,
    right: str | Path,
    calib: str | Path,
    out: str | Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
) -> RunSummary:
    """Write the range maps of a dive, without colors, into ``out``.

    Args:
        left: Folder of the left images, a pattern (``DIVE/*_L.png``), or a video.
        right: The same of the right images; the left video again where it shows both sides.
        calib: A calibration in any format that ``calibration.formats.load_rig`` reads.
        out: Folder for the results; made where it does not exist.
        config: Settings; the defaults if not given.
        options: How the work is done: workers, overwriting, listeners.

    Returns:
        The outcome of every pair, and the totals. A bad pair is a row that names its error.

    Raises:
        SeeColorError: For what concerns the whole dive.
        CalibrationError: For a calibration that cannot be read or does not fit the images.
    """
    inputs = StereoInputs(Path(left), Path(right), calib)
    config, options = config or RunConfig(), options or RunOptions()
    with stereo_run(inputs, Path(out), config, options, "range", ("ranges",)) as run:
        measure_ranges(run)
    return run.summary


def correct(
    images: str | Path,
    ranges: str | Path,
    out: str | Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
) -> RunSummary:
    """Correct images that already have range maps, and write the results into ``out``.

    The images may be unrelated, so that ``color.lock: auto`` means ``frame`` here.

    Args:
        images: Folder of images.
        ranges: Folder of their range maps, with the same names (see ``read_range_map``).
        out: Folder for the results; made where it does not exist.
        config: Settings; the defaults if not given.
        options: How the work is done: workers, overwriting, listeners.

    Returns:
        The outcome of every image, and the totals. A bad image is a row that names its error.

    Raises:
        SeeColorError: For what concerns the whole folder.
    """
    from stereo_seecolor.dive.ranged_images import RangedImages
    from stereo_seecolor.run_folder.finished_run import geometry_of_ranges

    images, ranges, out = Path(images), Path(ranges), Path(out)
    config, options = config or RunConfig(), options or RunOptions()
    if config.color.lock == "auto":
        config = config.model_copy(
            update={"color": config.color.model_copy(update={"lock": "frame"})}
        )
    pairing = pair_by_stem(images, ranges)
    if holds_floats(pairing.pairs[0].left):
        raise InputError(
            f"{images}: holds floating-point numbers, but images have 8 or 16 bits a channel: if "
            "these are range maps, exchange --images and --range"
        )
    of_images = [replace(pair, right=pair.left) for pair in pairing.pairs]
    config, stored = settle_storage(config, of_images)
    config, notes = settle_response(config, pairing.pairs, has_right=False)
    found = verdict_of(RANGED_CHECKS, DiveImages(pairing.pairs, config))
    pairing = pairing.with_notes((*stored, *found.notes, *notes), found.wrong)
    paths = {"images": str(images.resolve()), "range": str(ranges.resolve())}
    owner = Owner("ranged", paths, sample(pairing.pairs[0].left), pairing.pairs)
    inputs = {"images": str(images), "range": str(ranges)}
    read = [*folders_of(images), *folders_of(ranges, RANGE_EXTENSIONS)]
    source = RangedImages(config, geometry_of_ranges(ranges))
    passes = ("ranges", "waters", "colors")
    with RunFolder(out, folder_request(owner, config, options, read)) as folder:
        with run_session(source, pairing, inputs, folder, options, "corrected", passes) as run:
            given = _given_waters(run)
            color(run, measure_ranges(run), given)
        return run.summary


def rectify(
    left: str | Path,
    right: str | Path,
    calib: str | Path,
    out: str | Path,
    config: RunConfig | None = None,
    options: RunOptions | None = None,
) -> RunSummary:
    """Write rectified pairs as PNG into ``out``, and their calibration.

    The folders are ``rectified_left`` and ``rectified_right``, the calibration ``rectified.yaml``.

    Args:
        left: Folder of the left images, a pattern (``DIVE/*_L.png``), or a video.
        right: The same of the right images; the left video again where it shows both sides.
        calib: A calibration in any format that ``calibration.formats.load_rig`` reads.
        out: Folder for the results; made where it does not exist.
        config: Settings; the defaults if not given.
        options: How the work is done: workers, overwriting, listeners.

    Returns:
        The outcome of every pair, and the totals. A bad pair is a row that names its error.

    Raises:
        SeeColorError: For what concerns the whole dive.
        CalibrationError: For a calibration that cannot be read or does not fit the images.
    """
    config, options = config or RunConfig(), options or RunOptions()
    inputs = StereoInputs(Path(left), Path(right), calib)
    before = inputs.open_first(config)
    request = folder_request(inputs.owner("rectify", before), config, options, inputs.paths)
    with RunFolder(Path(out), request) as folder:
        opened = (before or inputs.open_in(folder, config)).for_dive(folder, options)
        pipeline = opened.pipeline
        with run_session(
            pipeline, opened.pairing, inputs.names, folder, options, "rectified", ["rectified"]
        ) as run:
            folder.dive.begin({"rectified": pipeline.settings})
            folder.dive.write(
                RECTIFIED_RIG, native.to_bytes(pipeline.rectification.rectified_rig())
            )
            make_pass(run, "rectified", partial(_rectified, pipeline, folder), run.pairs)
        return run.summary


def _rectified(
    pipeline: Pipeline, folder: RunFolder, pair: Pair, clock: Clock
) -> tuple[FrameRow, None]:
    """Rectify and write a pair, unless an earlier run has with the same inputs; returns its row."""
    inputs = folder.frames.inputs(pair.name, pipeline.inputs(pair), verify=False)
    key = content_key({side: file.sha256 for side, file in inputs.items()}, pipeline.settings)
    if folder.frames.finished("rectified", pair.name, key):
        return FrameRow(pair.name, kept=True), None
    with clock("read"):
        raw = pipeline.read(pair)
    with clock("rectify"):
        frame = pipeline.rectify(raw)
        left, right = (pipeline.rectification.upright(side) for side in (frame.left, frame.right))
        files = rectified_files(pair.name, left, right)
    with clock("write"):
        record = folder.frames.record(pair.name, pair.timestamp_s, inputs, pair.place)
        folder.frames.save(
            record.with_stage("rectified", StageRecord(key, pipeline.settings)), "rectified", files
        )
    return FrameRow(pair.name), None
