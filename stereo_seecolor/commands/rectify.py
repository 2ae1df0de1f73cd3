"""``rectify``: rectified images alone, and the calibration that they have."""

from pathlib import Path

from calibration.formats import native
from stereo_seecolor.commands.dive_job import Job, claim, describe
from stereo_seecolor.commands.stereo_inputs import StereoInputs
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.passes import Dive
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.layout import RECTIFIED_RIG
from stereo_seecolor.run_folder.manifest import StageRecord
from stereo_seecolor.run_folder.products import rectified_files


def rectify(
    left: Path, right: Path, calib: str | Path, out: Path, config: RunConfig | None = None, options: RunOptions | None = None
) -> RunSummary:
    """Write rectified pairs as PNG into ``rectified_left`` and ``rectified_right``, and their calibration, ``rectified.yaml``.

    Raises SeeColorError or CalibrationError for what concerns the whole dive; a bad pair is named in the summary's rows.
    """
    config, options = config or RunConfig(), options or RunOptions()
    inputs = StereoInputs(left, right, calib)
    before = inputs.open_first(config)
    with RunFolder(out, claim(inputs.owner("rectify", before), config, options, inputs.paths)) as folder:
        opened = (before or inputs.open_in(folder, config)).for_dive(folder, options)
        pairing, pipeline = opened.pairing, opened.pipeline
        description = describe(inputs.names, pipeline.config, pairing, "rectified", options, pipeline.rectification)

        def passes(dive: Dive, folder: RunFolder) -> None:
            folder.dive.begin({"rectified": pipeline.settings})
            folder.dive.write(RECTIFIED_RIG, native.to_bytes(pipeline.rectification.rectified_rig()))
            dive.each("rectified", pairing.pairs, lambda pair, clock: _rectified(pipeline, folder, pair, clock))

        return Job(pipeline, pairing, description, passes).conduct(folder, options)


def _rectified(pipeline: Pipeline, folder: RunFolder, pair: Pair, clock: Clock) -> FrameRow:
    """Rectify and write a pair, unless an earlier run has with the same inputs; returns its row."""
    inputs = folder.frames.inputs(pair.name, pipeline.inputs(pair), verify=False)
    key = content_key({side: file.sha256 for side, file in inputs.items()}, pipeline.settings)
    if folder.frames.finished("rectified", pair.name, key):
        return FrameRow(pair.name, kept=True)
    with clock("read"):
        raw = pipeline.read(pair)
    with clock("rectify"):
        frame = pipeline.rectify(raw)
        left, right = (pipeline.rectification.upright(side) for side in (frame.left, frame.right))
        files = rectified_files(pair.name, left, right, pipeline.config.output)
    with clock("write"):
        record = folder.frames.record(pair.name, pair.timestamp_s, inputs, pair.place)
        folder.frames.save(record.with_stage("rectified", StageRecord(key, pipeline.settings)), "rectified", files)
    return FrameRow(pair.name)
