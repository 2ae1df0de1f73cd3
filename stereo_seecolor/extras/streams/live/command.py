"""``live``: correct pairs as they arrive."""

import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

from calibration import CalibrationError, StereoRig
from calibration.errors import SizeMissingError, counted
from calibration.formats import load_rig, load_rig_of_images
from calibration.rig import for_channels
from calibration.suspicions import suspicions
from calibration.verification.conventions import resolve_convention
from stereo_seecolor.checks.camera_response import settle_response
from stereo_seecolor.checks.dive import IMAGE_CHECKS
from stereo_seecolor.checks.rig import check_processed
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, DiveVerdict, verdict_of
from stereo_seecolor.commands.rig_loading import behind_port
from stereo_seecolor.commands.stereo_inputs import settle_storage
from stereo_seecolor.compute.background import pin
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import OutputError
from stereo_seecolor.extras.streams.bag_inputs import BagInputs
from stereo_seecolor.extras.streams.live.budget import Budget
from stereo_seecolor.extras.streams.live.outputs import KeptFiles, published, recorder
from stereo_seecolor.extras.streams.live.played_bag import PlayedBag
from stereo_seecolor.extras.streams.live.preview import HOST, Preview, served
from stereo_seecolor.extras.streams.live.processing import LiveFrame, LiveProcessor, warm_up
from stereo_seecolor.extras.streams.live.session import (
    LiveCounts,
    LiveSession,
    LiveSource,
    first_frames,
)
from stereo_seecolor.extras.streams.live.sources import live_source
from stereo_seecolor.extras.streams.mcap_recording import McapRecording
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import Numbers, StereoFrame, is_monochrome

STORED = (("input", "significant_bits"), ("input", "bayer"), ("color", "input_space"))
"""Settings that ``run`` finds in the files where they are auto."""


@dataclass(frozen=True)
class LiveResult:
    """Numbers of a live session. done, failed: pairs. biased: of the done ones, those whose rows
    are off, so that the calibration does not fit. dropped: left images skipped for newer ones.
    reduced: what was left out of the last pair to save time, "" for nothing. waiting: what was
    waited for at the end, "" for nothing. has_unpaired: meanwhile images came that have no partner.
    notes: on the calibration and the bag, and of the checks of run on all pairs together at the
    end, if they can be read again; wrong: the numbers that these find wrong.

    latency: seconds from arrival of a pair to its corrected image. products: until all its products
    are written. Both None before the first pair.
    """

    done: int
    failed: int
    biased: int
    dropped: int
    last_error: str
    reduced: str
    waiting: str
    has_unpaired: bool
    latency_median_s: float | None
    latency_p95_s: float | None
    products_median_s: float | None
    products_p95_s: float | None
    notes: tuple[str, ...]
    wrong: tuple[Numbers, ...]


@dataclass(frozen=True)
class LiveOptions:
    """The outputs of a live session, and its limits.

    out: a new or empty folder for the products of every ``every``th pair, None for none. record: a
    new MCAP file of all pairs.
    publish: the namespace for ROS 2 topics of all pairs, "" for none. port, host: of the page; port
    None for no page, 0 for any free port. budget_s: seconds that a pair may take; slower pairs are
    matched at half the size. cpus: number of processors to use, None for all. pairs: end after this
    number, corrected or failed, None to go on until Ctrl-C. announce: called with the page's
    address, and with a line where no pair comes, and for the first pair with each kind of
    error or warning.
    """

    out: Path | None = None
    every: int = 1
    record: Path | None = None
    publish: str = ""
    port: int | None = None
    host: str = HOST
    budget_s: float | None = None
    cpus: int | None = None
    pairs: int | None = None
    announce: Callable[[str], None] = lambda _: None


@dataclass(frozen=True)
class LiveInputs:
    """The source of pairs: two sides, or a bag that is played at its own rate. calib: as for
    load_rig, "" for its camera_info.

    left, right: folders that receive images; or capture devices and network addresses (``0``,
    ``rtsp://...``), the same twice for a camera that shows both sides; or ROS 2 topics
    (``ros2:/stereo/left/image_raw``).
    """

    left: str | Path = ""
    right: str | Path = ""
    bag: Path | None = None
    topics: str = ""
    calib: str | Path = ""

    def open(
        self, config: RunConfig, stack: ExitStack, tell: Callable[[str], None]
    ) -> tuple[LiveSource, Pipeline, DiveVerdict]:
        """Open the source, until ``stack`` closes, and the pipeline; with what is said of both.

        Waits for the first pair where the calibration states no image size, or can be read in
        several ways, and tells so. Raises CalibrationError, InputError, DeviceError.
        """
        if self.bag is not None:
            opened = BagInputs(self.bag, self.calib, self.topics).open(config)
            pairing, pipeline = opened.pairing, opened.pipeline
            source = PlayedBag(pairing, self.bag, pipeline.config.input)
            return source, pipeline, DiveVerdict(pairing.notes, pairing.wrong)
        rig = None
        with suppress(SizeMissingError):  # a bad calibration is named before a camera is opened
            rig = load_rig(self.calib)
        arriving = live_source(str(self.left), str(self.right), config.input, stack)
        if rig is None or rig.alternatives:
            rig = self._rig_of(first_frames(arriving, tell), tell)
        rig = behind_port(rig, config.input)
        notes = tuple(f"calibration: {suspicion}" for suspicion in suspicions(rig))
        return arriving, Pipeline(rig, config), DiveVerdict(notes)

    def _rig_of(self, frames: Iterator[StereoFrame], tell: Callable[[str], None]) -> StereoRig:
        """The rig as ``run`` reads it: of the size of the images, and in the way that fits them."""
        for frame in frames:
            height, width = frame.left.shape[:2]
            rig = load_rig_of_images(self.calib, (width, height))
            rig = for_channels(rig, is_monochrome(frame.left))
            try:
                return resolve_convention(rig, [(frame.left, frame.right)])
            except CalibrationError as error:
                tell(f"{frame.name}: does not show how to read the calibration: {error}")
        raise AssertionError("frames end with an error")


