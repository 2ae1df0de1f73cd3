"""``live``: pairs are corrected as they arrive."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from calibration.formats import load_rig
from stereo_seecolor.commands.bag_inputs import BagInputs
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.live.played_bag import PlayedBag
from stereo_seecolor.live.preview import Preview, served
from stereo_seecolor.live.processing import LiveFrame, LiveProcessor
from stereo_seecolor.live.session import LiveCounts, LiveSession, Source
from stereo_seecolor.live.watch import FolderWatch
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.run_folder.products import correction_files, range_files


@dataclass(frozen=True)
class LiveResult:
    """What happened. dropped: left images passed over for newer ones. Latencies: from arrival to the corrected image, seconds."""

    done: int
    failed: int
    dropped: int
    last_error: str
    latency_median_s: float | None
    latency_p95_s: float | None


@dataclass(frozen=True)
class LiveOptions:
    """out: a new or empty folder that products are kept in, None for none. port: of the page, None for none; 0 is any.

    pairs: end after so many, None to go on until Ctrl-C. announce: is told the page's address.
    """

    out: Path | None = None
    port: int | None = None
    pairs: int | None = None
    announce: Callable[[str], None] = lambda _: None


@dataclass(frozen=True)
class LiveInputs:
    """Two folders that fill, or a bag that is played at its own rate; calib: as for load_rig, "" for the bag's own camera_info."""

    left: Path | None = None
    right: Path | None = None
    bag: Path | None = None
    topics: str = ""
    calib: str | Path = ""

    def open(self, config: RunConfig) -> tuple[Source, Pipeline]:
        """Raises CalibrationError for the rig; InputError, DeviceError for a bag."""
        if self.bag is not None:
            opened = BagInputs(self.bag, self.calib, self.topics).open(config)
            return PlayedBag(opened.pairing, self.bag), opened.pipeline
        assert self.left and self.right
        return FolderWatch(self.left, self.right, config.input), Pipeline(load_rig(self.calib), config)


def live(inputs: LiveInputs, config: RunConfig | None = None, options: LiveOptions | None = None) -> LiveResult:
    """Correct the newest pair that has arrived, again and again, with the water of the last frames.

    A pair that fails is counted; a folder that is not there is waited for.
    Raises CalibrationError for the rig; OutputError if ``out`` holds anything or cannot be written, or the port is taken; for a
    bag also InputError and DeviceError.
    """
    config, options = config or RunConfig(), options or LiveOptions()
    source, pipeline = inputs.open(config)
    if options.out is not None and options.out.exists() and any(options.out.iterdir()):
        raise OutputError(
            f"{options.out}: is there already: live keeps its pictures in a new or an empty folder; nothing was touched"
        )
    session = LiveSession(source, LiveProcessor(pipeline).process, lambda _: None)
    preview = Preview(session.counts)
    session.show = lambda frame: _show(frame, pipeline, preview if options.port is not None else None, options.out)
    with ExitStack() as stack:
        if options.port is not None:
            options.announce(stack.enter_context(served(preview, options.port)))
        counts = session.run(lambda counts: options.pairs is not None and counts.done >= options.pairs)
    return _result(counts)


def _show(frame: LiveFrame, pipeline: Pipeline, preview: Preview | None, out: Path | None) -> None:
    if preview:
        preview.update(frame)
    if out is None:
        return
    output, result, name = pipeline.config.output, frame.result, frame.pair.name
    files = range_files(name, result.range_map, output)
    files |= correction_files(name, result.correction, result.range_map, pipeline.geometry, output, b"")
    for path, content in files.values():
        write_atomic(out / path, content)


def _result(counts: LiveCounts) -> LiveResult:
    facts = counts.facts()
    return LiveResult(**{name: facts[name] for name in LiveResult.__dataclass_fields__})
