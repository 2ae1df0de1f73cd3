"""``plan``: what a dive will cost, from ten of its pairs: core-hours, wall time, disk and memory."""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stereo_seecolor.commands.dive_job import claim
from stereo_seecolor.commands.dive_rig import spread
from stereo_seecolor.commands.run import KIND, StereoCommand, color, stereo_job
from stereo_seecolor.commands.stereo_inputs import Opened, StereoInputs
from stereo_seecolor.compute.process_usage import peak_bytes
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.kept_plan import KeptPlan, settings_key
from stereo_seecolor.run_folder.progress_file import USUAL

MEASURED_PAIRS = 10
"""Spread over the dive: the times of its pairs differ by some 10 %."""
WORKERS = (1, 4, 16, 64)


@dataclass(frozen=True)
class Plan:
    """What a dive will cost. measured: pairs that this rests on. stage_seconds: core-seconds a pair, by stage.

    fit_s: seconds for what is done once, on one core. disk_bytes: of all results. memory_bytes: of one process with one thread.
    wall_hours: workers -> hours; each worker is one core.
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
        """Of all pairs, and of what is done once."""
        return (self.pairs * self.core_seconds_per_pair + self.fit_s) / 3600


def plan(
    left: Path,
    right: Path,
    calib: str | Path,
    config: RunConfig | None = None,
    out: Path | None = None,
    workers: Sequence[int] = WORKERS,
) -> Plan:
    """Measure ten pairs in a folder for temporary files, after one that compiles and is not counted.

    out: where the plan is kept, so that the run into it says what it took against it; nothing else is written.
    Raises InputError where none of them goes through; SeeColorError, CalibrationError as ``run`` does.
    """
    inputs, config = StereoInputs(left, right, calib), config or RunConfig()
    opened = inputs.open(config)
    pairs = spread(opened.pairing.pairs, MEASURED_PAIRS)
    with tempfile.TemporaryDirectory(prefix="stereo-seecolor-plan-") as folder:
        warm = _measure(inputs, _only(opened, pairs[:1]), Path(folder) / "warm", PassClock())
        start_s = time.process_time()
        clock = PassClock()
        summary = _measure(inputs, _only(opened, pairs), Path(folder) / "measured", clock)
        core_s, ok = time.process_time() - start_s, summary.count("ok")
        if not ok:
            first = next(row.error for row in (*summary.rows, *warm.rows) if row.error)
            raise InputError(f"none of {len(pairs)} pairs spread over the dive goes through; the first: {first}")
        written = sum(path.stat().st_size for path in files_below(Path(folder) / "measured"))
    passes = {name: seconds / ok for name, seconds in clock.seconds.items()}
    number, per_pair = len(opened.pairing.pairs), sum(passes.values())
    fit_s = max(core_s - ok * per_pair, 0.0)
    seconds = summary.stage_seconds()  # by the clock, which runs on where the machine is busy with other things
    working = per_pair - passes.get("light", 0.0)
    stages = {stage: working * value / sum(seconds.values()) for stage, value in seconds.items()}
    stages |= {"light": stages.get("light", 0.0) + passes.get("light", 0.0)}
    hours = {count: (number * per_pair / count + fit_s) / 3600 for count in workers}
    found = Plan(number, ok, per_pair, stages, fit_s, written * number // ok, peak_bytes(), hours)
    if out:
        kept = KeptPlan(number, settings_key(opened.pipeline.config), per_pair, fit_s, found.disk_bytes, found.memory_bytes, passes)
        kept.save(out)
    return found


def _only(opened: Opened, pairs: Sequence[object]) -> Opened:
    return replace(opened, pairing=Pairing(tuple(pair for pair in opened.pairing.pairs if pair in pairs), ()))


class PassClock:
    """Core-seconds that the passes take. The search for the dive's light lies in and after the first, on the thread of the client.

    seconds: of all pairs, by pass.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._stage = ""
        self._began_s, self._light_began_s = 0.0, 0.0

    def begin(self, stage: str, total: int) -> None:
        """A pass begins."""
        if stage == "waters":  # the second of a dive whose light was looked for
            self.seconds["light"] = time.thread_time() - self._light_began_s
            self.seconds["ranges"] -= min(self.seconds["light"], self.seconds["ranges"] / 2)
        self._stage, self._began_s, self._light_began_s = stage, time.process_time(), time.thread_time()

    def advance(self, row: FrameRow) -> None:
        """A pair is through."""
        if self._stage in USUAL.seconds:
            self.seconds[self._stage] = time.process_time() - self._began_s


def _measure(inputs: StereoInputs, opened: Opened, out: Path, clock: PassClock) -> RunSummary:
    options = RunOptions(workers=1, listener=clock)
    command = StereoCommand(inputs, opened.pipeline.config, options, "corrected")
    with RunFolder(out, claim(inputs.owner(KIND, opened.pairing), options, inputs.paths)) as folder:
        passes = stereo_job(opened, command, lambda dive, held, pairing: color(dive, held, pairing, None))
        return passes.conduct(folder, options)