def live(
    inputs: LiveInputs, config: RunConfig | None = None, options: LiveOptions | None = None
) -> LiveResult:
    """Correct the newest pair that has arrived, repeatedly, with the water of the last frames.

    A pair that fails is counted. A source that is not available yet is waited for.
    Raises CalibrationError for the rig; OutputError if ``out`` or ``record`` is there already or
    cannot be written, or the port is taken; InputError and DeviceError for a bag, and for cameras
    and topics that cannot be read here.
    """
    config, options = config or RunConfig(), options or LiveOptions()
    if options.cpus is not None:
        limit_cores(len(pin(options.cpus)) or options.cpus)
    counts = LiveCounts()
    with ExitStack() as stack:
        source, pipeline, opened = inputs.open(config, stack, options.announce)
        for note in opened.notes:
            options.announce(f"note: {note}")
        made = _made(pipeline, options, counts, stack)
        warm_up(pipeline)
        processor = LiveProcessor(pipeline, source.read, Budget(options.budget_s))

        def finish(frame: LiveFrame) -> None:
            for make in made:
                make(frame)

        def is_enough(counts: LiveCounts) -> bool:
            return options.pairs is not None and counts.done + counts.failed >= options.pairs

        try:
            LiveSession(source, processor.process, finish, counts, options.announce).run(is_enough)
        except OutputError:
            options.announce(
                f"{counted(counts.done, 'pair')} corrected, {counts.failed} failed; the outputs of "
                f"{counts.written} are complete"
            )
            raise
    found = opened
    if counts.done and (pairs := source.still_there()):
        options.announce(f"checking the calibration against {counted(len(pairs), 'pair')}")
        found = _checked(pipeline, pairs).after(opened)
    facts = counts.facts() | {"notes": found.notes, "wrong": tuple(sorted(found.wrong))}
    return LiveResult(**{name: facts[name] for name in LiveResult.__dataclass_fields__})


def _checked(pipeline: Pipeline, pairs: Sequence[Pair]) -> DiveVerdict:
    """What ``run`` asks all pairs of a dive, which no single pair shows."""
    of_images = verdict_of(IMAGE_CHECKS, DiveImages.with_colors(pairs, pipeline.config))
    return check_processed(pipeline, pairs).after(of_images).after(_misread(pipeline, pairs))


def _misread(pipeline: Pipeline, pairs: Sequence[Pair]) -> DiveVerdict:
    """Settings that ``run`` finds in the files of a dive, and ``live`` does not."""
    given, used = pipeline.config, pipeline.response
    found = settle_response(settle_storage(given, pairs)[0], pairs)[0]
    settings = {
        f"{section}.{key}": value
        for section, key in STORED
        if (value := getattr(getattr(found, section), key)) not in (None, "none", "auto")
        and value != getattr(getattr(given, section), key)
    }
    color = found.color  # live measured it in one image
    has_other_pedestal = any(color.pedestal) and not any(used.pedestal)
    if has_other_pedestal or color.input_encoding in {"linear", "srgb"} - {used.encoding}:
        settings["color.input_encoding"] = color.input_encoding
    if has_other_pedestal:
        settings["color.pedestal"] = [round(value, 4) for value in color.pedestal]
    if not settings:
        return NOTHING_FOUND
    words = " ".join(f"--set {shlex.quote(f'{key}={value}')}" for key, value in settings.items())
    note = f"input: the colors are wrong, since live reads these files rightly only with {words}"
    return DiveVerdict((note,), COLORS)


def _made(
    pipeline: Pipeline, options: LiveOptions, counts: LiveCounts, stack: ExitStack
) -> list[Callable[[LiveFrame], None]]:
    """Functions that make the outputs of a pair, in the order in which they are called."""
    made: list[Callable[[LiveFrame], None]] = []
    assert pipeline.geometry is not None
    if options.out is not None:
        made.append(KeptFiles(options.out, options.every, pipeline))
    if options.record is not None:
        made.append(
            recorder(stack.enter_context(McapRecording(options.record, pipeline.geometry, "lz4")))
        )
    if options.publish:
        made.append(published(options.publish, pipeline.geometry))
    if options.port is not None:
        preview = Preview(counts)
        made.append(preview.update)
        options.announce(stack.enter_context(served(preview, options.port, options.host)))
    return made
