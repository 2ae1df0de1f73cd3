"""``plan``: the cost of a dive by ten of its pairs: core-hours, wall time, disk and memory."""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stereo_seecolor.checks.sample import evenly_spaced
from stereo_seecolor.commands.run import color
from stereo_seecolor.commands.run_session import KIND, folder_request, run_session
from stereo_seecolor.commands.stereo_inputs import Opened, StereoInputs
from stereo_seecolor.compute.process import peak_bytes
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.passes import measure_ranges
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.cache import KeptPlan
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.replaced_results import refuse_inputs
from stereo_seecolor.run_folder.run_progress import USUAL

MEASURED_PAIRS = 10
"""Spread over the dive: the times of its pairs differ by some 10 %."""
WORKERS = (1, 4, 16, 64)


@dataclass(frozen=True)
class Plan:
    """The cost of a dive. pairs: of the dive. measured: pairs that the estimate is from.

    core_seconds_per_pair: processor time. stage_seconds: stage -> processor time a pair. fit_s:
    processor time of the fits, which are done once, on one core. disk_bytes: of all results.
    memory_bytes: of one process with one thread. wall_hours: workers, one core each -> hours.
    """

    pairs: int
    measured: int
    core_seconds_per_pair: float
    stage_seconds: dict[str, float]
    fit_s: float
    disk_bytes: int
    memory_bytes: int
    wall_hours: dict[int, float]

    @property
    def core_hours(self) -> float:
        """Processor time of all pairs and of the fits, hours."""
        return (self.pairs * self.core_seconds_per_pair + self.fit_s) / 3600


def plan(
    left: Path,
    right: Path,
    calib: str | Path,
    config: RunConfig | None = None,
    out: Path | None = None,
    workers: Sequence[int] = WORKERS,
) -> Plan:
    """Run ten pairs in a temporary folder and extrapolate; a first pair, which compiles kernels, is
    run before and not counted.

    out: the output folder of the later run: the plan is kept there, so that the run reports its
    cost against it; None keeps none.
    workers: numbers of workers to state the wall time for.
    Raises InputError where none of them goes through; SeeColorError, CalibrationError as ``run``
    does.
    """
    inputs, config = StereoInputs(left, right, calib), config or RunConfig()
    if out:
        refuse_inputs("plan", out, inputs.paths)
        KeptPlan.check_place(out)
    opened = inputs.open(config)
    measured = _measured(inputs, opened, evenly_spaced(opened.pairing.pairs, MEASURED_PAIRS))
    pairs, per_pair = len(opened.pairing.pairs), sum(measured.pass_seconds.values())
    found = Plan(
        pairs=pairs,
        measured=measured.pairs,
        core_seconds_per_pair=per_pair,
        stage_seconds=measured.stage_seconds,
        fit_s=measured.fit_s,
        disk_bytes=measured.written_bytes * pairs // measured.pairs,
        memory_bytes=peak_bytes(),
        wall_hours={count: (pairs * per_pair / count + measured.fit_s) / 3600 for count in workers},
    )
    if out:
        kept = KeptPlan(
            pairs=pairs,
            core_seconds_per_pair=per_pair,
            fit_s=found.fit_s,
            disk_bytes=found.disk_bytes,
            memory_bytes=found.memory_bytes,
            pass_seconds=measured.pass_seconds,
        )
        kept.save(out, KeptPlan.key(pairs, opened.pipeline.config))
    return found


@dataclass(frozen=True)
class _Measured:
    """What some pairs of a dive took. pass_seconds, stage_seconds: processor time a pair."""

    pairs: int
    pass_seconds: dict[str, float]
    stage_seconds: dict[str, float]
    fit_s: float
    written_bytes: int


def _measured(inputs: StereoInputs, opened: Opened, pairs: Sequence[Pair]) -> _Measured:
    """Run these pairs into a temporary folder. Raises InputError if none goes through."""
    with tempfile.TemporaryDirectory(prefix="stereo-seecolor-plan-") as folder:
        warm = _run(inputs, _only(opened, pairs[:1]), Path(folder) / "warm", PassClock())
        start_s = time.process_time()
        clock = PassClock()
        summary = _run(inputs, _only(opened, pairs), Path(folder) / "measured", clock)
        core_s, ok = time.process_time() - start_s, summary.count("ok")
        if not ok:
            first = next(row.error for row in (*summary.rows, *warm.rows) if row.error)
            raise InputError(
                f"none of {len(pairs)} pairs spread over the dive succeeds; the first: {first}"
            )
        written = sum(path.stat().st_size for path in files_below(Path(folder) / "measured"))
    passes = {name: seconds / ok for name, seconds in clock.seconds.items()}
    per_pair = sum(passes.values())
    return _Measured(
        ok, passes, _stage_seconds(summary, passes), max(core_s - ok * per_pair, 0.0), written
    )


def _stage_seconds(summary: RunSummary, passes: dict[str, float]) -> dict[str, float]:
    """The passes' processor time a pair, divided among the stages in proportion to their elapsed
    time in the summary.
    """
    # also counts time in which the processor worked for other programs
    elapsed = summary.stage_seconds()
    light_s = passes.get("light", 0.0)
    working = sum(passes.values()) - light_s
    stages = {stage: working * value / sum(elapsed.values()) for stage, value in elapsed.items()}
    return stages | {"light": stages.get("light", 0.0) + light_s}


def _only(opened: Opened, pairs: Sequence[Pair]) -> Opened:
    return replace(
        opened, pairing=Pairing(tuple(pair for pair in opened.pairing.pairs if pair in pairs), ())
    )


class PassClock:
    """A listener that measures passes. seconds: pass -> processor time of all pairs, seconds."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._stage = ""
        self._began_s = 0.0

    def begin(self, stage: str, total: int) -> None:
        """Note when a pass begins."""
        if self._stage == "light":  # is solved after its last frame was examined
            self.seconds["light"] = time.process_time() - self._began_s
        self._stage, self._began_s = stage, time.process_time()

    def advance(self, row: FrameRow) -> None:
        """Note when a pair is done."""
        if self._stage in USUAL.seconds:
            self.seconds[self._stage] = time.process_time() - self._began_s


def _run(inputs: StereoInputs, opened: Opened, out: Path, clock: PassClock) -> RunSummary:
    """Run the opened pairs into ``out``, one after the other."""
    options = RunOptions(workers=1, listener=clock)
    pipeline, passes = opened.pipeline, ("ranges", "light", "waters", "colors")
    with RunFolder(
        out, folder_request(inputs.owner(KIND, opened), pipeline.config, options, inputs.paths)
    ) as folder:
        with run_session(
            pipeline, opened.pairing, inputs.names, folder, options, "corrected", passes
        ) as run:
            color(run, measure_ranges(run))
        return run.summary
